"""What a trim imposes and what it leaves free: a condition on states, inputs, outputs and rates,
also from a file."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from types import MappingProxyType
from typing import Any

import numpy as np

from hfa_aircraft.model import Model
from hfa_support.errors import BadInputError, is_finite, pair_of, refuse_unknown, said_of, shown
from hfa_support.linear_table import LinearTable
from hfa_support.schema import NUMBER, checked, read_named
from trim.limits import Limits

#: What a file of a condition holds.
_FILE = {
    "description": str,
    "source": str,
    "impose": {str: None},
    "free": [str],
    "limits": {str: [NUMBER]},
}


@dataclass(frozen=True)
class TrimCondition:
    """f(X, U) = rates, y(X, U) = values, with some of X, U and y imposed and the other X, U free
    within limits.

    imposed: variable or output -> value, or its values over the scheduling variable (of the HFA the
    dihedral angle, rad), of which `at` makes numbers. rates: state -> imposed value of its rate;
    zero for the steady ones of the model unless given. A rate that is left out is not balanced.
    `at` and `release` take a rate by the name of its state with _dot behind it. limits: name ->
    (lowest, highest); the model's for what is not named. begin: variable -> where the search for it
    begins. name: of a condition from a file. model: whose names these are. Internal units and
    radians. BadInputError when a name is unknown, or a value is not finite or lies outside its
    limits."""

    model: Model = field(compare=False)
    imposed: Mapping[str, Any]
    rates: Mapping[str, float] = None  # type: ignore[assignment]  # replaced below
    limits: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    begin: Mapping[str, float] = field(default_factory=dict)
    name: str = field(default="", compare=False)

    def __post_init__(self) -> None:
        """Check everything before anything is solved."""
        model, describe = self.model, self.model.describe
        if self.rates is None:
            object.__setattr__(self, "rates", dict.fromkeys(model.steady, 0.0))
        if not self.rates:
            raise BadInputError(
                "no rate is imposed; name at least one of " + ", ".join(model.states)
            )
        for what, names, known in (
            ("rate", self.rates, model.states),
            ("trim variable", self.imposed, model.holdable),
            ("trim variable", self.limits, model.limits),
        ):
            for name in names:
                refuse_unknown(f"unknown {what}", name, known)
        for name, rate in self.rates.items():
            if not is_finite(rate):
                raise BadInputError(f"the rate of {name} is {shown(rate)}; give a finite number")
        for name, ends in self.limits.items():
            lowest, highest = pair_of(f"limits of {name}", ends)
            if not lowest < highest:
                said = f"limits of {name} are {describe(name, lowest)} to {describe(name, highest)}"
                raise BadInputError(f"{said}; the first must be the lower one")
        for name, value in self.imposed.items():
            limits = self.limits_on((name,))
            for number in value.values.tolist() if isinstance(value, LinearTable) else [value]:
                if not is_finite(number):
                    raise BadInputError(f"{name} is {shown(number)}; give a finite number")
                if not limits.within([number])[0]:
                    raise BadInputError(
                        f"{name} is {describe(name, number)}; it must lie between "
                        f"{limits.between(name)}"
                    )

    @property
    def free(self) -> tuple[str, ...]:
        """The unknowns: every variable that is not imposed."""
        return tuple(name for name in self.model.variables if name not in self.imposed)

    @property
    def equations(self) -> tuple[tuple[str, ...], tuple[str, ...]]:
        """The states whose rates are imposed, and the imposed outputs that are no variables."""
        outputs = tuple(name for name in self.imposed if name not in self.model.variables)
        return tuple(name for name in self.model.states if name in self.rates), outputs

    def at(
        self, scheduled: float | None = None, hold: Mapping[str, float] | None = None
    ) -> TrimCondition:
        """The condition in numbers at a value of the scheduling variable, of the HFA the dihedral
        angle, rad (None for its own), with the values of `hold` imposed.

        Where it is free the search begins there. BadInputError outside the places of a table, or
        where a value lies outside its limits."""
        by, model = self.model.schedule, self.model
        place = self.imposed.get(by, self.begin.get(by, 0.0)) if scheduled is None else scheduled
        own, rates = _apart(model, ({by: place} if by in self.imposed else {}) | dict(hold or {}))
        imposed = {name: float(self.values_at(name, place)) for name in self.imposed}
        imposed = without_alternatives(model, imposed, own) | own
        begin = (
            {**self.begin, by: place} if by in model.variables and by not in imposed else self.begin
        )
        return replace(self, imposed=imposed, rates={**self.rates, **rates}, begin=begin)

    def freed_for(self, names: Iterable[str]) -> TrimCondition:
        """The condition where these names will be imposed too: of the model's `alternatives`
        one."""
        return replace(self, imposed=without_alternatives(self.model, self.imposed, names))

    def values_at(self, name: str, scheduled: float | np.ndarray) -> np.ndarray:
        """What is imposed on a variable at one value of the scheduling variable or at many."""
        table = self.imposed[name]
        if not isinstance(table, LinearTable):
            return np.full(np.shape(scheduled), table)
        asked, (first, last) = np.atleast_1d(scheduled), table.places[[0, -1]]
        outside = asked[(asked < first - 1e-12) | (asked > last + 1e-12)]
        if outside.size:
            by, say = self.model.schedule, self.model.describe
            given = f"{name} is given from {say(by, first)} to {say(by, last)} of {by}"
            raise BadInputError(
                f"condition {self.name}: {given}; {say(by, outside[0])} lies outside"
            )
        return table.at(scheduled)

    def to_dict(self) -> dict[str, Any]:
        """How it differs from the model's own trim, as JSON data; tables as [place, value] rows."""
        imposed: dict[str, Any] = {}
        for name, value in self.imposed.items():
            if isinstance(value, LinearTable):
                imposed[name] = np.column_stack([value.places, value.values]).tolist()
            elif self.model.trim.get(name) != value:
                imposed[name] = value
        usual, begun = self.model.trim, self.begin
        changes: dict[str, Any] = {
            "imposed": imposed,
            "free": [name for name in usual if name not in self.imposed],
            "limits": {name: list(limits) for name, limits in self.limits.items()},
            "begin": {
                name: begun[name]
                for name in self.free
                if begun.get(name, usual.get(name)) != usual.get(name)
            },
            "rates": {}
            if self.rates == dict.fromkeys(self.model.steady, 0.0)
            else dict(self.rates),
        }
        return {name: change for name, change in changes.items() if change}

    def in_words(self) -> str:
        """The same for people: speed 60 ft/s, alpha free, throttle within 0 and 50; empty for the
        model's own trim."""
        changes, describe, model = self.to_dict(), self.model.describe, self.model
        changed = {
            f"{name}_dot": rate
            for name, rate in self.rates.items()
            if rate or name not in model.steady
        }
        words = [
            f"{name} {f'over the {model.schedule}' if isinstance(value, list) else describe(name, value)}"
            for name, value in {**changes.get("imposed", {}), **changed}.items()
        ]
        left = [f"{name}_dot" for name in model.steady if name not in self.rates]
        words += [f"{name} free" for name in (*changes.get("free", ()), *left)]
        words += [
            f"{name} within {describe(name, low)} and {describe(name, high)}"
            for name, (low, high) in self.limits.items()
        ]
        return ", ".join(words)

    def limits_on(self, names: Sequence[str]) -> Limits:
        """The limits of these variables, states and outputs."""
        return Limits.of(self.model, names, self.limits)

    def limits_of(self, name: str) -> tuple[float, float]:
        """Lowest and highest value of a variable, a state or an output."""
        return self.limits.get(name, self.model.limits[name])


def usual_condition(model: Model) -> TrimCondition:
    """What a model's declaration imposes."""
    return TrimCondition(model, model.trim)


def release(
    condition: TrimCondition,
    *,
    free: tuple[str, ...] = (),
    hold: Mapping[str, float | LinearTable] | None = None,
    limits: Mapping[str, tuple[float, float]] | None = None,
) -> TrimCondition:
    """The same condition with the named variables set free, others held at the given values, and
    further limits.

    The search for a variable set free begins at the value that it was held at. A rate (speed_dot)
    set free is not balanced."""
    model, hold = condition.model, hold or {}
    for name in (*free, *hold):
        model.refuse_unheld("unknown trim variable", name)
    if both := sorted(set(free) & set(hold)):
        raise BadInputError(f"{both[0]} is both set free and held; name it once")
    own, held_rates = _apart(model, hold)
    rates = {
        name: rate for name, rate in condition.rates.items() if f"{name}_dot" not in free
    } | held_rates
    values = {**without_alternatives(model, condition.imposed, own), **own}
    begin = {name: values.pop(name) for name in free if name in values}
    begin = {
        name: float(v.values[0]) if isinstance(v, LinearTable) else v for name, v in begin.items()
    }
    limits, begin = {**condition.limits, **(limits or {})}, {**condition.begin, **begin}
    return replace(condition, rates=rates, imposed=values, limits=limits, begin=begin)


def without_alternatives(
    model: Model, imposed: Mapping[str, Any], names: Iterable[str]
) -> dict[str, Any]:
    """What stays imposed when these names are imposed too: of the model's `alternatives` one."""
    released: set[str] = set()
    for group in model.alternatives:
        if not set(group).isdisjoint(names):
            released |= set(group).difference(names)
    return {name: value for name, value in imposed.items() if name not in released}


def _apart(model: Model, held: Mapping[str, Any]) -> tuple[dict[str, Any], dict[str, Any]]:
    """The held values of variables and outputs, and those of rates, by state."""
    rates = {
        name.removesuffix("_dot"): value for name, value in held.items() if name in model.rates
    }
    return {name: value for name, value in held.items() if name not in model.rates}, rates


def read_condition(
    name: str, usual: TrimCondition, shipped: Mapping[str, str] = MappingProxyType({})
) -> TrimCondition:
    """A condition from a file; it changes the usual one.

    name: of the user's file, or of a shipped one.
    usual: what the file changes.
    shipped: name -> file in `trim.hfa`, the conditions that come with the paper's aircraft.

    [impose]: variable = value, or variable = [[dihedral, value], ...]; angles in degrees under the
    variable's name with _deg behind it (alpha_deg), in rad without. free: list of variables.
    [limits]: variable = [lowest, highest], likewise. BadInputError names the file, the entry and
    the fault."""
    data, model = read_named("condition", name, shipped, "trim.hfa", _FILE), usual.model

    def variable(key: str, *also: str) -> tuple[str, float]:
        """The variable that a key names, and the factor from its unit."""
        found = key.removesuffix("_deg")
        model.refuse_unheld(f"{name}: unknown trim variable", found, also)
        if found != key and not model.unit(found).startswith("rad"):
            raise BadInputError(f"{name}: {key} is no angle; write {found}, in {model.unit(found)}")
        return found, 1.0 if found == key else math.pi / 180.0

    hold: dict[str, Any] = {}
    for key, value in data.get("impose", {}).items():
        found, factor = variable(key)
        if isinstance(value, list):
            rows = checked(name, value, [[NUMBER]], key)
            if not rows or any(len(row) != 2 for row in rows):
                raise BadInputError(
                    f"{name}: {key} is {shown(value)}; give [{model.schedule}, value] rows"
                )
            places, values = np.array(rows).T
            with said_of(f"{name}: {key}"):
                by_angle = model.schedule and model.unit(model.schedule).startswith("rad")
                hold[found] = LinearTable(
                    np.radians(places) if by_angle else places, values * factor
                )
        else:
            hold[found] = checked(name, value, NUMBER, key) * factor
    limits: dict[str, Any] = {}
    for key, ends in data.get("limits", {}).items():
        found, factor = variable(key, *model.states)
        limits[found] = tuple(end * factor for end in ends)
    free = tuple(variable(key)[0] for key in data.get("free", []))
    with said_of(name):
        return replace(release(usual, free=free, hold=hold, limits=limits), name=name)
