"""Scheduled gains in flight, with the trims of the commanded scheduling variable as reference."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Self

import casadi as ca
import numpy as np

from hfa_aircraft.model import Model
from hfa_aircraft.rigid.tables import Interpolator, lines_of_cells
from hfa_flight.air.scenario import Scenario
from hfa_flight.air.signals import BANDWIDTH, DAMPING, CommandSteps
from hfa_flight.policies.policy import Measurements, Policy
from hfa_flight.schedule.gain_schedule import GainSchedule
from hfa_support.errors import BadInputError
from hfa_support.matrices import LinearTable
from hfa_support.reporting.results import Result
from trim.point.condition import TrimCondition
from trim.point.operating_point import OperatingPoint
from trim.point.solve import trim


def table_expression(table: LinearTable, where: ca.SX) -> ca.SX:
    """Return the value of a table at an argument, as a CasADi column (k,).

    The value of the table is an array with k entries. The column contains them row by row.

    where: argument of the table, one expression
    """
    points = table.breakpoints
    rows = table.values.reshape(len(points), -1)
    if len(points) == 1:
        return ca.SX(ca.DM(rows[0]))
    # In the cell between two breakpoints the value is level + slope * offset; `chosen` is 1 for the
    # cell of the argument, and 0 for others.
    levels, slopes = lines_of_cells(rows, points)
    chosen, offset = Interpolator().cell(ca.SX(where), points)
    return ca.mtimes(ca.DM(levels).T, chosen) + offset * ca.mtimes(ca.DM(slopes).T, chosen)


def gain_at(schedule: GainSchedule, where: ca.SX) -> ca.SX:
    """Return the gain K of a schedule at a value of its scheduling variable, (m, n)."""
    model = schedule.model
    rows = table_expression(schedule.table, where)
    return ca.reshape(rows, len(model.linear), len(model.inputs)).T


#: Number of trims along a command, with linear interpolation between them.
_TRIMS = 41


@dataclass(frozen=True, eq=False)
class TrimPath(Result):
    """Trims at the commanded scheduling variable r(t), as the reference of a flight.

    The reference is x_d(t) = X0(r(t)) - X_base, with the inputs U0(r(t)) - U_base.

    base: initial trim of the flight, X_base and U_base
    states: X0 over the scheduling variable, linear between trims
    inputs: U0 over the scheduling variable, linear between trims
    commands: r as a deviation from its value at `base`
    """

    base: OperatingPoint
    states: LinearTable
    inputs: LinearTable
    commands: CommandSteps

    @property
    def size(self) -> int:
        """Number of states of the linear model."""
        return len(self.base.model.linear)

    @property
    def until(self) -> float:
        """Time of the last step, s."""
        return float(self.commands.times[-1])

    def commanded(self, t: ca.SX) -> ca.SX:
        """Return the commanded value of the scheduling variable, r(t), absolute."""
        return self.base.values[self.base.model.schedule] + self.commands.at(t)

    def at(self, t: Any) -> ca.SX:
        """Return the reference x_d(t) of the states of the linear model, (k,).

        The entry for the rate of the scheduling variable, a state named NAME_rate, is r'(t).
        """
        model = self.base.model
        deviation = table_expression(self.states, self.commanded(t)) - ca.DM(self.base.x)
        rows = dict(zip(model.states, ca.vertsplit(deviation), strict=True))
        rows[f"{model.schedule}_rate"] = self.commands.rate(t)
        return ca.vertcat(*(rows[name] for name in model.linear))

    def inputs_at(self, t: Any) -> ca.SX:
        """Return the inputs of the reference, U0(r(t)) - U_base, (m,)."""
        return table_expression(self.inputs, self.commanded(t)) - ca.DM(self.base.u)

    @property
    def breaks(self) -> np.ndarray:
        """Times of the steps of the commands, s."""
        return self.commands.times

    def _entries(self) -> dict[str, Any]:
        """Return the entries of the file, name -> value."""
        return {
            "names": self.commands.names,
            "values": self.commands.values,
            "times": self.commands.times,
            "filter": (BANDWIDTH, DAMPING),
        }


@dataclass(frozen=True, eq=False, repr=False)
class ScheduledGainPolicy(Policy):
    """Policy u = U0(r(t)) - U_base - K(η) z with scheduled gains.

    r is the commanded and η the measured scheduling variable. z = x - x_d is the deviation from the
    reference of `path`. U0 depends on r and not on η. Therefore the policy is u = -K z if
    linearized about a trim, with the K of that trim.

    schedule: K(η)
    path: trims at the commanded scheduling variable
    """

    schedule: GainSchedule
    path: TrimPath

    def control(self, t: ca.SX, measurements: Measurements, held: ca.SX) -> ca.SX:
        """Return the commanded inputs U0(r(t)) - U_base - K(η) z, (m,)."""
        model = self.schedule.model
        row = model.linear.index(model.schedule)
        measured = self.path.base.values[model.schedule] + measurements.states[row]
        return self.path.inputs_at(t) - gain_at(self.schedule, measured) @ measurements.error

    def in_scenario(self, scenario: Scenario) -> tuple[Self, Scenario]:
        """Return the policy, and the scenario with the trims along the commands as reference.

        Raises BadInputError if the scenario has another reference.
        """
        return self, scenario.following(self.path, self.name)

    def data(self, model: Model) -> dict[str, Any]:
        """Return the JSON data on the policy: name, units of the states, breakpoints and gains."""
        return {
            "name": self.name,
            "state_units": list(model.units(model.linear)),
            model.schedule_key: self.schedule.file_breakpoints,
            "K": self.schedule.gains,
        }


def refuse_unscheduled(model: Model) -> None:
    """Raise BadInputError unless a model is scheduled over a state of its linear model."""
    if model.schedule not in model.linear:
        raise BadInputError(
            f"the scheduling variable of {model.name} is {model.schedule or 'not declared'}; "
            "declare a state of the linear model as the scheduling variable"
        )


def scheduled_gains(
    name: str,
    schedule: GainSchedule,
    base: OperatingPoint,
    condition: Callable[[float], TrimCondition],
    commands: CommandSteps | None = None,
) -> ScheduledGainPolicy:
    """Return the policy of a gain schedule that follows commands of the scheduling variable.

    name: name of the policy
    base: initial trim of the flight
    condition: function from the scheduling variable to its trim condition
    commands: steps of the scheduling variable, as deviations from `base`. If None or empty, the
        variable remains constant

    Raises BadInputError if the model is not scheduled over a state of its linear model, another
    variable is commanded, or the gains do not cover the commands.
    Raises NoSolutionError if a trim does not exist.
    """
    model = schedule.model
    refuse_unscheduled(model)
    for commanded in commands.names if commands is not None else ():
        if commanded != model.schedule:
            raise BadInputError(
                f"a gain schedule follows only commands of {model.schedule}; remove the command "
                f"of {commanded}"
            )
    start = base.values[model.schedule]
    if commands is None or not commands.names:  # a command of 0: the variable is constant
        commands = CommandSteps((model.schedule,), np.zeros(1), np.zeros((1, 1)))

    # Trims along the commands, from the initial one on.
    commanded_values = np.append(start + commands.values, start)
    lowest, highest = float(commanded_values.min()), float(commanded_values.max())
    schedule.refuse_beyond(lowest, highest)
    breakpoints = np.unique(np.linspace(lowest, highest, _TRIMS))  # one, if it is constant
    trims = [trim(model, condition(value)) for value in breakpoints.tolist()]
    path = TrimPath(
        base,
        LinearTable(breakpoints, np.array([point.states for point in trims])),
        LinearTable(breakpoints, np.array([point.inputs for point in trims])),
        commands,
    )
    return ScheduledGainPolicy(name, schedule, path)
