"""The design model: a linear model with actuators and integrals in one set of matrices, names
kept."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from controller.game.zero_sum import Game
from controller.servo.design import Design, signal_unit
from hfa_aircraft.model import Model
from hfa_support.errors import BadInputError
from hfa_support.reporting.fields import Shown
from trim.linear.linear_model import LinearModel, linearize
from trim.point.operating_point import OperatingPoint

#: Rows whose smallest singular value is below this, in units in which rows and columns have size 1,
#: are dependent.
RANK = 1e-10


@dataclass(frozen=True, eq=False, repr=False)
class DesignModel(Shown):
    """z' = A z + B u + E w,  y = C z + D u + noise,  of `design` about the operating point of
    `model`.

    z: the states of the linear model, then actuator positions and rates, integrals (`states`). A:
    (n, n). B: (n, m). E: (n, k), the columns of each disturbance times the root of its intensity.
    C: (p, n), D: (p, m) of the sensors. Units: those of the linear model; an integral has its
    output's times s."""

    design: Design
    model: LinearModel
    A: np.ndarray
    B: np.ndarray
    E: np.ndarray
    C: np.ndarray
    D: np.ndarray

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
    def state_units(self) -> tuple[str, ...]:
        """Unit of each state, in order."""
        return tuple(signal_unit(self.design.model, name) for name in self.states)

    @property
    def input_units(self) -> tuple[str, ...]:
        """Unit of each input, in order."""
        return self.design.model.units(self.inputs)

    @property
    def V(self) -> np.ndarray:
        """Intensity of the noise of the sensors, (p, p)."""
        return np.diag([float(value) for value in self.design.sensors.values()]).reshape(
            2 * (len(self.sensors),)
        )

    def game(self) -> Game:
        """J = ∫ z'Qz + u'Ru - δ² w'w with the weights of the design.

        BadInputError when an integrated output cannot be brought to a value of choice and held
        there, or the design has no game."""
        if self.design.shaping is not None:
            raise BadInputError(
                f"design {self.design.name} is a loop shaping and has no game; make it with hfa design"
            )
        self._check_integrals()
        Q = np.diag([float(self.design.state_weights.get(name, 0.0)) for name in self.states])
        R = np.diag([float(self.design.input_weights[name]) for name in self.inputs])
        return Game(A=self.A, B=self.B, E=self.E, Q=Q, R=R, delta=self.design.delta)

    def _check_integrals(self) -> None:
        """[A B; C D] of the integrated outputs has full row rank: without it the plant has a zero
        at 0."""
        names = self.design.integrals
        plant = len(self.states) - len(names)
        rows = np.hstack([self.A[:, :plant], self.B])
        if not _full_rank(rows[:plant]):
            return  # a mode of the plant itself at 0, which the solver names
        for k, name in enumerate(names):
            alone = _full_rank(rows[[*range(plant), plant + k]])
            if not alone or not _full_rank(rows[: plant + k + 1]):
                others = f" apart from {', '.join(names[:k])}" if alone else ""
                why = f"no input moves it at rest{others} (a transmission zero at 0)"
                raise BadInputError(f"integrated output {name}: {why}; leave it out of integrals")


def design_model(aircraft: Model, model: LinearModel, design: Design) -> DesignModel:
    """x' = A x + B a + E w,  actuators from commands to a,  e' and y = C x + D a + F w,  y also a
    state of z.

    model: made of this aircraft. BadInputError when an output is not one, or when a sensor sees a
    disturbance itself: its noise must not depend on the disturbance."""
    design = design.of(aircraft)
    n, k, names, own = len(model.states), len(design.integrals), design.states, aircraft
    watched = (*design.integrals, *design.sensors)
    winds = tuple(each for each in design.disturbances if each in own.disturbances)
    columns = [model.inputs.index(name) for name in design.inputs]
    of_x, of_a, of_w, wind = watched_outputs(aircraft, model.point, watched, disturbances=winds)
    A, B = np.zeros((len(names), len(names))), np.zeros((len(names), len(columns)))
    C, D = np.zeros((len(watched), len(names))), np.zeros((len(watched), len(columns)))
    A[:n, :n], C[:, :n] = model.A, of_x
    for number, (name, column) in enumerate(zip(design.inputs, columns, strict=True)):
        if (actuator := design.actuators.get(name)) is None:
            B[:n, number], D[:, number] = model.B[:, column], of_a[:, column]
            continue
        last = place = names.index(f"{name}_position")
        A[:n, place], C[:, place] = model.B[:, column], of_a[:, column]
        stiffness = actuator.bandwidth**actuator.order
        if actuator.order == 2:
            last = names.index(f"{name}_rate")
            A[place, last], A[last, last] = 1.0, -2 * actuator.damping * actuator.bandwidth
        A[last, place], B[last, number] = -stiffness, stiffness * actuator.effectiveness
    blown = np.vstack([wind, np.zeros((len(names) - n, len(winds)))])
    for row, name in enumerate(watched):
        if row < k:
            place = len(names) - k + row
            A[place], B[place], blown[place] = C[row], D[row], of_w[row]
        elif name in names:
            C[row, names.index(name)] = 1.0
    sources = {"states": np.eye(len(names), n), "commands": B} | dict(
        zip(winds, blown.T[:, :, None], strict=True)
    )
    felt = {"commands": D} | dict(zip(winds, of_w.T[:, :, None], strict=True))
    for source in design.disturbances:
        for name, seen in zip(
            design.sensors, felt.get(source, np.zeros((len(watched), 1)))[k:], strict=True
        ):
            if np.any(seen):
                why = f"sensor {name} sees the {source} itself"
                raise BadInputError(f"design {design.name}: {why}; measure a state instead")
    E = np.hstack([math.sqrt(size) * sources[name] for name, size in design.disturbances.items()])
    return DesignModel(design, model, A, B, E, C[k:], D[k:])


def watched_outputs(
    aircraft: Model, point: OperatingPoint, names: tuple[str, ...], **winds: Any
) -> tuple[np.ndarray, ...]:
    """C, D, F of the named outputs and parts of outputs (`Model.measurable`), rows of zeros for
    other names, and E.

    winds: of `linearize`.
    """
    model = aircraft
    found = linearize(
        aircraft,
        point,
        outputs=tuple({model.part(each)[0]: 0 for each in names if each in model.measurable}),
        **winds,
    )
    C, D, F = (np.zeros((len(names), part.shape[1])) for part in (found.C, found.D, found.F))
    for row, (output, states) in enumerate(map(model.part, names)):
        if output in found.outputs:
            source = found.outputs.index(output)
            C[row], D[row], F[row] = found.C[source], found.D[source], found.F[source]
            C[row, [state not in states for state in model.linear]] = 0.0
    return C, D, F, found.E


def _full_rank(rows: np.ndarray) -> bool:
    """Whether the rows are independent by more than rounding, whatever the units of rows and
    columns."""
    scaled = rows.copy()
    for axis in (1, 0, 1, 0, 1):
        size = np.linalg.norm(scaled, axis=axis, keepdims=True)
        scaled = scaled / np.where(size > 0.0, size, 1.0)
    return bool(len(rows) <= rows.shape[1] and np.linalg.svd(scaled, compute_uv=False)[-1] > RANK)
