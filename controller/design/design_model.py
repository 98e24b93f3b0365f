"""The design model: a linear model with actuators and integrals in one set of matrices, names kept."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from controller.design.design import SHORT_PERIOD, Design
from controller.game.zero_sum import Game
from hfa_model.aircraft import Aircraft
from hfa_model.outputs import OUTPUTS, unit_of
from hfa_model.vectors import LINEAR_STATES, STATES
from hfa_support.errors import BadInputError
from hfa_support.reporting.fields import Shown
from trim.linear.linear_model import LinearModel, linearize
from trim.point.operating_point import OperatingPoint

#: Rows whose smallest singular value is below this, in units in which rows and columns have size 1, are dependent.
RANK = 1e-10


@dataclass(frozen=True, eq=False, repr=False)
class DesignModel(Shown):
    """z' = A z + B u + E w,  y = C z + D u + F w + noise,  of `design` about the operating point of `model`.

    z: the states of the linear model, then actuator positions and rates, integrals (`states`).
    A: (n, n). B: (n, m). E: (n, k), the columns of each disturbance times the root of its intensity. C: (p, n),
    D: (p, m) of the sensors. gust: (n, 1), F: (p, 1), the columns of an updraft of 1 ft/s, whether E has it or not.
    Units: those of the linear model; an integral has its output's times s.
    """

    design: Design
    model: LinearModel
    A: np.ndarray
    B: np.ndarray
    E: np.ndarray
    C: np.ndarray
    D: np.ndarray
    gust: np.ndarray
    F: np.ndarray
    state_units: tuple[str, ...]
    input_units: tuple[str, ...]

    @property
    def states(self) -> tuple[str, ...]:
        """Names of z, in order."""
        return self.design.states

    @property
    def inputs(self) -> tuple[str, ...]:
        """Names of the commands, in order."""
        return self.design.inputs

    @property
    def sensors(self) -> tuple[str, ...]:
        """Names of y, in order."""
        return tuple(self.design.sensors)

    @property
    def sensor_units(self) -> tuple[str, ...]:
        """Unit of each sensor, in order."""
        of_states = dict(zip(self.states, self.state_units, strict=True))
        return tuple(of_states.get(name) or unit_of(name.removesuffix(SHORT_PERIOD)) for name in self.sensors)

    @property
    def V(self) -> np.ndarray:
        """Intensity of the noise of the sensors, (p, p)."""
        return np.diag([float(value) for value in self.design.sensors.values()]).reshape(2 * (len(self.sensors),))

    def game(self) -> Game:
        """J = ∫ z'Qz + u'Ru - δ² w'w with the weights of the design.

        BadInputError when an integrated output cannot be brought to a value of choice and held there, or the design has
        no game.
        """
        if self.design.shaping is not None:
            raise BadInputError(f"design {self.design.name} is a loop shaping and has no game; make it with hfa design")
        self._check_integrals()
        Q = np.diag([float(self.design.state_weights.get(name, 0.0)) for name in self.states])
        R = np.diag([float(self.design.input_weights[name]) for name in self.inputs])
        return Game(A=self.A, B=self.B, E=self.E, Q=Q, R=R, delta=self.design.delta)

    def _check_integrals(self) -> None:
        """[A B; C D] of the integrated outputs has full row rank: without it the plant has a zero at 0."""
        names = self.design.integrals
        plant = len(self.states) - len(names)
        rows = np.hstack([self.A[:, :plant], self.B])
        if not _full_rank(rows[:plant]):
            return  # a mode of the plant itself at 0, which the solver names
        for k, name in enumerate(names):
            alone = _full_rank(rows[[*range(plant), plant + k]])
            if not alone or not _full_rank(rows[: plant + k + 1]):
                others = f" apart from {', '.join(names[:k])}" if alone else ""
                raise BadInputError(
                    f"integrated output {name}: no input moves it at rest{others} (a transmission zero at 0); "
                    "leave it out of integrals"
                )


def design_model(aircraft: Aircraft, model: LinearModel, design: Design) -> DesignModel:
    """x' = A x + B a + E w,  actuators from commands to a,  e' and y = C x + D a + F w,  y also a state of z.

    model: of six states, made of this aircraft. BadInputError when an output is not one, or when a sensor sees a
    disturbance itself: its noise must not depend on the disturbance.
    """
    n, k, names = len(LINEAR_STATES), len(design.integrals), design.states
    watched = (*design.integrals, *design.sensors)
    columns = [model.inputs.index(name) for name in design.inputs]
    of_x, of_a, of_w, wind = watched_outputs(aircraft, model.point, watched)
    A, B = np.zeros((len(names), len(names))), np.zeros((len(names), len(columns)))
    C, D = np.zeros((len(watched), len(names))), np.zeros((len(watched), len(columns)))
    A[:n, :n], C[:, :n] = model.A, of_x
    for number, (name, column) in enumerate(zip(design.inputs, columns, strict=True)):
        moved = name in design.actuators
        place = names.index(f"{name}_position") if moved else number
        (A if moved else B)[:n, place], (C if moved else D)[:, place] = model.B[:, column], of_a[:, column]
        if moved:
            _connect(A, B, number, names, name, design)
    gust = np.vstack([wind, np.zeros((len(names) - n, 1))])
    for row, name in enumerate(watched):
        if row < k:
            place = len(names) - k + row
            A[place], B[place], gust[place] = C[row], D[row], of_w[row]
        elif name in names:
            C[row, names.index(name)] = 1.0
    sources = {"states": np.eye(len(names), n), "updraft": gust, "commands": B}
    for name, *seen in zip(design.sensors, D[k:], of_w[k:], strict=True):
        for source, column in zip(("commands", "updraft"), seen, strict=True):
            if source in design.disturbances and np.any(column):
                raise BadInputError(
                    f"design {design.name}: sensor {name} sees the {source} itself; measure a state instead"
                )
    E = np.hstack([math.sqrt(size) * sources[name] for name, size in design.disturbances.items()])
    units = dict(zip(model.inputs, model.input_units, strict=True))
    of_inputs = tuple(units[name] for name in design.inputs)
    return DesignModel(design, model, A, B, E, C[k:], D[k:], gust, of_w[k:], _units(design, model), of_inputs)


def _connect(A: np.ndarray, B: np.ndarray, number: int, names: tuple[str, ...], name: str, design: Design) -> None:
    """The rows of one actuator."""
    actuator, position = design.actuators[name], names.index(f"{name}_position")
    w = actuator.bandwidth
    if actuator.order == 1:
        A[position, position], B[position, number] = -w, w * actuator.effectiveness
        return
    rate = names.index(f"{name}_rate")
    A[position, rate] = 1.0
    A[rate, position], A[rate, rate] = -(w**2), -2 * actuator.damping * w
    B[rate, number] = w**2 * actuator.effectiveness


def watched_outputs(
    aircraft: Aircraft, point: OperatingPoint, names: tuple[str, ...], **winds: Any
) -> tuple[np.ndarray, ...]:
    """C, D, F of the named outputs, rows of zeros for names that are no output, and E of the updraft, (6, 1).

    Of a short-period output alpha, the inputs and the air count only. winds: of `linearize`.
    """
    plain = [name.removesuffix(SHORT_PERIOD) for name in names]
    known = dict.fromkeys(name for name in plain if name in (*STATES, *OUTPUTS))
    found = linearize(aircraft, point, outputs=tuple(known), **winds)
    C, D, F = (np.zeros((len(names), part.shape[1])) for part in (found.C, found.D, found.F))
    for row, (name, output) in enumerate(zip(names, plain, strict=True)):
        if output in found.outputs:
            source = found.outputs.index(output)
            C[row], D[row], F[row] = found.C[source], found.D[source], found.F[source]
        if name.endswith(SHORT_PERIOD):
            C[row, [state != "alpha" for state in LINEAR_STATES]] = 0.0
    return C, D, F, found.E


def _full_rank(rows: np.ndarray) -> bool:
    """Whether the rows are independent by more than rounding, whatever the units of rows and columns."""
    scaled = rows.copy()
    for axis in (1, 0, 1, 0, 1):
        size = np.linalg.norm(scaled, axis=axis, keepdims=True)
        scaled = scaled / np.where(size > 0.0, size, 1.0)
    return bool(len(rows) <= rows.shape[1] and np.linalg.svd(scaled, compute_uv=False)[-1] > RANK)


def _units(design: Design, model: LinearModel) -> tuple[str, ...]:
    inputs = dict(zip(model.inputs, model.input_units, strict=True))
    found = dict(zip(model.states, model.state_units, strict=True))
    found |= {f"{name}_position": unit for name, unit in inputs.items()}
    found |= {f"{name}_rate": f"{unit}/s" for name, unit in inputs.items()}
    found |= {f"{name}_integral": f"{unit_of(name.removesuffix(SHORT_PERIOD))} s" for name in design.integrals}
    return tuple(found[name] for name in design.states)
