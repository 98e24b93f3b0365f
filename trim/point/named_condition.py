"""A flight condition for every dihedral angle: what a trim or a sweep imposes, leaves free and limits."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from hfa_model.support.errors import BadInputError
from trim.point.condition import TrimCondition, level_flight, release


@dataclass(frozen=True)
class NamedCondition:
    """The paper's level flight with changes.

    name: of the condition or its file. imposed: variable -> (dihedral angles, values), linear between the angles;
    one value for a constant. free: variables that the solver finds. limits: variable -> (lowest, highest). rates:
    state -> imposed rate, None for steady flight. Rad, ft/s, ft.
    """

    name: str
    imposed: Mapping[str, tuple[tuple[float, ...], tuple[float, ...]]] = field(default_factory=dict)
    free: tuple[str, ...] = ()
    limits: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    rates: Mapping[str, float] | None = None

    @classmethod
    def of(cls, condition: TrimCondition) -> NamedCondition:
        """A single condition, the same at every dihedral angle."""
        constants = _constants(condition.imposed)
        return cls("of a trim", constants, condition.free, dict(condition.limits), dict(condition.rates))

    def changed(
        self,
        *,
        free: tuple[str, ...] = (),
        hold: Mapping[str, float] | None = None,
        limits: Mapping[str, tuple[float, float]] | None = None,
    ) -> NamedCondition:
        """The same with changes as by `release`."""
        hold = dict(hold or {})
        kept = {name: value for name, value in self.imposed.items() if name not in (*free, *hold)}
        freed = dict.fromkeys((*(name for name in self.free if name not in hold), *free))
        limits = {**self.limits, **(limits or {})}
        return replace(self, imposed=kept | _constants(hold), free=tuple(freed), limits=limits)

    def at(self, dihedral: float, hold: Mapping[str, float] | None = None) -> TrimCondition:
        """The condition at a dihedral angle, rad, with the values of `hold` imposed.

        BadInputError outside the angles of a table, or where a value lies outside its limits.
        """
        hold = dict(hold or {})
        imposed = {name: float(self.value(name, dihedral)) for name in self.imposed if name not in hold}
        freed = tuple(name for name in self.free if name not in hold)
        condition = release(level_flight(dihedral), free=freed, hold=imposed | hold, limits=self.limits)
        return condition if self.rates is None else replace(condition, rates=self.rates)

    def value(self, name: str, dihedral: float | np.ndarray) -> np.ndarray:
        """What is imposed on a variable at one dihedral angle or at many, rad."""
        angles, values = self.imposed[name]
        if len(values) == 1:
            return np.full(np.shape(dihedral), values[0])
        asked = np.atleast_1d(dihedral)
        outside = asked[(asked < angles[0] - 1e-12) | (asked > angles[-1] + 1e-12)]
        if outside.size:
            raise BadInputError(
                f"condition {self.name}: {name} is given from {math.degrees(angles[0]):g} to "
                f"{math.degrees(angles[-1]):g} deg of dihedral; {math.degrees(outside[0]):g} deg lies outside"
            )
        return np.asarray(np.interp(dihedral, angles, values))

    def to_dict(self) -> dict[str, Any]:
        """What it changes of the paper's level flight, as JSON data; equal for two that ask for the same."""
        changes: dict[str, Any] = {
            "imposed": {
                name: values[0] if len(values) == 1 else [list(row) for row in zip(angles, values, strict=True)]
                for name, (angles, values) in self.imposed.items()
            },
            "free": list(self.free),
            "limits": {name: list(limits) for name, limits in self.limits.items()},
            "rates": dict(self.rates or {}),
        }
        return {name: change for name, change in changes.items() if change}


#: The paper's level flight as it is.
LEVEL_FLIGHT = NamedCondition("the paper's")


def _constants(values: Mapping[str, float]) -> dict[str, tuple[tuple[float, ...], tuple[float, ...]]]:
    return {name: ((), (value,)) for name, value in values.items()}
