"""What a trim says: every variable between its limits, each equation; of any model its outputs."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from hfa_aircraft.model import Model
from hfa_support.jsonable import finite_or_none
from hfa_support.reporting.report import Report
from hfa_support.reporting.results import Result
from hfa_support.reporting.text import Cell, Table, degrees, short_number, shown_unit, shown_value
from hfa_support.reporting.unit_system import in_force, unit_in_force
from trim.point.condition import TrimCondition
from trim.point.operating_point import BALANCE, OperatingPoint, PointData, Status, scheduled_data
from trim.point.problem import STARTS, TrimProblem
from trim.point.solve import other_trims

#: A variable is at its limit when it is this close to it, in its scaled unit and relative to the
#: limit.
_CLOSE = 1e-6


@dataclass(frozen=True, kw_only=True, eq=False)
class TrimData(Result):
    """A trim as data; angles in radians.

    dihedral_deg: dihedral angle, degrees; null of other models than the HFA.
    scheduled: of other models the scheduling variable.
    dynamics: published or newton, or the name of another model.
    operating_point: X0, U0 and residuals.
    scaled_residuals: residual of each balanced equation in its scale.
    balance_limit: largest scaled residual of a trim.
    loads: of the HFA forces and moments on aircraft and panels.
    load_units: unit of each.
    margins: distance of each unknown from its nearer limit.
    variables: name -> value, unit, role, limits, margin.
    nearest_limits: unknowns nearest to a limit.
    binding: limits that bind.
    equations: equation -> imposed rate, residual, tolerance, unit, verdict.
    rates_left: rate of each state that the trim does not balance.
    search: equations, unknowns, whether of least effort, number of the start, idle variables, other
        trims found.
    performance: of the HFA weight, lift coefficient, load factor and so on; of others their outputs.
    performance_units: unit of each.
    status: trimmed or failed; a failed trim has the nearest point within the limits, and exit code 1.
    reason: why there is no trim.
    warnings: what to know before trusting the result."""

    schema = "hfa.trim/1"
    made_by = "hfa trim"

    dihedral_deg: float
    scheduled: Mapping[str, float] | None = None
    dynamics: str
    operating_point: PointData
    scaled_residuals: Mapping[str, float]
    balance_limit: float
    loads: Mapping[str, float] | None = None
    load_units: Mapping[str, str] | None = None
    margins: Mapping[str, float]
    variables: Mapping[str, Any]
    nearest_limits: Sequence[str]
    binding: Sequence[str]
    equations: Mapping[str, Any]
    rates_left: Mapping[str, float]
    search: Mapping[str, Any]
    performance: Mapping[str, float] | None = None
    performance_units: Mapping[str, str] | None = None
    status: str
    reason: str | None = None
    warnings: Sequence[str]


class Margin(NamedTuple):
    """A variable between its limits, in its own unit: rad, ft, lbf.

    role: "free", "held", "left" where the search begins, or "follows" for a state or an output that
    is neither. A limit that does not exist is infinite. scale: one scaled unit."""

    name: str
    value: float
    role: str
    lowest: float
    highest: float
    unit: str
    scale: float

    @property
    def distance(self) -> float:
        """min(value - lowest, highest - value): to the nearer limit; negative beyond it, infinite
        without one."""
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
        """distance / (highest - lowest): 0 at a limit, 0.5 halfway; 0 where the range is
        infinite."""
        return self.distance / (self.highest - self.lowest)

    @property
    def at_limit(self) -> bool:
        """Whether the variable is at its nearer limit or beyond it."""
        return bool(self.nearer) and self.distance <= _CLOSE * (self.scale + abs(self.nearer_limit))

    def row(self) -> tuple[str, ...]:
        """Name, value, unit, status, limits, margin and the nearer limit; angles in degrees."""
        limits = (
            "" if math.isinf(limit) else shown_value(limit, self.unit)
            for limit in (self.lowest, self.highest)
        )
        margin = degrees(self.distance, self.unit)[0] if self.nearer else ""
        role = "imposed" if self.role == "held" else self.role
        return self.name, *degrees(self.value, self.unit), role, *limits, margin, self.nearer

    def to_dict(self) -> dict[str, Any]:
        """Ready for JSON; a limit that does not exist is null."""
        numbers = {"lowest": self.lowest, "highest": self.highest, "margin": self.distance}
        return {
            **{"value": self.value, "unit": self.unit, "role": self.role},
            **{name: finite_or_none(number) for name, number in numbers.items()},
            **{"nearer": self.nearer, "at_limit": self.at_limit},
        }


def all_margins(condition: TrimCondition, point: OperatingPoint) -> dict[str, Margin]:
    """Every state, every output that a trim imposes or the model limits, and every input, in this
    order."""
    model, found = point.model, point.values
    role = dict.fromkeys(condition.imposed, "held") | dict.fromkeys(condition.free, "free")
    role |= dict.fromkeys(TrimProblem(model, condition, point).idle, "left")
    if set(condition.free) <= set(
        model.inputs
    ):  # then all states are held, those that outputs replace too
        role |= dict.fromkeys(model.replaced, "held")
    limited = {
        name
        for name, each in model.outputs.items()
        if math.isfinite(each.max) or math.isfinite(each.min)
    }
    outputs = [
        name for name in model.outputs if name in {*model.variables, *condition.imposed, *limited}
    ]
    if missing := [name for name in outputs if name not in found]:
        found = found | model.outputs_at(point.states, point.inputs, missing)
    limits = {name: condition.limits_of(name) for name in (*model.states, *outputs, *model.inputs)}
    for state, output in model.replaced.items():
        # What its own limits and those of the state x leave of the output y in its place, y = y0 +
        # slope (x - x0).
        x, nominal, y = getattr(point.states, state), model.states[state].nominal, found[output]
        moved = model.outputs_at(
            point.states._replace(**{state: x + nominal}), point.inputs, [output]
        )[output]
        ends, own = (
            sorted(y + (moved - y) / nominal * (end - x) for end in limits[state]),
            limits[output],
        )
        limits[output] = max(own[0], ends[0]), min(own[1], ends[1])
    return {
        name: Margin(
            name,
            found[name],
            role.get(name, "follows"),
            *ends,
            model.unit(name),
            model.signals[name].nominal,
        )
        for name, ends in limits.items()
    }


def point_report(
    aircraft: Model, condition: TrimCondition, point: OperatingPoint, with_outputs: bool = True
) -> Report:
    """Every variable between its limits, the limits that bind, the verdict on each equation, what
    the search found beside this point, the rates that are not balanced; of the HFA loads and
    performance, of other models their outputs; angles in degrees for people, radians, feet and
    pounds in the data."""
    every, model = all_margins(condition, point), aircraft
    # What the trim used up, or could; of that the least shares of their ranges, and all that is at
    # a limit.
    limited = [
        each
        for name, each in every.items()
        if each.nearer and (each.role != "held" or name in model.inputs)
    ]
    ordered = enumerate(sorted(limited, key=lambda each: each.share))
    near = [each for index, each in ordered if index < 3 or each.at_limit]
    search, said = _search(aircraft, condition, point)
    imposed, scaled = {**condition.imposed, **condition.rates}, point.scaled_residuals
    equations = {
        name: {
            **{"imposed": imposed[name], "residual": value, "tolerance": point.tolerance(name)},
            **{"unit": point.equation_unit(name), "ok": abs(scaled[name]) <= BALANCE},
        }
        for name, value in point.residuals.items()
    }
    rates = model.rates_at(point.states, point.inputs)
    left = {name: rate for name, rate in rates.items() if name not in condition.rates}
    header = "value", "unit", "status", "lowest", "highest", "margin", "nearest limit"
    parts: list[Any] = [
        Table(
            ("state", *header),
            [each.row() for name, each in every.items() if name not in model.inputs],
        ),
        Table(("input", *header), [every[name].row() for name in model.inputs]),
        Table(
            ("nearest limit", "limit", "margin", "unit", "of its range", "verdict"),
            list(map(_near, near)),
        ),
        _equations(point, equations),
        *said,
    ]
    if left:
        rows = [(name, *degrees(rate, model.rate_unit(name))) for name, rate in left.items()]
        parts.append(Table(("not balanced", "rate", "unit"), rows))
    data = TrimData(
        **scheduled_data(point),
        dynamics=point.dynamics,
        operating_point=PointData.of(point),
        scaled_residuals=point.scaled_residuals,
        balance_limit=BALANCE,
        margins={margin.name: margin.distance for margin in limited},
        variables={name: margin.to_dict() for name, margin in every.items()},
        nearest_limits=[margin.name for margin in near],
        binding=[margin.name for margin in near if margin.at_limit and margin.role != "held"],
        equations=equations,
        rates_left=left,
        search=search,
        status=str(point.status),
        warnings=point.warnings,
    ).to_dict()
    report = Report(point.title, parts, point.warnings, data, point.records())
    if not with_outputs:
        return report
    outputs = model.outputs_at(point.states, point.inputs)
    units = {name: model.unit(name) for name in outputs}
    if outputs:
        rows = [
            (name, short_number(value, units[name]), shown_unit(units[name]))
            for name, value in outputs.items()
        ]
        report = replace(report, parts=(*parts, Table(("performance", "value", "unit"), rows)))
    return report.with_data(performance=outputs, performance_units=units)


def _near(each: Margin) -> tuple[str, ...]:
    return (
        f"{each.name}, {each.nearer}",
        shown_value(each.nearer_limit, each.unit),
        degrees(each.distance, each.unit)[0],
        shown_unit(each.unit),
        f"{100 * each.share:.1f} %",
        "-" if not each.at_limit else "held there" if each.role == "held" else Cell("BINDS", "far"),
    )


def _equations(point: OperatingPoint, equations: dict[str, dict[str, Any]]) -> Table:
    """One row an equation, those that do not balance first; without the imposed rates where all are
    zero."""
    states, scaled = point.model.states, point.scaled_residuals
    imposed = any(each["imposed"] for name, each in equations.items() if name in states)
    rows = []
    for name, each in sorted(equations.items(), key=lambda item: item[1]["ok"]):
        unit, rate = each["unit"], each["imposed"] if name in states else 0.0
        rows.append(
            (
                f"rate of {name}" if name in states else name,
                *([f"{in_force(rate, unit):.6g}"] * imposed),
                *(f"{in_force(each[part], unit):.2e}" for part in ("residual", "tolerance")),
                unit_in_force(unit),
                f"{scaled[name]:.2e}",
                Cell("PASS", "good") if each["ok"] else Cell("FAIL", "bad"),
            )
        )
    return Table(
        ("equation", *["imposed"] * imposed, "residual", "tolerance", "unit", "scaled", "verdict"),
        rows,
    )


def _search(
    aircraft: Model, condition: TrimCondition, point: OperatingPoint
) -> tuple[dict[str, Any], list[str]]:
    """How the point was found, as data and in sentences: none about the usual case."""
    model, problem = point.model, TrimProblem(aircraft, condition, point)
    at, (equations, unknowns) = problem.unknowns(point.values), problem.count
    trimmed, said = point.status == Status.TRIMMED, []
    others = other_trims(aircraft, condition, point) if trimmed else []
    if unknowns > equations and trimmed:
        said.append(
            f"Least effort: {unknowns} unknowns for {equations} equations, so this is the trim with the least "
            "Σ (input / scale)² near the start"
        )
    if point.started:
        said.append(
            f"The usual start leads to no trim; start {point.started} of {STARTS} between the limits led here"
        )
    if problem.idle:
        said.append(f"In no equation, and left where the search begins: {', '.join(problem.idle)}")
    for other in others:
        apart = np.abs(problem.unknowns(other.values) - at) > 1e-3
        listed = [
            name for name, differs in zip(problem.free, apart.tolist(), strict=True) if differs
        ]
        values = ", ".join(f"{name} {model.describe(name, other.values[name])}" for name in listed)
        typed = [f"{name}={shown_value(other.values[name], model.unit(name))}" for name in listed]
        begin = ",".join(typed[: sum(name not in model.inputs for name in listed)] or typed)
        said.append(
            f"Another trim: {values}; the one above is where the search ends, --start {begin} selects the other"
        )
    search: dict[str, Any] = {
        "equations": equations,
        "unknowns": unknowns,
        "least_effort": unknowns > equations,
    }
    search |= {"start": point.started, "idle": list(problem.idle)}
    return search | {
        "other_trims": [{name: each.values[name] for name in problem.free} for each in others]
    }, said
