"""Report of a trim: variables with their limits, equations, and outputs of the model."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from hfa_aircraft.model import Model, recognized
from hfa_support.errors import BadInputError
from hfa_support.reporting.report import Report
from hfa_support.reporting.results import given
from hfa_support.reporting.text import (
    Cell,
    Table,
    beside_unit,
    degrees,
    digits,
    short_number,
    shown_unit,
    shown_value,
)
from trim.linear.levels import Airplane, Graded, graded, levels_table
from trim.linear.modes import Mode, modes_table
from trim.point.condition import TrimCondition
from trim.point.configuration import (
    atmosphere_of,
    configuration_of,
    configuration_parts,
    reference_line,
    reference_of,
)
from trim.point.first_lines import control_lines, without_lines
from trim.point.margins import Margin
from trim.point.operating_point import OperatingPoint, point_records
from trim.point.performance import Figures, Quantity, figures_of
from trim.point.problem import STARTS, TrimProblem
from trim.point.status import BALANCE, Status
from trim.point.system import declared_start

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

#: Number of nearest limits that are listed, in addition to those that bind.
_NEAREST = 3
#: Condition number above which the scaled Jacobian counts as singular.
_SINGULAR = 1e12
_MARGIN_COLUMNS = ("value", "unit", "status", "lowest", "highest")
_NEAR_COLUMNS = ("nearest limit", "limit", "margin", "unit", "of its range", "verdict")
#: Figure -> name in the table, if it is not the name with blanks.
_CALLED = {
    "lift_over_drag": "L/D",
    "speed_over_stall_speed": "speed / stall speed",
    "neutral_point_behind_center_of_gravity": "neutral point behind c.g.",
    "CL_alpha": "CL_alpha",
    "Cm_alpha": "Cm_alpha",
    "calibrated_airspeed": "calibrated airspeed (KCAS)",
    "equivalent_airspeed": "equivalent airspeed (EAS)",
}
#: Figures that the first table of figures contains, in order.
_PERFORMANCE = (
    *("calibrated_airspeed", "equivalent_airspeed", "mach", "dynamic_pressure", "load_factor"),
    *("weight", "lift", "drag", "lift_over_drag", "thrust", "thrust_force", "thrust_available"),
    *("excess_thrust", "rate_of_climb_left", "power_required", "lift_coefficient"),
    *("largest_lift_coefficient", "speed_over_stall_speed", "drag_coefficient"),
)


def trim_report(
    model: Model,
    condition: TrimCondition,
    point: OperatingPoint,
    *,
    full: bool = False,
    airplane: Airplane | None = None,
) -> Report:
    """Return the report of a trim, or of the nearest point if the condition has no trim.

    The report contains every variable with its limits, the nearest limit, the configuration, loads
    and performance, static stability, validity, modes with the levels of MIL-F-8785C, other trims
    found, and the rates that are not balanced. Angles are in degrees in the text and in radians in
    the data.

    model: model of the aircraft
    condition: condition of the trim
    point: the trim or the nearest point
    full: whether to list each equation, every limit at which a variable is or which is near, and
        all outputs
    airplane: class and flight phase category for the levels; by default class I, category B
    """
    margins = point.margins_under(condition)
    # Variables whose limits matter: free ones, and held inputs.
    limited = [
        margin
        for name, margin in margins.items()
        if margin.nearer and (margin.role != "held" or name in model.inputs)
    ]
    nearest = sorted(limited, key=lambda margin: _rank(margin, margin.name in model.inputs))
    nearest = [
        margin for index, margin in enumerate(nearest) if index < _NEAREST or margin.at_limit
    ]
    search, sentences = _search(condition, point)
    equations = _equations(condition, point)
    rates = model.rates_at(point.states, point.inputs)
    unbalanced = {name: rate for name, rate in rates.items() if name not in condition.rates}
    figures = figures_of(point, condition) if point.ok else Figures()
    modes = point.modes if point.ok and not point.fault else ()
    of_levels = airplane or Airplane()
    levels = levels_of(point, of_levels)
    configuration = configuration_of(point)
    reference = reference_of(point)
    validity = {
        name: {"value": point[name], "lowest": low, "highest": high, "source": source}
        for name, (low, high, source) in model.domain.range.items()
    }
    data = {
        "schema": "hfa.trim/1",
        "dynamics": point.dynamics,
        "operating_point": point,
        "scaled_residuals": point.scaled_residuals,
        "balance_limit": BALANCE,
        "margins": {margin.name: margin.distance for margin in limited},
        "variables": margins,
        "nearest_limits": [margin.name for margin in nearest],
        "binding": [each.name for each in nearest if each.at_limit and each.role != "held"],
        "equations": equations,
        "rates_left": unbalanced,
        "controls": {
            name: margins[name].used for name in model.inputs if math.isfinite(margins[name].used)
        },
        "performance": {name: each.value for name, each in figures.performance.items()},
        "performance_units": {name: each.unit for name, each in figures.performance.items()},
        "stability": {name: each.value for name, each in figures.stability.items()},
        "stability_units": {name: each.unit for name, each in figures.stability.items()},
        "not_in_model": figures.not_in_model,
        "validity": validity,
        "modes": modes,
        "levels": levels,
        "airplane": {"class": of_levels.class_, "category": of_levels.category},
        "configuration": configuration,
        "search": search,
        "status": point.status,
        "warnings": point.warnings,
    } | given(
        dihedral_deg=point.dihedral_deg,
        scheduled=point.scheduled,
        doubts=model.about.doubts,
        atmosphere=model.about.atmosphere or None,
        reference=reference or None,
        stalled=figures.stalled,
    )
    lines: list[Any] = [
        _nearest_line(nearest) if not full else Table(_NEAR_COLUMNS, _nearest_rows(nearest)),
        _equations_part(point, equations, full),
        *sentences,
    ]
    if changing := _may_change(model, unbalanced):
        lines.append(changing)
    about = [*configuration_parts(point, configuration), *_about_lines(point, reference)]
    lines = [line for line in lines if line]
    parts = [*_variables(model, margins), *([tuple(lines)] if not full else lines), *about]
    parts += [*_figure_tables(figures, full), *_validity(model, validity)]
    if modes:
        parts.append(modes_table(modes, model.time_unit, participation=full))
        parts.append(levels_table(levels, of_levels, stated=airplane is not None))
    elif point.ok:
        parts.append(f"no modes: {point.fault}")
    controls = control_lines(point, margins, _lift_over_drag(figures))
    title = "\n".join(filter(None, [point.title, *figures.stalled, controls]))
    notes = point.warnings if full else without_lines(point.warnings)
    states = point_records(point)
    records = Table(states.header, [*states.rows, *_figure_records(figures, limited, modes, model)])
    report = Report(title, parts, notes, data, records)
    described = model.trimming.describe
    return report if described is None else described(point, report)


def _figure_records(
    figures: Figures, limited: Sequence[Margin], modes: Iterable[Mode], model: Model
) -> Iterator[tuple[str, str, float, str]]:
    """Yield rows (kind, name, value, unit) of the figures, the margins and the modes."""
    for kind, found in (("performance", figures.performance), ("stability", figures.stability)):
        yield from ((kind, each.name, each.value, each.unit) for each in found.values())
    for margin in limited:
        yield "margin", margin.name, margin.distance, margin.unit
    for mode in modes:
        yield "mode", f"{mode.name} real", mode.eigenvalue.real, f"1/{model.time_unit}"
        yield "mode", f"{mode.name} imaginary", mode.eigenvalue.imag, f"rad/{model.time_unit}"


def _about_lines(
    point: OperatingPoint, reference: Mapping[str, Mapping[str, Any]]
) -> Iterator[tuple[str, ...]]:
    """Yield the lines on the atmosphere and the condition of the derivatives together."""
    lines = [line for line in (atmosphere_of(point), reference_line(point, reference)) if line]
    if lines:
        yield tuple(lines)


def levels_of(point: OperatingPoint, airplane: Airplane) -> tuple[Graded, ...]:
    """Return the levels of the modes of a trim by MIL-F-8785C, () without a trim or a speed.

    airplane: class and category
    """
    if not point.ok or point.fault or "speed" not in recognized(point.model.states):
        return ()
    qualities = {each.name: each.value for each in point.handling_qualities}
    return graded(qualities, [mode.name for mode in point.modes], airplane)


def _variables(model: Model, margins: Mapping[str, Margin]) -> list[Any]:
    """Return a table of the states with their margins, and one of the inputs with their used
    shares, both with limits.
    """
    states, inputs = [], []
    for name, margin in margins.items():
        if name in model.inputs:
            inputs.append((*margin.row(), margin.used_text()))
        else:
            states.append((*margin.row(), margin.distance_text()))
    of_states = Table(("state", *_MARGIN_COLUMNS, "margin"), states)
    of_inputs = Table(("input", *_MARGIN_COLUMNS, "used"), inputs)
    if any(margin.nearer and margin.assumed for margin in margins.values()):
        note = "* assumed: no data of the aircraft state this limit"
        return [(of_states, note), of_inputs]
    return [of_states, of_inputs]


def _nearest_line(nearest: Sequence[Margin]) -> str:
    """Return a line on the nearest limit, or on each limit at which a variable is."""
    at_limit = [margin for margin in nearest if margin.at_limit]
    lines = []
    for margin in at_limit or nearest[:1]:
        limit = f"{margin.name} {margin.nearer} {shown_value(margin.nearer_limit, margin.unit)}"
        where = beside_unit(limit, margin.unit) + " (assumed)" * margin.assumed
        if margin.at_limit:
            verdict = "held there" if margin.role == "held" else "BINDS"
            lines.append(f"At its limit: {where}, {verdict}")
        else:
            distance, _ = degrees(margin.distance, margin.unit)
            share = "" if math.isnan(margin.share) else f", {100 * margin.share:.1f} % of its range"
            lines.append(f"Nearest limit: {where}; margin {float(distance):.4g}{share}")
    return "\n".join(lines)


def _equations_part(
    point: OperatingPoint, equations: dict[str, dict[str, Any]], full: bool
) -> Table | str:
    """Return the table of the equations, or one line if all balance and `full` is false."""
    if full or not equations or not all(entry["ok"] for entry in equations.values()):
        return _equations_table(point, equations)
    return (
        f"All {len(equations)} equations balance: largest residual {point.residual:.1e} of its "
        f"scale, tolerance {BALANCE:.0e}"
    )


def _may_change(model: Model, unbalanced: Mapping[str, float]) -> str:
    """Return a line with the rates that are not balanced and not 0: "speed changes by 2 ft/s^2"."""
    words = [
        f"{name} changes by {digits(float(shown_value(rate, unit, '.12g')))} {shown_unit(unit)}"
        for name, rate in unbalanced.items()
        for unit in (model.rate_unit(name),)
        if abs(rate) > BALANCE * model.rate_scale(name)
    ]
    return ", ".join(words)


def _figure_tables(figures: Figures, full: bool) -> Iterator[Any]:
    """Yield tables of loads and performance and of static stability, and what the model lacks."""
    known = figures.performance
    first = [name for name in _PERFORMANCE if name in known]
    others = [name for name in known if name not in first]
    lacking: dict[str, list[str]] = {}
    for name, reason in figures.not_in_model.items():
        lacking.setdefault(reason, []).append(name)
    lines = "\n".join(
        f"{', '.join(names)}: not in this model: {reason}" for reason, names in lacking.items()
    )
    performance = [_figure_row(known[name]) for name in first]
    stability = [_figure_row(each) for each in figures.stability.values()]
    if performance:
        yield Table(("loads and performance", "value", "unit"), performance)
    if stability:
        yield Table(("stability and control", "value", "unit"), stability), *_methods(figures)
    if lines:
        yield lines
    if full and others:
        yield Table(("output", "value", "unit"), [_figure_row(known[name]) for name in others])


def _methods(figures: Figures) -> Iterator[str]:
    """Yield lines on how the control gradients are computed."""
    if any(name.endswith("_per_g") for name in figures.stability):
        yield "per g: steady pull-up of the linear model; lags follow, other states held"
    if any(name.endswith("_per_knot") for name in figures.stability):
        yield "per knot: trims 0.5 kt slower and faster, other values of the condition held"


def _figure_row(quantity: Quantity) -> tuple[str, str, str]:
    name = _CALLED.get(quantity.name, quantity.name.replace("_", " "))
    unit = quantity.unit
    return name, short_number(quantity.value, unit), shown_unit(unit)


def _validity(model: Model, validity: Mapping[str, Mapping[str, Any]]) -> Iterator[Any]:
    """Yield a table of the ranges in which the model is valid, or that it states none."""
    if not validity:
        if "speed" in recognized(model.states):
            yield "validity: not in this model: no ranges of tables, no domain of the equations"
        return
    rows = []
    for name, entry in validity.items():
        unit = model.unit(name)
        numbers = [shown_value(entry[key], unit, ".5g") for key in ("value", "lowest", "highest")]
        inside = entry["lowest"] <= entry["value"] <= entry["highest"]
        verdict = Cell("inside", "good") if inside else Cell("OUTSIDE", "bad")
        rows.append((name, *numbers, shown_unit(unit), verdict, entry["source"]))
    yield Table(("validity", "value", "lowest", "highest", "unit", "verdict", "source"), rows)


def _lift_over_drag(figures: Figures) -> float | None:
    """Return lift divided by drag, or None if it is not in the model."""
    quantity = figures.performance.get("lift_over_drag")
    return None if quantity is None else quantity.value


def _rank(margin: Margin, is_input: bool) -> tuple[bool, bool, float]:
    """Return the key that sorts limits: those that bind, then the nearest."""
    # Assumed limits of a positive state may be decades apart: the distance to the lowest is also
    # compared with the value.
    # Variables with only one limit, and thus without a range, come after those with two.
    has_no_range = math.isinf(margin.highest - margin.lowest)
    share = margin.share
    if margin.assumed and not is_input and margin.nearer == "lowest" and margin.lowest >= 0.0:
        share = max(share, margin.distance / max(abs(margin.value), margin.scale))
    return not margin.at_limit, has_no_range, share


def _nearest_rows(nearest: Sequence[Margin]) -> list[tuple[str, ...]]:
    """Return table rows on the nearer limits of variables."""
    rows: list[tuple[str, ...]] = []
    for margin in nearest:
        verdict: str = "-"
        if margin.at_limit:
            verdict = "held there" if margin.role == "held" else Cell("BINDS", "far")
        row = (
            f"{margin.name}, {margin.nearer}" + ", assumed" * margin.assumed,
            shown_value(margin.nearer_limit, margin.unit),
            degrees(margin.distance, margin.unit)[0],
            shown_unit(margin.unit),
            f"{100 * margin.share:.1f} %",
            verdict,
        )
        rows.append(row)
    return rows


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
    problem = point._problem_of(condition)
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
    return [OperatingPoint._of(problem, z, Status.TRIMMED) for z in trims[1:]]


def _search(condition: TrimCondition, point: OperatingPoint) -> tuple[dict[str, Any], list[str]]:
    """Return data on the search for a trim, and sentences on unusual features of the search."""
    problem = point._problem_of(condition)
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
        sentences.append(f"Neither held nor determined, kept at the initial value: {names}")
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
    # in the model's units
    apart = np.abs(problem.unknowns(other.values) - problem.unknowns(point.values)) > 1e-3
    names = [problem.free[i] for i in np.flatnonzero(apart)]
    values = ", ".join(f"{name} {model.describe(name, other.values[name])}" for name in names)
    # states decide which trim is found; the search chooses the inputs that balance them
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
    from hfa_support.reporting.figure import pyplot_figure

    axes = pyplot_figure(7.0, _height(point)).subplots()
    _draw_variables(axes, point)
    return axes


def point_figure(point: OperatingPoint) -> Figure:
    """Return a figure of the variables of a trim in percent of their ranges, as in `draw_point`."""
    from hfa_support.reporting.figure import new_figure

    figure = new_figure(7.0, _height(point))
    _draw_variables(figure.subplots(), point)
    return figure


def _height(point: OperatingPoint) -> float:
    return 1.2 + 0.3 * len(_with_range(point))


def _with_range(point: OperatingPoint) -> list[Margin]:
    """Return the variables with two different limits, from the bottom of the figure."""
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
    return limited[::-1]


def _draw_variables(axes: Axes, point: OperatingPoint) -> None:
    limited = _with_range(point)
    shares = [100 * (each.value - each.lowest) / (each.highest - each.lowest) for each in limited]
    rows = range(len(limited))
    axes.hlines(rows, 0.0, 100.0, color="0.85", linewidth=5, zorder=1)
    axes.scatter(shares, rows, color=["C3" if each.at_limit else "C0" for each in limited])
    axes.set_yticks(rows, [" ".join(each.row()[:3]) for each in limited])
    axes.set_xlabel("share of the range between the limits, %; at a limit red")
    axes.set_title(point.title, fontsize=10)
