"""A flight condition for every dihedral angle: what a trim or a sweep imposes, leaves free and limits; its file."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from itertools import pairwise
from typing import Any

import numpy as np

from hfa_model.vectors import UNITS
from hfa_support.errors import BadInputError, refuse_unknown, shown
from hfa_support.files import finite_number, names_of, read_named, table_of
from trim.point.condition import VARIABLES, TrimCondition, level_flight, release

#: Conditions that come with the package: name -> file.
NAMED = {"paper": "paper.toml", "simvfa-64": "simvfa_64.toml", "simvfa-30": "simvfa_30.toml"}
_KEYS = ("description", "source", "impose", "free", "limits")


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


def load_condition(name: str) -> NamedCondition:
    """A condition that comes with the package, by its name in `NAMED`, or one of the user's, by its file.

    [impose]: variable = value, or variable = [[dihedral, value], ...]; angles in degrees under the variable's name
    with _deg behind it (alpha_deg), in rad without. free: list of variables. [limits]: variable = [lowest, highest],
    likewise. BadInputError names the file, the entry and what is wrong with it.
    """
    data = read_named("condition", name, NAMED, "trim.conditions", _KEYS)
    return NamedCondition(
        name=name,
        imposed=dict(_imposed(name, key, value) for key, value in table_of(name, data, "impose").items()),
        free=tuple(_variable(name, key)[0] for key in names_of(name, data, "free")),
        limits=dict(_limits(name, key, value) for key, value in table_of(name, data, "limits").items()),
    )


def _variable(where: str, key: str, also: tuple[str, ...] = ()) -> tuple[str, float]:
    """The variable that a key names, and the factor from its unit."""
    name = key.removesuffix("_deg")
    refuse_unknown(f"{where}: unknown trim variable", name, (*VARIABLES, *also))
    if name == key:
        return name, 1.0
    if not UNITS[name].startswith("rad"):
        raise BadInputError(f"{where}: {key} is no angle; write {name}, in {UNITS[name]}")
    return name, math.pi / 180.0


def _imposed(where: str, key: str, value: Any) -> tuple[str, tuple[tuple[float, ...], tuple[float, ...]]]:
    name, factor = _variable(where, key)
    if not isinstance(value, list):
        return name, ((), (finite_number(where, key, value) * factor,))
    rows = [row if isinstance(row, list) and len(row) == 2 else None for row in value]
    if len(rows) < 2 or None in rows:
        raise BadInputError(f"{where}: {key} is {shown(value)}; give a number or at least two [dihedral, value] rows")
    angles = tuple(finite_number(where, key, row[0]) * math.pi / 180.0 for row in rows if row)
    if any(later <= earlier for earlier, later in pairwise(angles)):
        raise BadInputError(f"{where}: the dihedral angles of {key} do not increase; sort its rows")
    return name, (angles, tuple(finite_number(where, key, row[1]) * factor for row in rows if row))


def _limits(where: str, key: str, value: Any) -> tuple[str, tuple[float, float]]:
    name, factor = _variable(where, key, ("pitch",))
    if not isinstance(value, list) or len(value) != 2:
        raise BadInputError(f"{where}: the limits of {key} are {shown(value)}; give [lowest, highest]")
    lowest, highest = (finite_number(where, key, each) * factor for each in value)
    return name, (lowest, highest)
