"""Trim conditions: imposed and free states, inputs, outputs and rates."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from hfa_aircraft.limits import Limits
from hfa_aircraft.model import Model
from hfa_support.errors import (
    BadInputError,
    is_finite,
    pair_of,
    prefix_errors,
    refuse_unknown,
    shown,
)
from hfa_support.files import NUMBER, checked, read_named
from hfa_support.matrices import LinearTable
from hfa_support.public_arguments import Declared
from hfa_support.reporting.text import shown_values, with_shown_unit
from hfa_support.units import conversion_factor
from trim.point.status import FREE, HELD, LIMIT


@dataclass(frozen=True)
class TrimCondition(Declared):
    """Trim condition: f(X, U) = rates and y(X, U) = values, with free variables within limits.

    Some of X, U and y are imposed. The other X and U are free within limits. All values are in the
    units of the model, angles in radians, or texts with a unit, such as "250 kt". In place of the
    speed of an aircraft with an altitude, kcas, keas, ktas (kt) or mach may be imposed.

    model: model of the aircraft
    imposed: variable or output -> value, or a table of values over the scheduling variable, which
        `at` evaluates
    rates: state -> imposed rate; by default zero for the steady states of the model. A rate that is
        not listed is not balanced.
    limits: name -> (lowest, highest), instead of the model's limits
    begin: variable -> initial value of the search
    freed: variables and parameters that were set free by name: a trim never keeps them at their
        start values
    name: name of a condition from a file

    In `at` and `release`, the name of a rate is the name of its state with the suffix _dot.

    Raises BadInputError if no rate is imposed, a name is unknown, a value is not finite or outside
    its limits, or a lower limit is not below the upper limit.

    >>> import hfa
    >>> from hfa import TrimCondition
    >>> model = hfa.aircraft()
    >>> TrimCondition(model, {**model.trim, "speed": 70.0}).free
    ('throttle', 'aileron_outer', 'elevator_center', 'elevator_outer')
    """

    model: Model = field(compare=False)
    imposed: Mapping[str, Any]
    rates: Mapping[str, float] = None  # type: ignore[assignment]  # replaced below
    limits: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    begin: Mapping[str, float] = field(default_factory=dict)
    freed: tuple[str, ...] = ()
    name: str = field(default="", compare=False)

    def __post_init__(self) -> None:
        """Complete `rates`, convert texts such as "250 kt" to numbers, and check all fields.

        Raises BadInputError for a faulty field.
        """
        model = self.model
        if self.rates is None:
            vars(self)["rates"] = dict.fromkeys(model.steady, 0.0)
        if not self.rates:
            raise BadInputError(
                "no rate is imposed; name at least one of " + ", ".join(model.states)
            )
        for name in self.rates:
            refuse_unknown("unknown rate", name, model.states)
        for names, known in ((self.imposed, model.holdable), (self.limits, model.limits)):
            for name in names:
                refuse_unknown("unknown trim variable", name, known)

        # `imposed` and `rates` as numbers
        numbers = {name: model.number(name, value) for name, value in self.imposed.items()}
        rates = {name: model.number(f"{name}_dot", rate) for name, rate in self.rates.items()}
        vars(self).update(imposed=numbers, rates=rates)

        for name, rate in self.rates.items():
            if not is_finite(rate):
                raise BadInputError(f"the rate of {name} is {shown(rate)}; give a finite number")
        for name, ends in self.limits.items():
            lowest, highest = pair_of(f"limits of {name}", ends)
            if not lowest < highest:
                raise BadInputError(
                    f"the limits of {name} are {model.describe(name, lowest)} and "
                    f"{model.describe(name, highest)}; give two different limits, the lower first"
                )

        # imposed values within their limits
        limits = self.limits_on(tuple(self.imposed))
        for index, (name, value) in enumerate(self.imposed.items()):
            for number in value.values.tolist() if isinstance(value, LinearTable) else [value]:
                if not is_finite(number):
                    raise BadInputError(
                        f"{name} is {shown(number)}; give a finite number"
                        f" in {model.unit(name)} (hfa.sweep accepts lists)"
                    )
                if not limits.least[index] <= number <= limits.most[index]:  # with their tolerance
                    advice = f"give a value between {limits.between(name)}"
                    if limits.assumed[index]:
                        advice += f" (assumed limits; --limit {name}=LOW:HIGH sets others)"
                    raise BadInputError(f"{name} is {model.describe(name, number)}; {advice}")

    @property
    def free(self) -> tuple[str, ...]:
        """Names of the unknowns: all variables that are not imposed."""
        return tuple(name for name in self.model.variables if name not in self.imposed)

    @property
    def set_free(self) -> tuple[str, ...]:
        """Names of the free variables that the user set free: those that the model imposes by
        default, and those that `freed` lists.
        """
        names = dict.fromkeys((*self.model.trim, *self.freed))
        return tuple(name for name in names if name not in self.imposed)

    def at(
        self, scheduled: float | None = None, hold: Mapping[str, float] | None = None
    ) -> TrimCondition:
        """Return the condition at one value of the scheduling variable, with tables replaced by
        numbers.

        scheduled: value, rad for an angle, or None for the condition's own value. If the scheduling
            variable is free, the search begins at this value.
        hold: name -> further imposed value; None for none

        Raises BadInputError outside the breakpoints of a table, and if a value is outside its
        limits.
        """
        schedule = self.model.schedule  # name of the scheduling variable
        held = dict(hold or {})
        if scheduled is None:
            scheduled = self.imposed.get(schedule, self.begin.get(schedule, 0.0))
        elif schedule in self.imposed:
            held = {schedule: scheduled, **held}
        numbers = {
            name: float(
                self.values_at(name, scheduled) if isinstance(value, LinearTable) else value
            )
            for name, value in self.imposed.items()
        }
        begin = self.begin
        if schedule in self.model.variables and schedule not in {**numbers, **held}:
            begin = {**begin, schedule: scheduled}
        return release(replace(self, imposed=numbers, begin=begin), hold=held)

    def freed_for(self, names: Iterable[str]) -> TrimCondition:
        """Return the condition without the values that must not be imposed together with some
        names.

        Only one name of each group in the model's `alternatives`, such as speed and mach, can be
        imposed.

        names: names that will be imposed
        """
        return replace(self, imposed=self.model.without_alternatives(self.imposed, names))

    def values_at(self, name: str, scheduled: float | np.ndarray) -> np.ndarray:
        """Return the value that the condition imposes on a variable, at one or many scheduling
        values.

        name: name of the imposed variable
        scheduled: values of the scheduling variable, a number or an array of any shape

        Raises BadInputError outside the breakpoints of a table.
        """
        table = self.imposed[name]
        if not isinstance(table, LinearTable):
            return np.full(np.shape(scheduled), table)
        by = self.model.schedule  # name of the scheduling variable
        first, last = table.breakpoints[[0, -1]].tolist()
        points = np.atleast_1d(scheduled)
        outside = points[~Limits.of(self.model, (by,), {by: (first, last)}).within(points)]
        if outside.size:
            describe = self.model.describe
            raise BadInputError(
                f"condition {self.name}: {name} is given for {by} from {describe(by, first)} to "
                f"{describe(by, last)}, not at {describe(by, outside[0])}; give {by} in this range"
            )
        return table.at(scheduled)

    @property
    def changes(self) -> dict[str, Any]:
        """Differences of the condition from the trim that the model declares.

        The keys are "imposed", "free", "limits", "begin" and "rates". A key without a difference is
        omitted. Tables are lists of [breakpoint, value] rows.
        """
        usual = self.model.trim
        imposed: dict[str, Any] = {}
        for name, value in self.imposed.items():
            if isinstance(value, LinearTable):
                imposed[name] = np.column_stack([value.breakpoints, value.values]).tolist()
            elif usual.get(name) != value:
                imposed[name] = value
        begin = {
            name: self.begin[name]
            for name in self.free
            if name in self.begin and self.begin[name] != usual.get(name)
        }
        changes: dict[str, Any] = {
            "imposed": imposed,
            "free": [*self.set_free],
            "limits": {name: list(limits) for name, limits in self.limits.items()},
            "begin": begin,
        }
        if self.rates != dict.fromkeys(self.model.steady, 0.0):
            changes["rates"] = dict(self.rates)
        return {name: change for name, change in changes.items() if change}

    def in_words(self) -> str:
        """Return the differences from the trim that the model declares as text: "speed 60 ft/s,
        alpha free".

        The text is "" without differences.
        """
        model, stated = self.model, stated_values(self)
        tables = [name for name, value in self.imposed.items() if isinstance(value, LinearTable)]
        words = [f"{name} over the {model.schedule}" for name in tables]
        words += [f"{name} {model.describe(name, value)}" for name, value in stated.held.items()]
        words += [f"{name} free" for name in stated.free]
        limits = self.limits_on(tuple(self.limits))
        words += [f"{name} within {limits.between(name)}" for name in self.limits]
        return ", ".join(words)

    def limits_on(self, names: Sequence[str]) -> Limits:
        """Return the limits of named variables, states and outputs under the condition.

        A mass without a lowest value, such as that of fuel, is at least 0.
        """
        changes = tuple((name, *ends) for name, ends in self.limits.items())
        return _limits(self.model, tuple(names), changes)

    def limits_of(self, name: str) -> tuple[float, float]:
        """Return the lowest and highest value that the condition permits for a variable, state or
        output.
        """
        limits = self.limits_on([name])
        return float(limits.lowest[0]), float(limits.highest[0])


@lru_cache(maxsize=64)
def _limits(
    model: Model, names: tuple[str, ...], changes: tuple[tuple[str, float, float], ...]
) -> Limits:
    """Return the limits of `TrimCondition.limits_on`."""
    masses = {
        name: (0.0, signal.max)
        for name, signal in {**model.states, **model.inputs}.items()
        if signal.min == -math.inf and conversion_factor(signal.unit, "kg") is not None
    }
    return Limits.of(model, names, masses | {name: (low, high) for name, low, high in changes})


#: Message if only one of a condition and a model is in SI units.
OTHER_UNITS = (
    "the condition and the model have different units; create the condition with this model"
)


@lru_cache(maxsize=16)
def usual_condition(model: Model) -> TrimCondition:
    """Return the trim condition that a model declares as its default."""
    return TrimCondition(model, model.trim)


def release(
    condition: TrimCondition,
    *,
    free: Sequence[str] = (),
    hold: Mapping[str, float | str | LinearTable] | None = None,
    limits: Mapping[str, tuple[float, float]] | None = None,
) -> TrimCondition:
    """Return a condition with some variables set free, others held, and limits changed.

    condition: the original condition
    free: variables and parameters to set free. The search begins at the previously imposed value,
        or at the first value of a table. A rate (speed_dot) that is set free is not balanced.
    hold: name -> imposed value; None for none
    limits: name -> (lowest, highest); None for no change of the limits

    Raises BadInputError for an unknown name, for a name that is both set free and held, and as
    `TrimCondition` does.
    """
    model = condition.model
    hold = {model.about.name_of(name): value for name, value in (hold or {}).items()}
    free = [*map(model.about.name_of, free)]
    for name in hold:
        model.refuse_unheld("unknown trim variable", name)
    for name in free:
        model.refuse_unheld("unknown trim variable", name, tuple(model.parameters))
        if name in hold:
            raise BadInputError(
                f"{name} is both free and held; free or hold the variable, not both"
            )

    rates = {name: rate for name, rate in condition.rates.items() if f"{name}_dot" not in free}
    held_rates: dict[str, Any] = {
        name.removesuffix("_dot"): value for name, value in hold.items() if name in model.rates
    }
    # A held mach, for example, replaces an imposed speed.
    values = {name: value for name, value in hold.items() if name not in model.rates}
    imposed = model.without_alternatives(condition.imposed, values) | values

    # The search begins at the value that was imposed on a variable that is now free.
    begin = dict(condition.begin)
    for name in free:
        if name in imposed:
            value = imposed.pop(name)
            begin[name] = float(value.values[0]) if isinstance(value, LinearTable) else value

    return replace(
        condition,
        rates=rates | held_rates,
        imposed=imposed,
        limits={**condition.limits, **(limits or {})},
        begin=begin,
        freed=(
            *condition.freed,
            *(name for name in free if name in (*model.variables, *model.parameters)),
        ),
    )


class StatedValues(NamedTuple):
    """What a condition states beside the trim that the model declares.

    held: variable or rate -> value
    free: variables and rates that are set free
    limits: variable -> (lowest, highest)
    """

    held: Mapping[str, float]
    free: tuple[str, ...]
    limits: Mapping[str, tuple[float, float]]


def stated_values(condition: TrimCondition, varied: Sequence[str] = ()) -> StatedValues:
    """Return what a condition states, without tables over the scheduling variable.

    varied: variables, outputs and rates that are also imposed, in place of the condition's
    """
    model = condition.model
    changed = model.without_alternatives(condition.changes.get("imposed", {}), varied)
    rates = {
        f"{name}_dot": rate
        for name, rate in condition.rates.items()
        if rate or name not in model.steady
    }
    held = {
        name: value
        for name, value in {**changed, **rates}.items()
        if name not in varied and not isinstance(value, list)  # a list is a table
    }
    imposed = {*condition.imposed, *varied}
    # A name whose alternative is imposed, such as speed by mach, is not free.
    may_be_free = model.without_alternatives(dict.fromkeys(condition.set_free), imposed)
    free = [name for name in may_be_free if name not in imposed]
    free += [f"{name}_dot" for name in model.steady if name not in condition.rates]
    return StatedValues(held, tuple(free), condition.limits)


def stated_cells(model: Model, stated: StatedValues) -> dict[str, Any]:
    """Return what a condition states as columns of a file of conditions, heading -> cell, from
    which the same numbers are read: "hold alpha [deg]" -> 2.8.
    """
    cells = {
        imposed_heading(model, name): exact_cell(value, model.unit(name))
        for name, value in stated.held.items()
    }
    limits = []
    for name, ends in stated.limits.items():
        lowest, highest = (exact_cell(end, model.unit(name)) for end in ends)
        limits.append(f"{name}={lowest}:{highest}".replace(" ", ""))  # spaces separate variables
    texts = {FREE: " ".join(stated.free), LIMIT: " ".join(limits)}
    return cells | {name: text for name, text in texts.items() if text}


def imposed_heading(model: Model, name: str) -> str:
    """Return the heading of the column of an imposed value, in a table of trims."""
    return f"{HELD} {with_shown_unit(name, model.unit(name))}"


def exact_cell(value: float, unit: str) -> float | str:
    """Return the cell of a file from which exactly this value is read, in degrees for an angle.

    If no number of degrees is converted to the value exactly, the cell has the unit: "0.1 rad".
    """
    shown = float(shown_values(value, unit)) + 0.0  # 0 in place of -0
    if not unit.startswith("rad"):
        return shown
    # of the conversion and the doubles next to it, the first that is read as the value
    near = (shown, *(math.nextafter(shown, end) for end in (math.inf, -math.inf)))
    return next((each for each in near if math.radians(each) == value), f"{value!r} {unit}")


#: Entries of a condition file, with their types.
_FILE = {
    "description": str,
    "source": str,
    "impose": {str: None},
    "free": [str],
    "limits": {str: [NUMBER]},
}


def read_condition(name: str, usual: TrimCondition, shipped: Mapping[str, Path]) -> TrimCondition:
    """Return the trim condition in a file of changes to the default condition.

    name: path of the user's file, or name of a file in the package
    usual: the default condition
    shipped: name -> file of the package, for the conditions of the paper's aircraft

    The table [impose] has entries variable = value, or variable = [[breakpoint, value], ...]. An
    angle is in degrees if its name has the suffix _deg (alpha_deg), otherwise in rad. `free` is a
    list of variables. The table [limits] has entries variable = [lowest, highest], also with _deg.

    Raises BadInputError, which names the file, the entry and the fault, if the file is not a valid
    condition.
    """
    data = read_named("condition", name, shipped, _FILE)
    model = usual.model
    hold: dict[str, Any] = {}
    for key, value in data.get("impose", {}).items():
        variable, factor = _variable(model, name, key)
        if isinstance(value, list):
            hold[variable] = _table(model, name, key, value, factor)
        else:
            hold[variable] = checked(name, value, NUMBER, key) * factor
    limits: dict[str, Any] = {}
    for key, ends in data.get("limits", {}).items():
        # Also a state that a trim cannot impose has limits.
        variable, factor = _variable(model, name, key, also=model.states)
        limits[variable] = tuple(end * factor for end in ends)
    free = tuple(_variable(model, name, key)[0] for key in data.get("free", []))
    with prefix_errors(name):
        return replace(release(usual, free=free, hold=hold, limits=limits), name=name)


def _variable(model: Model, file: str, key: str, also: Collection[str] = ()) -> tuple[str, float]:
    """Return the variable of a key such as "alpha_deg", and the factor from the file to its unit.

    also: names that are permitted although a trim cannot impose them
    """
    name = key.removesuffix("_deg")
    model.refuse_unheld(f"{file}: unknown trim variable", name, tuple(also))
    if name == key:  # a file is in the units that the aircraft declares
        return name, model.native_factor(name)
    if not model.unit(name).startswith("rad"):
        raise BadInputError(f"{file}: {key} is not an angle; write {name}, in {model.unit(name)}")
    return name, math.pi / 180.0


def _table(model: Model, file: str, key: str, value: Any, factor: float) -> LinearTable:
    """Return [breakpoint, value] rows as a table over the scheduling variable.

    Breakpoints that are angles are in degrees in the file; values are multiplied by the factor.
    """
    rows = checked(file, value, [[NUMBER]], key)
    if not rows or any(len(row) != 2 for row in rows):
        raise BadInputError(f"{file}: {key} is {shown(value)}; give [{model.schedule}, value] rows")
    breakpoints, values = np.array(rows).T
    if model.schedule and model.unit(model.schedule).startswith("rad"):
        breakpoints = np.radians(breakpoints)
    with prefix_errors(f"{file}: {key}"):
        return LinearTable(breakpoints, values * factor)


def freed_parameters(condition: TrimCondition) -> tuple[str, ...]:
    """Return the parameters that a condition sets free."""
    return tuple(name for name in condition.freed if name in condition.model.parameters)
