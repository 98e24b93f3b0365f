"""What a trim says: every variable between its limits, each equation; of any model its outputs."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from hfa_model.aircraft import Aircraft
from hfa_support.jsonable import finite_or_none
from hfa_support.model import Model
from hfa_support.reporting.report import Report
from hfa_support.reporting.text import Cell, Table, degrees, short_number, shown_unit, shown_value
from trim.point.condition import TrimCondition
from trim.point.operating_point import BALANCE, OperatingPoint, Status, scheduled_data
from trim.point.solve import STARTS, other_trims, trim_problem

#: A variable is at its limit when it is this close to it, in its scaled unit and relative to the limit.
_CLOSE = 1e-6


class Margin(NamedTuple):
    """A variable between its limits, in its own unit: rad, ft, lbf.

    role: "free", "held", or "follows" for a state or an output that is neither. A limit that does not exist is
    infinite. scale: one scaled unit.
    """

    name: str
    value: float
    role: str
    lowest: float
    highest: float
    unit: str
    scale: float

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
        return bool(self.nearer) and self.distance <= _CLOSE * (self.scale + abs(self.nearer_limit))

    @property
    def binds(self) -> bool:
        """Whether a limit keeps the variable where it is: one that is held stands where it was put."""
        return self.at_limit and self.role != "held"


def all_margins(condition: TrimCondition, point: OperatingPoint) -> dict[str, Margin]:
    """Every state, every output that a trim imposes or the model limits, and every input, in this order."""
    model, found = point.model, point.values
    role = dict.fromkeys(condition.imposed, "held") | dict.fromkeys(condition.free, "free")
    role |= dict.fromkeys(trim_problem(model, condition, point).idle, "left")
    if set(condition.free) <= set(model.inputs):  # then all states are held, those that outputs replace too
        role |= dict.fromkeys(model.replaced, "held")
    outputs = [
        name
        for name, signal in model.outputs.items()
        if name in model.variables
        or name in condition.imposed
        or math.isfinite(signal.max)
        or math.isfinite(signal.min)
    ]
    if missing := [name for name in outputs if name not in found]:
        found = found | model.outputs_at(point.states, point.inputs, missing)
    limits = {name: condition.limits_of(name) for name in (*model.states, *outputs, *model.inputs)}
    for state, output in model.replaced.items():
        limits[output] = _limits_left(condition, point, state, output)
    return {
        name: Margin(name, found[name], role.get(name, "follows"), *ends, model.unit(name), model.signals[name].nominal)
        for name, ends in limits.items()
    }


def _limits_left(condition: TrimCondition, point: OperatingPoint, state: str, output: str) -> tuple[float, float]:
    """What its own limits and those of a state x leave of the output y in its place, y = y0 + slope (x - x0)."""
    x, nominal = getattr(point.states, state), point.model.states[state].nominal
    moved = point.model.outputs_at(point.states._replace(**{state: x + nominal}), point.inputs, [output])
    slope = (moved[output] - point.values[output]) / nominal
    ends = sorted(point.values[output] + slope * (end - x) for end in condition.limits_of(state))
    own = condition.limits_of(output)
    return max(own[0], ends[0]), min(own[1], ends[1])


def margins(condition: TrimCondition, point: OperatingPoint) -> dict[str, float]:
    """Input or free variable -> distance to the nearer of its limits, in its own unit; negative beyond the limit.

    What follows is there too, such as the pitch angle. What has no limits has no margin.
    """
    return {each.name: each.distance for each in margins_that_count(condition, point)}


def margins_that_count(condition: TrimCondition, point: OperatingPoint) -> list[Margin]:
    """The limited inputs, free variables and what follows: what the trim used up, or could."""
    every = all_margins(condition, point)
    following = (each.name for each in every.values() if each.role == "follows")
    names = dict.fromkeys((*point.model.inputs, *condition.free, *following))
    return [every[name] for name in names if every[name].nearer]


def nearest_limits(condition: TrimCondition, point: OperatingPoint) -> list[Margin]:
    """The three margins that are the least share of their range, and all others that are at a limit; least first."""
    ordered = sorted(margins_that_count(condition, point), key=lambda each: each.share)
    return [each for index, each in enumerate(ordered) if index < 3 or each.at_limit]


TRIM_SCHEMA = "hfa.trim/1"


def trim_report(aircraft: Aircraft | Model, condition: TrimCondition, point: OperatingPoint) -> Report:
    """Every variable between its limits, the limits that bind, the verdict on each equation, what the search found
    beside this point, the rates that are not balanced; of the HFA loads and performance, of other models their outputs;
    angles in degrees for people."""
    every, model = all_margins(condition, point), aircraft.model
    search, said = _search(aircraft, condition, point)
    rates = model.rates_at(point.states, point.inputs)
    left = {name: rate for name, rate in rates.items() if name not in (condition.rates or {})}
    own = () if isinstance(aircraft, Aircraft) else _outputs(model, point)
    report = Report(
        title=point.title,
        parts=(
            _variables("state", [each for name, each in every.items() if name not in model.inputs]),
            _variables("input", [every[name] for name in model.inputs]),
            _nearest(nearest_limits(condition, point)),
            point.equations(condition.rates),
            *said,
            *[_left(model, left)] * bool(left),
            *own,
        ),
        notes=point.warnings,
        data=_data(condition, point) | {"search": search, "rates_left": left},
        records=point.records(),
    )
    if isinstance(aircraft, Aircraft):
        from trim.point.hfa_report import with_loads

        return with_loads(report, aircraft, point)
    values = model.outputs_at(point.states, point.inputs)
    return report.with_data(performance=values, performance_units={name: model.unit(name) for name in values})


def _search(
    aircraft: Aircraft | Model, condition: TrimCondition, point: OperatingPoint
) -> tuple[dict[str, Any], list[str]]:
    """How the point was found, as data and in sentences: none about the usual case."""
    model, problem = point.model, trim_problem(aircraft.model, condition, point)
    at = problem.unknowns_at(point.values)
    equations, unknowns = problem.count
    trimmed, said = point.status == Status.TRIMMED, []
    others = other_trims(aircraft, condition, point) if trimmed else []
    if unknowns > equations and trimmed:
        said.append(
            f"Least effort: {unknowns} unknowns for {equations} equations, so this is the trim with the least "
            "Σ (input / scale)² near the start"
        )
    if point.started:
        said.append(f"The usual start leads to no trim; start {point.started} of {STARTS} between the limits led here")
    if problem.idle:
        said.append(f"In no equation, and left where the search begins: {', '.join(problem.idle)}")
    for other in others:
        apart = np.abs(problem.unknowns_at(other.values) - at) > 1e-3
        listed = [name for name, differs in zip(problem.free, apart.tolist(), strict=True) if differs]
        values = ", ".join(f"{name} {model.describe(name, other.values[name])}" for name in listed)
        typed = [f"{name}={shown_value(other.values[name], model.unit(name))}" for name in listed]
        begin = ",".join(typed[: sum(name not in model.inputs for name in listed)] or typed)
        said.append(
            f"Another trim: {values}; the one above is where the search ends, --start {begin} selects the other"
        )
    search: dict[str, Any] = {"equations": equations, "unknowns": unknowns, "least_effort": unknowns > equations}
    search |= {"start": point.started, "idle": list(problem.idle)}
    return search | {"other_trims": [{name: each.values[name] for name in problem.free} for each in others]}, said


def _left(model: Model, rates: dict[str, float]) -> Table:
    """The states whose rates the trim does not balance."""
    rows = [(name, *degrees(rate, model.rate_unit(name))) for name, rate in rates.items()]
    return Table(("not balanced", "rate", "unit"), rows)


def _outputs(model: Model, point: OperatingPoint) -> tuple[Table, ...]:
    """The declared outputs, in a table; none without them."""
    rows = [
        (name, short_number(value, model.unit(name)), shown_unit(model.unit(name)))
        for name, value in model.outputs_at(point.states, point.inputs).items()
    ]
    return (Table(("performance", "value", "unit"), rows),) * bool(rows)


def _variables(kind: str, standing: list[Margin]) -> Table:
    rows = [
        (
            each.name,
            *degrees(each.value, each.unit),
            {"held": "imposed"}.get(each.role, each.role),
            *("" if math.isinf(limit) else shown_value(limit, each.unit) for limit in (each.lowest, each.highest)),
            _margin(each),
            each.nearer,
        )
        for each in standing
    ]
    return Table((kind, "value", "unit", "status", "lowest", "highest", "margin", "nearest limit"), rows)


def _margin(each: Margin) -> str:
    """The distance to the nearer limit, and where in its range the value lies; nothing where there is no limit."""
    if not each.nearer:
        return ""
    shown = degrees(each.distance, each.unit)[0]
    width = each.highest - each.lowest
    return shown if math.isinf(width) else Cell(shown, place=(each.value - each.lowest) / width)


def _nearest(nearest: list[Margin]) -> Table:
    rows = [
        (
            f"{each.name}, {each.nearer}",
            shown_value(each.nearer_limit, each.unit),
            degrees(each.distance, each.unit)[0],
            shown_unit(each.unit),
            f"{100 * each.share:.1f} %",
            Cell("BINDS", "far") if each.binds else "held there" if each.at_limit else "-",
        )
        for each in nearest
    ]
    return Table(("nearest limit", "limit", "margin", "unit", "of its range", "verdict"), rows)


def _data(condition: TrimCondition, point: OperatingPoint) -> dict[str, Any]:
    """Radians, feet, pounds, as stored in the point."""
    nearest = nearest_limits(condition, point)
    return {
        "schema": TRIM_SCHEMA,
        "status": str(point.status),
        **scheduled_data(point),
        "dynamics": point.dynamics,
        "operating_point": point.to_dict(),
        "scaled_residuals": point.scaled_residuals,
        "balance_limit": BALANCE,
        "margins": margins(condition, point),
        "variables": {name: _variable_data(each) for name, each in all_margins(condition, point).items()},
        "nearest_limits": [each.name for each in nearest],
        "binding": [each.name for each in nearest if each.binds],
        "equations": {
            name: {
                "imposed": {**condition.imposed, **(condition.rates or {})}[name],
                "residual": value,
                "tolerance": point.tolerance(name),
                "unit": point.equation_unit(name),
                "ok": point.balances(name),
            }
            for name, value in point.residuals.items()
        },
        "warnings": point.warnings,
    }


def _variable_data(variable: Margin) -> dict[str, Any]:
    return {
        "value": variable.value,
        "unit": variable.unit,
        "role": variable.role,
        "lowest": finite_or_none(variable.lowest),
        "highest": finite_or_none(variable.highest),
        "margin": finite_or_none(variable.distance),
        "nearer": variable.nearer,
        "at_limit": variable.at_limit,
    }
