"""Report of a trim: variables with their limits, equations, and outputs of the model."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from hfa_aircraft.model import Model
from hfa_support.arguments import checks_arguments, need
from hfa_support.errors import BadInputError
from hfa_support.reporting.report import Report
from hfa_support.reporting.results import Result
from hfa_support.reporting.text import Cell, Table, degrees, short_number, shown_unit, shown_value
from trim.point.condition import TrimCondition
from trim.point.first_lines import control_lines
from trim.point.margins import Margin
from trim.point.operating_point import OperatingPoint, point_records
from trim.point.problem import STARTS, TrimProblem
from trim.point.status import BALANCE, Status
from trim.point.system import declared_start

if TYPE_CHECKING:
    from matplotlib.axes import Axes

#: Number of nearest limits that are listed, in addition to those that bind.
_NEAREST = 3
#: Condition number above which the scaled Jacobian counts as singular.
_SINGULAR = 1e12
_MARGIN_COLUMNS = ("value", "unit", "status", "lowest", "highest", "margin", "nearest limit")
_NEAR_COLUMNS = ("nearest limit", "limit", "margin", "unit", "of its range", "verdict")


@dataclass(frozen=True, kw_only=True, eq=False)
class TrimResult(Result):
    """Trim: every variable with its limits, and each equation; angles in radians.

    dihedral_deg: for the HFA, the dihedral angle, degrees.
    scheduled: for other models, the scheduling variable.
    dynamics: published or newton, or the name of another model.
    operating_point: X0, U0 and residuals.
    scaled_residuals: residual of each balanced equation divided by its scale.
    balance_limit: largest scaled residual of a trim.
    margins: variable with a limit -> distance to the nearer limit. Held states and outputs are
        omitted.
    variables: name -> value, unit, role, limits, margin.
    nearest_limits: variables nearest to a limit.
    binding: variables at a limit, without held ones.
    equations: equation -> imposed value, residual, tolerance, unit, verdict.
    rates_left: rate of each state that the trim does not balance.
    search: numbers of equations and unknowns, whether effort was minimized, number of the initial
        point, idle variables, other trims found.
    status: trimmed or failed; a failed trim contains the nearest point within the limits, and the
        exit code is 1.
    reason: why there is no trim.
    warnings: notes on the validity of the result.
    """

    schema = "hfa.trim/1"
    made_by = "hfa trim"

    dihedral_deg: float | None = None
    scheduled: Mapping[str, float] | None = None
    dynamics: str
    operating_point: OperatingPoint
    scaled_residuals: Mapping[str, float]
    balance_limit: float
    margins: Mapping[str, float]
    variables: Mapping[str, Margin]
    nearest_limits: Sequence[str]
    binding: Sequence[str]
    equations: Mapping[str, Mapping[str, Any]]
    rates_left: Mapping[str, float]
    search: Mapping[str, Any]
    status: str
    reason: str | None = None
    warnings: Sequence[str]


@dataclass(frozen=True)
class Performance(Result):
    """Performance of an aircraft at a trim.

    performance: for the HFA, weight, lift coefficient, load factor and others; for other aircraft,
        their outputs.
    performance_units: unit of each entry of `performance`.
    """

    performance: Mapping[str, float]
    performance_units: Mapping[str, str]


@checks_arguments
def trim_report(model: Model, condition: TrimCondition, point: OperatingPoint) -> Report:
    """Return the report of a trim, or of the nearest point if the condition has no trim.

    The report contains every variable with its limits, the nearest limits, the verdict on each
    equation, other trims found, the rates that are not balanced, and the outputs or the model's own
    description (`Trimming.describe`). Angles are in degrees in the text and in radians in the
    data.

    model: model of the aircraft
    condition: condition of the trim
    point: the trim or the nearest point
    """
    need(model, Model, "trim_report: model", Model.how_to_make)
    need(condition, TrimCondition, "trim_report: condition", TrimCondition.how_to_make)
    need(point, OperatingPoint, "trim_report: point", "a trim: hfa.trim(model)")
    margins = point.margins_under(condition)
    # Variables whose limits matter: free ones, and held inputs.
    limited = [
        margin
        for name, margin in margins.items()
        if margin.nearer and (margin.role != "held" or name in model.inputs)
    ]
    nearest = sorted(limited, key=_rank)
    nearest = [
        margin for index, margin in enumerate(nearest) if index < _NEAREST or margin.at_limit
    ]
    search, sentences = _search(condition, point)
    equations = _equations(condition, point)
    rates = model.rates_at(point.states, point.inputs)
    unbalanced = {name: rate for name, rate in rates.items() if name not in condition.rates}
    states = [margin.row() for name, margin in margins.items() if name not in model.inputs]
    inputs = [margins[name].row() for name in model.inputs]
    parts: list[Any] = [
        Table(("state", *_MARGIN_COLUMNS), states),
        Table(("input", *_MARGIN_COLUMNS), inputs),
        Table(_NEAR_COLUMNS, [_nearest_row(margin) for margin in nearest]),
        _equations_table(point, equations),
        *sentences,
    ]
    if unbalanced:
        rows = [(name, *degrees(rate, model.rate_unit(name))) for name, rate in unbalanced.items()]
        parts.append(Table(("not balanced", "rate", "unit"), rows))
    data = TrimResult(
        dihedral_deg=point.dihedral_deg,
        scheduled=point.scheduled,
        dynamics=point.dynamics,
        operating_point=point,
        scaled_residuals=point.scaled_residuals,
        balance_limit=BALANCE,
        margins={margin.name: margin.distance for margin in limited},
        variables=margins,
        nearest_limits=[margin.name for margin in nearest],
        binding=[margin.name for margin in nearest if margin.at_limit and margin.role != "held"],
        equations=equations,
        rates_left=unbalanced,
        search=search,
        status=str(point.status),
        warnings=point.warnings,
    ).as_data()
    if model.trimming.describe is None:
        outputs = model.outputs_at(point.states, point.inputs)
        units = {name: model.unit(name) for name in outputs}
        data |= Performance(outputs, units).as_data()
        if outputs:
            parts.append(_outputs_table(outputs, units))
    title = f"{point.title}\n{control_lines(point, margins, _lift_over_drag(point))}"
    report = Report(title, parts, point.warnings, data, point_records(point))
    described = model.trimming.describe
    return report if described is None else described(point, report)


def _lift_over_drag(point: OperatingPoint) -> float | None:
    """Return lift divided by drag, or None if the model has no outputs lift and drag."""
    if not {"lift", "drag"} <= {*point.model.outputs}:
        return None
    return point["lift"] / point["drag"]


def _rank(margin: Margin) -> tuple[bool, bool, bool, float]:
    """Return the key that sorts limits: those that bind, then declared ones, then assumed ones."""
    # Variables with only one limit, and thus without a range, come after those with two.
    has_no_range = math.isinf(margin.highest - margin.lowest)
    return not margin.at_limit, margin.assumed, has_no_range, margin.share


def _outputs_table(outputs: dict[str, float], units: dict[str, str]) -> Table:
    rows = [
        (name, short_number(value, units[name]), shown_unit(units[name]))
        for name, value in outputs.items()
    ]
    return Table(("performance", "value", "unit"), rows)


def _nearest_row(margin: Margin) -> tuple[str, ...]:
    """Return the table row on the nearer limit of a variable."""
    # The row contains the limit, the distance, and whether the variable is at the limit.
    verdict: str = "-"
    if margin.at_limit:
        verdict = "held there" if margin.role == "held" else Cell("BINDS", "far")
    return (
        f"{margin.name}, {margin.nearer}" + ", assumed" * margin.assumed,
        shown_value(margin.nearer_limit, margin.unit),
        degrees(margin.distance, margin.unit)[0],
        shown_unit(margin.unit),
        f"{100 * margin.share:.1f} %",
        verdict,
    )


def _equations(condition: TrimCondition, point: OperatingPoint) -> dict[str, dict[str, Any]]:
    """Return data on each equation of a trim, state or output -> data."""
    # The data are the imposed value, the residual, its tolerance, the unit, and whether the
    # equation balances.
    imposed = {**condition.imposed, **condition.rates}
    equations = {}
    for name, residual in point.residuals.items():
        tolerance = BALANCE * point.scale(name)
        equations[name] = {
            "imposed": imposed[name],
            "residual": residual,
            "tolerance": tolerance,
            "unit": point.equation_unit(name),
            "ok": abs(residual) <= tolerance,
        }
    return equations


def _equations_table(point: OperatingPoint, equations: dict[str, dict[str, Any]]) -> Table:
    """Return a table of the equations, with those that do not balance first."""
    # The column of imposed rates is omitted if all imposed rates are 0.
    states = point.model.states
    with_rates = any(entry["imposed"] for name, entry in equations.items() if name in states)
    scaled = point.scaled_residuals
    rows = []
    for name, entry in sorted(equations.items(), key=lambda item: item[1]["ok"]):
        unit = entry["unit"]
        row = [f"rate of {name}" if name in states else name]
        if with_rates:
            rate = entry["imposed"] if name in states else 0.0
            row.append(f"{rate:.6g}")
        row.append(f"{entry['residual']:z.2e}")
        row.append(f"{entry['tolerance']:.2e}")
        row.append(unit)
        row.append(f"{scaled[name]:z.2e}")
        row.append(Cell("PASS", "good") if entry["ok"] else Cell("FAIL", "bad"))
        rows.append(tuple(row))
    columns = ["equation", "residual", "tolerance", "unit", "scaled", "verdict"]
    if with_rates:
        columns.insert(1, "imposed")
    return Table(tuple(columns), rows)


def other_trims(condition: TrimCondition, point: OperatingPoint) -> list[OperatingPoint]:
    """Return further trims of a condition with as many equations as unknowns.

    These are the trims that Newton's method finds from the declared initial values and from
    `STARTS` points within the limits, for example on the back side of the power curve. More trims
    may exist. The list is empty if the numbers of equations and unknowns differ.

    condition: condition of the trim
    point: the trim
    """
    problem = point.problem_of(condition)
    trim = problem.unknowns(point.values)
    equations, unknowns = problem.count
    starts = [*problem.starts(trim)]
    if not starts or equations != unknowns:
        return []
    starts.append(problem.unknowns(declared_start(problem.model, condition.imposed)))
    trims = [trim]
    for solution in problem.ends_within(starts):
        distances = [float(np.abs(solution - z).max()) for z in trims]
        if problem.solved(solution) and min(distances) > 1e-6:
            trims.append(solution)
    return [OperatingPoint.of(problem, z, Status.TRIMMED) for z in trims[1:]]


def _search(condition: TrimCondition, point: OperatingPoint) -> tuple[dict[str, Any], list[str]]:
    """Return data on the search for a trim, and sentences on unusual features of the search."""
    problem = point.problem_of(condition)
    equations, unknowns = problem.count
    sentences = []
    others: list[OperatingPoint] = []
    if point.status == Status.TRIMMED:
        others = other_trims(condition, point)
        if unknowns > equations:
            sentences.append(
                f"Least effort: {unknowns} unknowns for {equations} equations, so this is the trim "
                "with the least Σ (input / scale)² near the initial point"
            )
        note = _singular_note(problem, problem.unknowns(point.values))
        if note:
            sentences.append(note)
    if point.started:
        from trim.point.diagnosis import failure

        usual = failure(problem, problem.newton(problem.clip(problem.system.start)))
        sentences.append(f"From the default initial point: {usual}")
        sentences.append(f"Found from initial point {point.started} of {STARTS} between the limits")
    limits = problem.system.limits
    free = np.isinf(limits.lowest) & np.isinf(limits.highest)
    if free.any():
        names = ", ".join(problem.free[i] for i in np.flatnonzero(free))
        sentences.append(f"No limits are declared for {names}; check that the values are reachable")
    if problem.idle:
        names = ", ".join(problem.idle)
        sentences.append(f"Used by no equation, kept at the initial value: {names}")
    sentences += [_other_trim(problem, point, other) for other in others]
    search = {
        "equations": equations,
        "unknowns": unknowns,
        "least_effort": unknowns > equations,
        "start": point.started,
        "idle": list(problem.idle),
        "other_trims": [{name: other.values[name] for name in problem.free} for other in others],
    }
    return search, sentences


def _singular_note(problem: TrimProblem, z: np.ndarray) -> str:
    """Return a note if a trim is not unique because the Jacobian of its equations is singular."""
    # The note is "" if the Jacobian is regular, or if the numbers of equations and unknowns differ.
    # z (k,)
    equations, unknowns = problem.count
    jacobian = problem.at(z).jacobian[:equations]
    if not unknowns or equations != unknowns or np.linalg.cond(jacobian) < _SINGULAR:
        return ""
    direction = np.abs(np.linalg.svd(jacobian)[2][-1])
    moving = [problem.free[i] for i in np.argsort(-direction) if direction[i] > 0.1]
    return (
        f"The equations do not determine the trim: the Jacobian is singular along "
        f"{', '.join(moving)}; hold one of these"
    )


def _other_trim(problem: TrimProblem, point: OperatingPoint, other: OperatingPoint) -> str:
    """Return a sentence on another trim, with an initial point that leads to it."""
    model = problem.model
    apart = np.abs(problem.unknowns(other.values) - problem.unknowns(point.values)) > 1e-3
    names = [problem.free[i] for i in np.flatnonzero(apart)]
    values = ", ".join(f"{name} {model.describe(name, other.values[name])}" for name in names)
    begin = [name for name in names if name not in model.inputs] or names
    typed = ",".join(
        f"{name}={shown_value(other.values[name], model.unit(name))}" for name in begin
    )
    return f"Another trim exists: {values}; the initial point {typed} leads to it"


def draw_point(point: OperatingPoint) -> Axes:
    """Draw the variables of a trim in percent of their ranges with pyplot, and return the Axes.

    The lowest limit is at 0 %, the highest at 100 %. Variables without two different limits are
    omitted.

    Raises BadInputError for a point that was not found by a search, and if all variables are
    omitted.
    """
    if point.problem is None:
        raise BadInputError(
            "this operating point is not the result of a trim and has no limits; trim the model"
        )
    limited = []
    for margin in point.margins.values():
        if math.isfinite(margin.highest - margin.lowest) and margin.highest > margin.lowest:
            limited.append(margin)
    if not limited:
        raise BadInputError(
            "no variable has both a lower and an upper limit; declare min and max of a Signal"
        )
    limited.reverse()  # so that the first is at the top
    from hfa_support.reporting.figure import pyplot_figure

    axes = pyplot_figure(7.0, 1.2 + 0.3 * len(limited)).subplots()
    shares = [100 * (each.value - each.lowest) / (each.highest - each.lowest) for each in limited]
    rows = range(len(limited))
    axes.hlines(rows, 0.0, 100.0, color="0.85", linewidth=5, zorder=1)
    axes.scatter(shares, rows, color=["C3" if each.at_limit else "C0" for each in limited])
    axes.set_yticks(rows, [" ".join(each.row()[:3]) for each in limited])
    axes.set_xlabel("share of the range between the limits, %; at a limit red")
    axes.set_title(point.title, fontsize=10)
    return axes
