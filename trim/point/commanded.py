"""Trims at commanded values: what a constant command would need of the inputs."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

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
    assert point.found_by is not None  # required by the docstring
    for name in command:
        if name not in point.model.holdable and not _is_held_by_gamma(point.model, name):
            return CommandedTrim(command, {}, {}, point.model, unheld=name)
    try:
        found, limits = _trim_without_limits(point, command)
    except (TrimError, BadInputError) as error:
        return CommandedTrim(command, {}, {}, point.model, str(error))
    needed = {name: found[name] for name in limits}
    beyond = {}
    for name, (lowest, highest) in limits.items():
        if needed[name] < lowest:
            beyond[name] = lowest
        elif needed[name] > highest:
            beyond[name] = highest
    return CommandedTrim(command, needed, beyond, point.model)


def _is_held_by_gamma(model: Model, name: str) -> bool:
    """Return whether a state is the pitch of a model whose trims hold gamma in its place."""
    return name == "pitch" and "pitch" not in model.holdable and "gamma" in model.holdable


class _UnlimitedTrim(NamedTuple):
    """Trim found without limits of its free variables, and the limits that they have."""

    point: OperatingPoint
    limits: dict[str, tuple[float, float]]


def _trim_without_limits(point: OperatingPoint, command: Mapping[str, float]) -> _UnlimitedTrim:
    """Return the trim at a command, whose free variables may exceed their limits.

    A pitch that the model does not hold is reached by changes of gamma.

    command: state -> deviation from the trim `point`

    Raises TrimError or BadInputError if no trim is found.
    """
    assert point.found_by is not None  # required by the caller
    held = {name: point[name] + deviation for name, deviation in command.items()}
    commanded_pitch = None
    if "pitch" in held and _is_held_by_gamma(point.model, "pitch"):
        commanded_pitch = held.pop("pitch")
        held["gamma"] = point["gamma"] + command["pitch"] - command.get("alpha", 0.0)
    for _ in range(_MOST_PITCHES):
        condition = release(point.found_by.asked, hold=held)
        limits = {name: condition.limits_of(name) for name in condition.free}
        unlimited = release(condition, limits=dict.fromkeys(limits, (-math.inf, math.inf)))
        found = trim(point.model, unlimited, point)
        error = 0.0 if commanded_pitch is None else commanded_pitch - found["pitch"]
        if abs(error) <= _SAME_PITCH:
            return _UnlimitedTrim(found, limits)
        held["gamma"] += error
    raise TrimError("no trim: no gamma has the commanded pitch", found)
