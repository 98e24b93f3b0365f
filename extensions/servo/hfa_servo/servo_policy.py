"""Policy of a flight that applies a scheduled controller at the measured scheduling variable."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import casadi as ca
import numpy as np

from controller.schedule.scheduled_controller import COMMAND_SIGNALS, ScheduledController
from hfa_aircraft.model import Model
from hfa_flight.flight_history import Deviations
from hfa_flight.policies import Measurements, Policy
from hfa_flight.signals import CommandSteps
from hfa_flight.table_expression import table_expression
from hfa_servo.measured_outputs import MeasuredOutputs
from hfa_servo.tracked import tracked
from hfa_support.errors import refuse_unknown
from hfa_support.linear_table import LinearTable
from trim.point.operating_point import OperatingPoint

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
        values = dict(
            zip(
                COMMAND_SIGNALS,
                (self.commands.at(t), self.commands.rate(t), self.commands.end(t)),
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
        """Matrix of zeros and ones that maps the controller's l inputs to the m inputs of the
        model, (m, l).
        """
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
