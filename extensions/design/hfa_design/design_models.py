"""Design model: matrices of a linear model that includes actuators and integrals."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from controller.game.zero_sum import Game
from hfa_aircraft.model import Model
from hfa_aircraft.names import PlantNames
from hfa_design.design import Design
from hfa_flight.policies.controller import watched_outputs
from hfa_flight.schedule.signal_units import signal_unit
from hfa_support.arguments import checks_arguments
from hfa_support.errors import BadInputError, NoSolutionError
from hfa_support.reporting.report import Reported
from trim.linear.linear_model import LinearModel

#: Rows are dependent if their smallest singular value is below this, after scaling rows and columns
#: to size 1.
RANK = 1e-10


@checks_arguments
@dataclass(frozen=True, eq=False, repr=False)
class DesignModel(Reported):
    """Design model z' = A z + B u + E w, y = C z + D u + noise, about an operating point of
    `model`.

    z contains the states of the linear model, then actuator positions and rates, then integrals
    (`states`). u are the commands, w the disturbances and y the measurements of the sensors. Units
    are those of the linear model. The unit of an integral is that of its output times s.

    design: the design
    model: linear model of the aircraft
    A: (n, n)
    B: (n, m)
    E: (n, k), columns of the disturbances, each multiplied by the root of its intensity
    C: (p, n), rows of the sensors
    D: (p, m), rows of the sensors
    """

    design: Design
    model: LinearModel
    A: np.ndarray
    B: np.ndarray
    E: np.ndarray
    C: np.ndarray
    D: np.ndarray

    @property
    def states(self) -> tuple[str, ...]:
        """Names of the states z, in order."""
        return self.design.states

    @property
    def inputs(self) -> tuple[str, ...]:
        """Names of u, the commands of the actuators, in order."""
        return self.design.inputs

    @property
    def sensors(self) -> tuple[str, ...]:
        """Names of the sensors, whose measurements are y, in order."""
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
        """Intensity matrix of the sensor noise, (p, p), diagonal."""
        return np.diag([float(value) for value in self.design.sensors.values()]).reshape(
            2 * (len(self.sensors),)
        )

    def game(self) -> Game:
        """Return the game J = ∫ z'Qz + u'Ru - δ² w'w with the weights of the design.

        Raises BadInputError if the design is a loop-shaping design, or if the inputs cannot hold an
        integrated output at an arbitrary value.
        """
        if self.design.shaping is not None:
            raise BadInputError(
                f"design {self.design.name} is a loop-shaping design without a game; use `hfa "
                "design`"
            )
        self._check_integrals()
        Q = np.diag([float(self.design.state_weights.get(name, 0.0)) for name in self.states])
        R = np.diag([float(self.design.input_weights[name]) for name in self.inputs])
        names = PlantNames(
            self.states,
            self.inputs,
            self.state_units,
            self.input_units,
            f"design {self.design.name}",
        )
        return Game(A=self.A, B=self.B, E=self.E, Q=Q, R=R, delta=self.design.delta, names=names)

    def _check_integrals(self) -> None:
        """Raise BadInputError if the inputs cannot hold every integrated output at any value."""
        # The inputs can if [A B; C D], with the rows of the integrated outputs, has full row rank.
        # Otherwise the plant has a transmission zero at 0. Nothing is raised if [A B] alone lacks
        # full row rank, because the solver then reports a mode at 0.
        names = self.design.integrals
        plant = len(self.states) - len(names)
        rows = np.hstack([self.A[:, :plant], self.B])
        if not _full_rank(rows[:plant]):
            return  # the solver reports a plant mode at 0
        for k, name in enumerate(names):
            alone = _full_rank(rows[[*range(plant), plant + k]])
            if not alone or not _full_rank(rows[: plant + k + 1]):
                others = f" independently of {', '.join(names[:k])}" if alone else ""
                why = f"no input changes the steady-state value{others} (a transmission zero at 0)"
                raise BadInputError(
                    f"integrated output {name}: {why}; remove this output from integrals"
                )


@checks_arguments
def design_model(model: Model, linear: LinearModel, design: Design) -> DesignModel:
    """Return the design model of a linear model x' = A x + B a + E w, with actuators and integrals.

    a are the positions of the actuators, which follow the commands. Measured and integrated outputs
    are y = C x + D a + F w, or states of the design model.

    Raises BadInputError if an output is unknown, or if a disturbance acts directly on a sensor,
    because sensor noise must be independent of the disturbance. Raises NoSolutionError if no input
    moves a mode that is not stable.
    """
    design = design.of(model)
    _refuse_unmoved(linear, design.inputs)
    n = len(linear.states)
    size = len(design.states)
    watched = (*design.integrals, *design.sensors)
    winds = tuple(name for name in design.disturbances if name in model.disturbances)
    by_x, by_a, by_w, E_winds = watched_outputs(model, linear.point, watched, disturbances=winds)
    A = np.zeros((size, size))
    B = np.zeros((size, len(design.inputs)))
    C = np.zeros((len(watched), size))
    D = np.zeros((len(watched), len(design.inputs)))
    A[:n, :n] = linear.A
    C[:, :n] = by_x
    for column, name in enumerate(design.inputs):
        moved = linear.inputs.index(name)
        if name in design.actuators:
            position = design.states.index(f"{name}_position")
            A[:n, position] = linear.B[:, moved]
            C[:, position] = by_a[:, moved]
            _add_actuator(A, B[:, column], design, name)
        else:
            B[:n, column] = linear.B[:, moved]
            D[:, column] = by_a[:, moved]
    E_of_winds = np.vstack([E_winds, np.zeros((size - n, len(winds)))])
    k = len(design.integrals)
    for row, name in enumerate(watched):
        if row < k:
            integral = size - k + row
            A[integral] = C[row]
            B[integral] = D[row]
            E_of_winds[integral] = by_w[row]
        elif name in design.states:
            C[row, design.states.index(name)] = 1.0
    _refuse_direct_effects(design, winds, D[k:], by_w[k:])
    sources = {"states": np.eye(size, n), "commands": B}
    for column, name in enumerate(winds):
        sources[name] = E_of_winds[:, column : column + 1]
    E = np.hstack(
        [math.sqrt(intensity) * sources[name] for name, intensity in design.disturbances.items()]
    )
    return DesignModel(design, linear, A, B, E, C[k:], D[k:])


def _refuse_unmoved(linear: LinearModel, inputs: Sequence[str]) -> None:
    """Raise NoSolutionError if the inputs do not move a mode that is not stable."""
    values, left = np.linalg.eig(linear.A.T)
    sizes = np.linalg.norm(linear.B, axis=0)
    for mode in linear.modes:
        if mode.stable:
            continue
        shape = left[:, int(np.argmin(np.abs(values - mode.eigenvalue)))]
        effects = np.abs(shape @ linear.B)
        moving = [
            name
            for name, is_moved in zip(linear.inputs, effects > RANK * sizes, strict=True)
            if is_moved
        ]
        if not set(moving) & set(inputs):
            others = f"add {' or '.join(moving)}" if moving else "no input of the model does"
            raise NoSolutionError(
                f"the inputs of the design do not move the mode {mode.name}, which is not stable; "
                f"{others}"
            )


def _add_actuator(A: np.ndarray, b: np.ndarray, design: Design, name: str) -> None:
    """Write the dynamics of an input's actuator into A and into b."""
    actuator = design.actuators[name]
    position = design.states.index(f"{name}_position")
    stiffness = actuator.bandwidth**actuator.order
    last = position
    if actuator.order == 2:
        last = design.states.index(f"{name}_rate")
        A[position, last] = 1.0
        A[last, last] = -2 * actuator.damping * actuator.bandwidth
    A[last, position] = -stiffness
    b[last] = stiffness * actuator.effectiveness


def _refuse_direct_effects(
    design: Design, winds: tuple[str, ...], by_commands: np.ndarray, by_winds: np.ndarray
) -> None:
    """Raise BadInputError if a disturbance acts directly on a sensor."""
    columns = {"commands": by_commands}
    for column, name in enumerate(winds):
        columns[name] = by_winds[:, column : column + 1]
    for source in design.disturbances:
        if source not in columns:
            continue
        for sensor, row in zip(design.sensors, columns[source], strict=True):
            if np.any(row):
                why = f"sensor {sensor} depends directly on the {source}"
                raise BadInputError(f"design {design.name}: {why}; measure a state instead")


def selection(rows: Sequence[str], columns: Sequence[str]) -> np.ndarray:
    """Return the matrix whose entry is 1 if the name of its row equals that of its column, else 0.

    rows, columns: names
    """
    entries = [[float(row == column) for column in columns] for row in rows]
    return np.array(entries).reshape(len(rows), len(columns))


def _full_rank(rows: np.ndarray) -> bool:
    """Return whether the rows of a matrix are linearly independent beyond rounding."""
    scaled = rows.copy()
    for axis in (1, 0, 1, 0, 1):
        size = np.linalg.norm(scaled, axis=axis, keepdims=True)
        scaled = scaled / np.where(size > 0.0, size, 1.0)
    return bool(len(rows) <= rows.shape[1] and np.linalg.svd(scaled, compute_uv=False)[-1] > RANK)
