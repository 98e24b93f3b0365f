"""How far each variable of a trim is from its limits, and which limits bind."""

from __future__ import annotations

import math
from typing import NamedTuple

from hfa_model.vectors import INPUTS, STATES, UNITS
from trim.point.condition import SCALES, TrimCondition
from trim.point.operating_point import OperatingPoint

#: A variable is at its limit when it is this close to it, in its scaled unit and relative to the limit.
_CLOSE = 1e-6


class Margin(NamedTuple):
    """A variable between its limits, in its own unit: rad, ft, lbf.

    role: "free", "held", or "alpha + gamma" for the pitch angle where one of these is free. A limit that does not
    exist is infinite.
    """

    name: str
    value: float
    role: str
    lowest: float
    highest: float

    @property
    def unit(self) -> str:
        """Unit of value and limits."""
        return UNITS[self.name]

    @property
    def distance(self) -> float:
        """min(value - lowest, highest - value): to the nearer limit; negative beyond it, infinite without one."""
        return min(self.value - self.lowest, self.highest - self.value)

    @property
    def nearer(self) -> str:
        """Which limit the distance is to: "lowest" or "highest"; empty where there is none."""
        if math.isinf(self.distance):
            return ""
        return "lowest" if self.value - self.lowest <= self.highest - self.value else "highest"

    @property
    def nearer_limit(self) -> float:
        """The value of the nearer limit."""
        return self.lowest if self.nearer == "lowest" else self.highest

    @property
    def share(self) -> float:
        """distance / (highest - lowest): 0 at a limit, 0.5 halfway; 0 where the range is infinite."""
        return self.distance / (self.highest - self.lowest)

    @property
    def at_limit(self) -> bool:
        """Whether the variable is at its nearer limit or beyond it."""
        return bool(self.nearer) and self.distance <= _CLOSE * (SCALES[self.name] + abs(self.nearer_limit))

    @property
    def binds(self) -> bool:
        """Whether a limit keeps the variable where it is: one that is held stands where it was put."""
        return self.at_limit and self.role != "held"


def all_margins(condition: TrimCondition, point: OperatingPoint) -> dict[str, Margin]:
    """Every state, input and the flight-path angle, in this order: states, gamma, inputs."""
    role = dict.fromkeys(condition.imposed, "held") | dict.fromkeys(condition.free, "free")
    role["pitch"] = "alpha + gamma" if {"alpha", "gamma"} & set(condition.free) else "held"
    return {
        name: Margin(name, point.values[name], role[name], *condition.limits_of(name))
        for name in (*STATES, "gamma", *INPUTS)
    }


def margins(condition: TrimCondition, point: OperatingPoint) -> dict[str, float]:
    """Input or free variable -> distance to the nearer of its limits, in its own unit; negative beyond the limit.

    The pitch angle is there when alpha or gamma is free. What has no limits has no margin.
    """
    return {each.name: each.distance for each in margins_that_count(condition, point)}


def margins_that_count(condition: TrimCondition, point: OperatingPoint) -> list[Margin]:
    """The limited inputs and free variables: what the trim used up, or could."""
    every = all_margins(condition, point)
    pitch = ("pitch",) if every["pitch"].role != "held" else ()
    names = dict.fromkeys((*INPUTS, *condition.free, *pitch))
    return [every[name] for name in names if every[name].nearer]


def nearest_limits(condition: TrimCondition, point: OperatingPoint) -> list[Margin]:
    """The three margins that are the least share of their range, and all others that are at a limit; least first."""
    ordered = sorted(margins_that_count(condition, point), key=lambda each: each.share)
    return [each for index, each in enumerate(ordered) if index < 3 or each.at_limit]
