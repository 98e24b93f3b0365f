"""What a trim imposes and what it leaves free: a condition on states, inputs, outputs and rates."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any

import numpy as np

from hfa_model.aircraft import HFA
from hfa_support.errors import BadInputError, is_finite, pair_of, refuse_unknown, shown
from hfa_support.linear_table import LinearTable
from hfa_support.model import Model
from hfa_support.reporting.text import shown_value


@dataclass(frozen=True)
class TrimCondition:
    """f(X, U) = rates, y(X, U) = values, with some of X, U and y imposed and the other X, U free within limits.

    imposed: variable or output -> value. tables: likewise -> its values over the scheduling variable (of the HFA the
    dihedral angle, rad); `at` makes numbers of them. rates: state -> imposed value of its rate; zero for the steady
    ones of the model unless given. A rate that is left out is not balanced. `at` and `release` take a rate by the name
    of its state with _dot behind it. limits: name -> (lowest, highest); the
    model's for what is not named. begin: variable -> where the search for it begins. name: of a condition from a file.
    model: whose names these are. Internal units and radians. BadInputError when a name is unknown, a value is not
    finite or lies outside its limits, or a variable is named twice.
    """

    imposed: Mapping[str, float]
    rates: Mapping[str, float] | None = None
    limits: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    begin: Mapping[str, float] = field(default_factory=dict)
    tables: Mapping[str, LinearTable] = field(default_factory=dict)
    name: str = field(default="", compare=False)
    model: Model = field(default=HFA, compare=False)

    def __post_init__(self) -> None:
        """Check everything before anything is solved."""
        model = self.model
        if self.rates is None:
            object.__setattr__(self, "rates", dict.fromkeys(model.steady, 0.0))
        held: dict[str, Any] = {**self.imposed, **self.tables}
        for names, known in ((held, model.holdable), (self.limits, model.limits)):
            for name in names:
                refuse_unknown("unknown trim variable", name, known)
        for name in self.tables:
            if name in self.imposed:
                raise BadInputError(f"{name} is imposed twice; name it once")
        if not self.rates:
            raise BadInputError("no rate is imposed; name at least one of " + ", ".join(model.states))
        for name, value in self.rates.items():
            refuse_unknown("unknown rate", name, model.states)
            _refuse_infinite(f"the rate of {name}", value)
        for name, ends in self.limits.items():
            lowest, highest = pair_of(f"limits of {name}", ends)
            if not lowest < highest:
                raise BadInputError(
                    f"limits of {name} are {model.describe(name, lowest)} to {model.describe(name, highest)}; "
                    "the first must be the lower one"
                )
        for name, value in held.items():
            for each in value.values.tolist() if isinstance(value, LinearTable) else [value]:
                _refuse_infinite(name, each)
                lowest, highest = self.limits_of(name)
                if not lowest <= each <= highest:
                    raise BadInputError(
                        f"{name} is {model.describe(name, each)}; it must lie between {model.describe(name, lowest)} "
                        f"and {model.describe(name, highest)}"
                    )

    @property
    def free(self) -> tuple[str, ...]:
        """The unknowns: every variable that is not imposed."""
        return tuple(name for name in self.model.variables if name not in self.imposed and name not in self.tables)

    @property
    def equations(self) -> tuple[tuple[str, ...], tuple[str, ...]]:
        """The states whose rates are imposed, and the imposed outputs that are no variables."""
        outputs = [name for name in (*self.imposed, *self.tables) if name not in self.model.variables]
        return tuple(name for name in self.model.states if name in (self.rates or {})), tuple(outputs)

    def at(self, scheduled: float | None = None, hold: Mapping[str, float] | None = None) -> TrimCondition:
        """The condition in numbers at a value of the scheduling variable, of the HFA the dihedral angle, rad (None for
        its own), with the values of `hold` imposed.

        Where it is free the search begins there. BadInputError outside the places of a table, or where a value lies
        outside its limits.
        """
        by = self.model.schedule
        place = self.imposed.get(by, self.begin.get(by, 0.0)) if scheduled is None else scheduled
        own = {by: place} if by in self.imposed else {}
        values = {name: float(self.values_at(name, place)) for name in self.tables}
        own |= hold or {}
        rates = {
            **(self.rates or {}),
            **{name.removesuffix("_dot"): own.pop(name) for name in self.model.rates if name in own},
        }
        imposed = {**self.imposed, **values, **own}
        begin = {**self.begin, by: place} if by in self.model.variables and by not in imposed else self.begin
        return replace(self, imposed=imposed, rates=rates, begin=begin, tables={})

    def values_at(self, name: str, scheduled: float | np.ndarray) -> np.ndarray:
        """What is imposed on a variable at one value of the scheduling variable or at many."""
        table = self.tables.get(name)
        if table is None:
            return np.full(np.shape(scheduled), self.imposed[name])
        asked, (first, last) = np.atleast_1d(scheduled), table.places[[0, -1]]
        outside = asked[(asked < first - 1e-12) | (asked > last + 1e-12)]
        if outside.size:
            by = self.model.schedule
            said = partial(shown_value, unit=self.model.unit(by))
            end, asked_for = (self.model.describe(by, each) for each in (last, outside[0]))
            raise BadInputError(
                f"condition {self.name}: {name} is given from {said(first)} to {end} of {by}; {asked_for} lies outside"
            )
        return table.at(scheduled)

    def to_dict(self) -> dict[str, Any]:
        """How it differs from the model's own trim, as JSON data; tables as [place, value] rows."""
        imposed = {name: value for name, value in self.imposed.items() if self.model.trim.get(name) != value}
        tables = {name: np.column_stack([each.places, each.values]).tolist() for name, each in self.tables.items()}
        rates, usual = dict(self.rates or {}), self.model.trim
        begin = {
            name: self.begin[name] for name in self.free if self.begin.get(name, usual.get(name)) != usual.get(name)
        }
        changes: dict[str, Any] = {
            "imposed": {**imposed, **tables},
            "free": [name for name in usual if name not in self.imposed and name not in self.tables],
            "limits": {name: list(limits) for name, limits in self.limits.items()},
            "begin": begin,
            "rates": {} if rates == dict.fromkeys(self.model.steady, 0.0) else rates,
        }
        return {name: change for name, change in changes.items() if change}

    def in_words(self) -> str:
        """The same for people: speed 60 ft/s, alpha free, throttle within 0 and 50; empty for the model's own trim."""
        changes, describe = self.to_dict(), self.model.describe
        words = [
            f"{name} {f'over the {self.model.schedule}' if isinstance(value, list) else describe(name, value)}"
            for name, value in changes.get("imposed", {}).items()
        ]
        words += [f"{name} free" for name in changes.get("free", ())]
        usual, rates = dict.fromkeys(self.model.steady, 0.0), self.rates or {}
        changed = {f"{name}_dot": rate for name, rate in rates.items() if usual.get(name) != rate}
        words += [f"{name} {describe(name, rate)}" for name, rate in changed.items()]
        words += [f"{name}_dot free" for name in usual if name not in rates]
        words += [
            f"{name} within {describe(name, low)} and {describe(name, high)}"
            for name, (low, high) in changes.get("limits", {}).items()
        ]
        return ", ".join(words)

    def limits_of(self, name: str) -> tuple[float, float]:
        """Lowest and highest value of a variable, a state or an output."""
        return self.limits.get(name, self.model.limits[name])


def _refuse_infinite(name: str, value: object) -> None:
    if not is_finite(value):
        raise BadInputError(f"{name} is {shown(value)}; give a finite number")


def usual_condition(model: Model) -> TrimCondition:
    """What a model's declaration imposes."""
    return TrimCondition(model.trim, model=model)


#: The paper's (Section 5.1), with a flat wing: `at` takes another dihedral angle.
LEVEL_FLIGHT = usual_condition(HFA)


def level_flight(
    dihedral: float, *, limits: Mapping[str, tuple[float, float]] | None = None, **held: float
) -> TrimCondition:
    """The paper's trim at a dihedral angle, rad: center aileron at zero; throttle, outer aileron and both elevators
    free. Four equations, four unknowns. held: what is imposed in place of the paper's values, in rad, ft, s."""
    return TrimCondition({**HFA.trim, HFA.schedule: dihedral, **held}, limits=dict(limits or {}))


def release(
    condition: TrimCondition,
    *,
    free: tuple[str, ...] = (),
    hold: Mapping[str, float | LinearTable] | None = None,
    limits: Mapping[str, tuple[float, float]] | None = None,
) -> TrimCondition:
    """The same condition with the named variables set free, others held at the given values, and further limits.

    The search for a variable set free begins at the value that it was held at. A rate (speed_dot) set free is not
    balanced.
    """
    hold = dict(hold or {})
    for name in (*free, *hold):
        condition.model.refuse_unheld("unknown trim variable", name)
    both = sorted(set(free) & set(hold))
    if both:
        raise BadInputError(f"{both[0]} is both set free and held; name it once")
    rates: dict[str, Any] = dict(condition.rates or {})
    for name in condition.model.rates:
        state = name.removesuffix("_dot")
        if name in free:
            rates.pop(state, None)
        elif name in hold:
            rates[state] = hold.pop(name)
    for state, rate in rates.items():
        if isinstance(rate, LinearTable):
            raise BadInputError(f"{state}_dot is given over {condition.model.schedule}; give one number")
    tables = {**condition.tables, **{name: each for name, each in hold.items() if isinstance(each, LinearTable)}}
    values = {**condition.imposed, **{name: each for name, each in hold.items() if not isinstance(each, LinearTable)}}
    held_at = values | {name: float(table.values[0]) for name, table in tables.items()}
    return replace(
        condition,
        rates=rates,
        imposed={name: each for name, each in values.items() if name not in free and hold.get(name, each) is each},
        tables={name: each for name, each in tables.items() if name not in free and hold.get(name, each) is each},
        limits={**condition.limits, **(limits or {})},
        begin={**condition.begin, **{name: held_at[name] for name in free if name in held_at}},
    )
