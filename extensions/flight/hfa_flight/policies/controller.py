"""Policy of a flight that applies a scheduled controller at the measured scheduling variable."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from hfa_aircraft.model import Model
from hfa_flight.air.names import UPDRAFT
from hfa_flight.history import Deviations
from hfa_flight.policies.policy import Measurements, Policy
from hfa_flight.policies.tables import table_expression
from hfa_flight.schedule.scheduled_controller import COMMAND_SIGNALS, ScheduledController
from hfa_flight.signals import CommandSteps
from hfa_support.arguments import checks_arguments
from hfa_support.errors import BadInputError, refuse_unknown
from hfa_support.linear_table import LinearTable
from trim.point.linearize import linearize
from trim.point.operating_point import OperatingPoint


def watched_outputs(
    model: Model, point: OperatingPoint, names: tuple[str, ...], **winds: Any
) -> tuple[np.ndarray, ...]:
    """Return the rows of C, D and F of named outputs or parts of outputs (`Model.measurable`), and
    E.

    The rows of a name that is not an output are 0. E is the disturbance matrix of the same linear
    model.

    point: operating point of the linear model
    winds: keywords of `linearize` for disturbances
    """
    parts = [model.part(name) for name in names]
    measurable = (model.part(name)[0] for name in names if name in model.measurable)
    linear = linearize(model, point, outputs=tuple(dict.fromkeys(measurable)), **winds)
    C = np.zeros((len(names), linear.C.shape[1]))
    D = np.zeros((len(names), linear.D.shape[1]))
    F = np.zeros((len(names), linear.F.shape[1]))
    for row, (output, states) in enumerate(parts):
        if output in linear.outputs:
            source = linear.outputs.index(output)
            C[row] = linear.C[source]
            D[row] = linear.D[source]
            F[row] = linear.F[source]
            C[row, [state not in states for state in model.linear]] = 0.0
    return C, D, F, linear.E


class MeasuredOutputs:
    """Measured outputs y - Y0 = C x + D a + F w + G a' of the linear model at a trim.

    The outputs may include the actuator states INPUT_position and INPUT_rate.

    x: deviations of the states of the linear model
    a: deviations of the actuator positions, with the actuator rates a'
    w: updraft, for a model with this disturbance
    """

    def __init__(self, model: Model, point: OperatingPoint, names: tuple[str, ...]) -> None:
        self.names = names
        self.model = model
        winds = (UPDRAFT,) if UPDRAFT in model.disturbances else ()
        self.C, self.D, self.F, _ = watched_outputs(model, point, names, disturbances=winds)
        self.G = np.zeros_like(self.D)
        inputs = tuple(model.inputs)
        for row, name in enumerate(names):
            moved, _, what = name.rpartition("_")
            if moved in inputs:
                matrix = self.D if what == "position" else self.G
                matrix[row, inputs.index(moved)] = 1.0

    def at(self, measurements: Measurements) -> ca.SX:
        """Return the deviations y - Y0 of the outputs from their trim values, (k,).

        Raises BadInputError if the outputs depend on actuator positions or rates that the flight
        does not have.
        """
        y = ca.mtimes(ca.DM(self.C), measurements.states)
        if measurements.updraft.numel():
            y = y + ca.mtimes(ca.DM(self.F), measurements.updraft)
        y = y + _moved(self.D, measurements.positions, "positions")
        return y + _moved(self.G, measurements.rates, "rates")


def _moved(matrix: np.ndarray, moved: ca.SX, what: str) -> ca.SX:
    """Return the effect of the actuators on the outputs, matrix @ moved, or 0 for a zero matrix."""
    if not matrix.any():
        return ca.SX(0)
    if not moved.numel():
        raise BadInputError(
            f"the controller measures actuator {what}, which this flight does not have; give"
            " actuators with these states"
        )
    return ca.mtimes(ca.DM(matrix), moved)


class Tracked(NamedTuple):
    """An output and its command during a flight.

    output, command: (N,), deviations from trim
    unit: unit of the output
    rms, largest: rms and largest absolute difference, in `unit`
    """

    name: str
    output: np.ndarray
    command: np.ndarray
    unit: str
    rms: float
    largest: float


def tracked(flight: Deviations, outputs: MeasuredOutputs, commands: CommandSteps) -> list[Tracked]:
    """Return each commanded output of a flight with its command. The output has no sensor noise."""
    model = outputs.model
    rows = model.state_places(model.linear)
    values = flight.states[:, rows] @ outputs.C.T + flight.inputs @ outputs.D.T
    if outputs.F.size:
        values += flight.updrafts[:, None] @ outputs.F.T
    followed = []
    for name, output, command in zip(
        commands.names, values.T, commands.sampled(flight.times).T, strict=True
    ):
        errors = np.abs(output - command)
        rms = float(np.sqrt(np.mean(errors**2)))
        unit = model.unit(model.part(name)[0])
        followed.append(Tracked(name, output, command, unit, rms, float(errors.max())))
    return followed


_MATRICES = ("A", "B", "C", "D", "W")


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class ServoPolicy(Policy):
    """Policy x' = A(η) x + B(η) y + W(η) (u_applied - u), u = C(η) x + D(η) y.

    η is the measured scheduling variable, and x is the memory of the policy.

    controller: controller with these matrices
    commands: `CommandSteps` of outputs, or an object with the same names, at, rate and end
    outputs: `MeasuredOutputs`, or an object with the same method `at`
    regulated: the commanded outputs
    scheduled_at: η at the trim in which the flight begins
    """

    controller: ScheduledController
    commands: Any
    outputs: Any
    regulated: MeasuredOutputs
    scheduled_at: float

    def control(self, t: ca.SX, measurements: Measurements, memory: ca.SX, held: ca.SX) -> ca.SX:
        """Return the deviations of all inputs from the trim, 0 for inputs without a controller."""
        _, _, C, D, _ = self._matrices(measurements)
        u = ca.mtimes(C, memory) + ca.mtimes(D, self._inputs(t, measurements))
        return ca.mtimes(ca.DM(self._chosen), u)

    def memory_rate(
        self,
        t: ca.SX,
        measurements: Measurements,
        memory: ca.SX,
        held: ca.SX,
        applied: ca.SX,
    ) -> ca.SX:
        """Return the time derivative of the controller states x, (n,)."""
        A, B, _, _, W = self._matrices(measurements)
        rate = ca.mtimes(A, memory) + ca.mtimes(B, self._inputs(t, measurements))
        if not self.controller.W.any():
            return rate
        missed = applied - self.control(t, measurements, memory, held)
        return rate + ca.mtimes(W, ca.mtimes(ca.DM(self._chosen.T), missed))

    def tracking_errors(self, flight: Deviations) -> dict[str, dict[str, Any]]:
        """Return rms, largest error and unit of each commanded output, by name.

        The result is {} for symbolic commands.
        """
        if not isinstance(self.commands, CommandSteps):
            return {}
        return {
            output.name: {
                "rms_error": output.rms,
                "largest_error": output.largest,
                "unit": output.unit,
            }
            for output in tracked(flight, self.regulated, self.commands)
        }

    def _inputs(self, t: ca.SX, measurements: Measurements) -> ca.SX:
        """Return the input y = [measured; commands] of the controller. Missing commands are 0."""
        since = measurements.since if measurements.since.numel() else t
        values = dict(
            zip(
                COMMAND_SIGNALS,
                (self.commands.at(t), self.commands.rate(t), self.commands.end(since)),
                strict=True,
            )
        )
        rows = [self.outputs.at(measurements)]
        for name in self.controller.commands:
            suffix = next(end for end in reversed(COMMAND_SIGNALS) if name.endswith(end))
            output = name.removesuffix(suffix)
            if output in self.commands.names:
                rows.append(values[suffix][self.commands.names.index(output)])
            else:
                rows.append(ca.SX(0))
        return ca.vertcat(*rows)

    def _matrices(self, measurements: Measurements) -> tuple[ca.SX, ...]:
        """Return A, B, C, D and W at the measured η."""
        model = self.regulated.model
        deviation = measurements.states[model.linear.index(model.schedule)]
        return self._table.at(self.scheduled_at + deviation)

    @property
    def _chosen(self) -> np.ndarray:
        """Matrix (m, l) that maps the controller's l inputs to the m inputs of the model."""
        inputs = self.regulated.model.inputs
        return np.array(
            [[float(name == moved) for moved in self.controller.inputs] for name in inputs]
        )

    @cached_property
    def _table(self) -> MatrixTables:
        stacks = [getattr(self.controller, name) for name in _MATRICES]
        return MatrixTables(self.controller.breakpoints, stacks)


class MatrixTables:
    """Several tables of matrices (N, rows, columns), interpolated linearly between breakpoints.

    All tables are one CasADi function. Expressions call this function instead of including its
    terms.
    """

    def __init__(self, breakpoints: np.ndarray, stacks: Sequence[np.ndarray]) -> None:
        self._shapes = [stack.shape[1:] for stack in stacks]
        flat = np.hstack([stack.transpose(0, 2, 1).reshape(len(stack), -1) for stack in stacks])
        eta = ca.SX.sym("eta")
        values = ca.densify(table_expression(LinearTable(breakpoints, flat), eta))
        self._function = ca.Function("table", [eta], [values], {"never_inline": True})

    def at(self, eta: ca.SX) -> tuple[ca.SX, ...]:
        """Return the interpolated matrix of each table at the scheduling value `eta`."""
        ends = np.cumsum([0, *(rows * columns for rows, columns in self._shapes)]).tolist()
        parts = ca.vertsplit(self._function(eta), ends)
        return tuple(
            ca.reshape(part, *shape) for part, shape in zip(parts, self._shapes, strict=True)
        )


@checks_arguments
def servo_policy(
    controller: ScheduledController, commands: CommandSteps, model: Model, point: OperatingPoint
) -> ServoPolicy:
    """Return the policy of a controller about a trim of its model, with commands.

    `fastest` of the policy is the magnitude of the fastest eigenvalue of A, or 0 for a gain without
    memory.

    Raises BadInputError if the controller was made for another model or does not accept a command.
    Raises BadInputError also if a controller with several breakpoints does not cover the scheduling
    variable at the trim and in the commands.
    """
    followed = [name.removesuffix(COMMAND_SIGNALS[0]) for name in controller.commands]
    for name in commands.names:
        refuse_unknown(f"controller {controller.name} cannot follow a command of", name, followed)
    start = point.values[model.schedule]
    commanded = commands.values[:, np.array(commands.names) == model.schedule]
    reached = np.append(start + commanded, start)
    if len(controller.breakpoints) == 1:  # without a schedule it applies to all values
        reached = controller.breakpoints
    controller.refuse_other(model, float(reached.min()), float(reached.max()))
    identity = {
        "controller": {name: getattr(controller, name) for name in ("breakpoints", *_MATRICES)},
        "commands": {
            "names": list(commands.names),
            "times": commands.times,
            "values": commands.values,
            "filter": [commands.bandwidth, commands.damping],
        },
    }
    return ServoPolicy(
        controller.name,
        start=np.zeros(len(controller.states)),
        identity=identity,
        fastest=float(np.abs(np.linalg.eigvals(controller.A)).max(initial=0.0)),
        controller=controller,
        commands=commands,
        outputs=MeasuredOutputs(model, point, controller.measurements),
        regulated=MeasuredOutputs(model, point, commands.names),
        scheduled_at=start,
    )
