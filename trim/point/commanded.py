"""Trims at commanded values: what a constant command would need of the inputs."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from hfa_aircraft.model import Model
from hfa_support.errors import BadInputError
from hfa_support.reporting.results import Result, without_empty
from trim.point.condition import release
from trim.point.operating_point import OperatingPoint
from trim.point.solve import TrimError, trim

#: Difference from a commanded pitch, rad, at which the search for its gamma stops, and the most
#: trims that are tried.
_SAME_PITCH = 1e-9
_MOST_PITCHES = 12


@dataclass(frozen=True, eq=False)
class CommandedTrim(Result):
    """Trim at commanded values, found beyond the limits of the free variables if necessary.

    command: state -> commanded deviation from the trim
    needed: free variable -> value at which the equations balance; empty if none was found
    beyond: free variable outside its limits -> the limit that it exceeds
    model: model of the aircraft
    reason: why no values were found, or ""
    unheld: commanded state that is no variable of a trim, or ""
    """

    command: Mapping[str, float]
    needed: Mapping[str, float]
    beyond: Mapping[str, float]
    model: Model
    reason: str = ""
    unheld: str = ""

    @property
    def is_reachable(self) -> bool | None:
        """Whether the aircraft has a trim at the command, within all limits; None if unknown."""
        return None if self.unheld else not (self.beyond or self.reason)

    def excess(self, name: str) -> float:
        """Return by how much a free variable exceeds its limit, relative to its range, or the
        excess itself for a variable without two limits.
        """
        lowest, highest = self.model.limits[name]
        span = highest - lowest
        limit = self.beyond[name]
        excess = abs(self.needed[name] - limit)
        return excess / span if math.isfinite(span) else excess

    def _entries(self) -> dict[str, Any]:
        """Return the entries of the file, name -> value."""
        return {
            "command": self.command,
            "needed": self.needed,
            "beyond": self.beyond,
            "reason": self.reason,
        } | without_empty(unheld=self.unheld or None)


def commanded_trim(point: OperatingPoint, command: Mapping[str, float]) -> CommandedTrim:
    """Return the trim in which some states are held away from their trim values.

    The other conditions are those of the trim. The free variables have no limits in this search, so
    that what the command would need is found.

    point: the trim; its problem is known
    command: state -> deviation from the trim, in the units of the model
    """
    holdable = point.model.holdable
    for name in command:
        is_held_by_gamma = name == "pitch" and "gamma" in holdable
        if name not in holdable and not is_held_by_gamma:
            return CommandedTrim(command, {}, {}, point.model, unheld=name)
    try:
        found = _trim_without_limits(point, command)
    except (TrimError, BadInputError) as error:
        return CommandedTrim(command, {}, {}, point.model, str(error))
    needed = {name: found[name] for name in found.trim_problem.asked.free}
    beyond = {}
    for name, value in needed.items():
        lowest, highest = point.trim_problem.asked.limits_of(name)
        if value < lowest:
            beyond[name] = lowest
        elif value > highest:
            beyond[name] = highest
    return CommandedTrim(command, needed, beyond, point.model)


def _trim_without_limits(point: OperatingPoint, command: Mapping[str, float]) -> OperatingPoint:
    """Return the trim at a command, whose free variables may exceed their limits.

    A pitch that the model does not hold is reached by changes of gamma.

    command: state -> deviation from the trim `point`

    Raises TrimError or BadInputError if no trim is found.
    """
    held = {name: point[name] + deviation for name, deviation in command.items()}
    commanded_pitch = None
    if "pitch" in held and "pitch" not in point.model.holdable:
        commanded_pitch = held.pop("pitch")
        held["gamma"] = point["gamma"] + command["pitch"] - command.get("alpha", 0.0)
    for _ in range(_MOST_PITCHES):
        condition = release(point.trim_problem.asked, hold=held)
        unlimited = release(condition, limits=dict.fromkeys(condition.free, (-math.inf, math.inf)))
        found = trim(point.model, unlimited, point)
        error = 0.0 if commanded_pitch is None else commanded_pitch - found["pitch"]
        if abs(error) <= _SAME_PITCH:
            return found
        held["gamma"] += error
    raise TrimError("no trim: no gamma has the commanded pitch", found)
