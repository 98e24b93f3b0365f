"""Reports of several trims: their book and their figures."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from itertools import chain, cycle
from typing import TYPE_CHECKING, Any, NamedTuple

from hfa_aircraft.model import Model
from hfa_aircraft.signals import recognized
from hfa_support.errors import BadInputError
from hfa_support.reporting.parts import Picture
from hfa_support.reporting.report import Report
from hfa_support.reporting.rows import Row
from hfa_support.reporting.text import (
    WIDTH,
    Cell,
    Table,
    beside_unit,
    short_number,
    shown_value,
    shown_values,
    with_shown_unit,
    without_rounding,
    wrapped,
)
from trim.point.margins import Margin
from trim.point.operating_point import OperatingPoint
from trim.point.status import RESULTS, TRIMMED
from trim.reports.first_lines import first_lines, subject
from trim.reports.sheet import result_of
from trim.reports.trimmed import PARAMETER_OF_ENTRY, Quantity, Trimmed

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def point_figure(point: OperatingPoint) -> Figure:
    """Return a figure of the variables of a trim in percent of their ranges: the lowest limit is at
    0 %, the highest at 100 %. Variables without two different limits are omitted.

    Raises BadInputError if all variables are omitted.
    """
    from hfa_support.reporting.figure import new_figure

    limited = with_range(point)
    if not limited:
        raise BadInputError(
            "no variable has both a lower and an upper limit; declare min and max of a Signal"
        )
    figure = new_figure(7.0, 1.2 + 0.3 * len(limited))
    axes = figure.subplots()
    percents = [
        100 * (margin.value - margin.lowest) / (margin.highest - margin.lowest)
        for margin in limited
    ]
    names = [
        beside_unit(f"{margin.name} {shown_value(margin.value, margin.unit)}", margin.unit)
        for margin in limited
    ]
    axes.barh(names, 100.0, height=0.2, color="0.85")
    axes.scatter(percents, names, color=["C3" if margin.at_limit else "C0" for margin in limited])
    axes.set_xlabel("share of the range between the limits, %; at a limit red")
    axes.set_title(wrapped(first_lines(Trimmed(point)), WIDTH), fontsize=10)
    return figure


def with_range(point: OperatingPoint) -> list[Margin]:
    """Return the variables with two different limits, the last first: a figure begins at the
    bottom.
    """
    return [
        margin
        for margin in reversed(point.margins.values())
        if math.isfinite(margin.highest - margin.lowest) and margin.highest > margin.lowest
    ]


#: Column of the table of conditions -> row of a sheet.
_FIGURE_COLUMNS = {
    "n": "load factor",
    "L/D": "L/D",
    "static margin": "static margin",
    "worst level": "worst level",
}
#: Rows of a sheet with what its levels are of.
_CHOSEN = ("airplane class", "flight phase category")
#: Rows of a sheet whose sentences stand below the table of conditions.
_ROWS_BELOW_TABLE = ("failure", "stalled", "warnings", "far out", "not determined")
#: Entries of the configuration on the cover -> label.
_COVER_LABELS = {"mass": "mass", "center_of_gravity": "c.g."} | {
    f"center_of_gravity_{axis}": f"c.g. {axis}" for axis in "xyz"
}
#: Width of the figure, inches, and marks of its points.
_FIGURE_WIDTH = 10.5
_POINT_MARKS = "osD^v<>p*h"


class Condition(NamedTuple):
    """One of several conditions with its trim, for a book.

    name: name, or ""
    report: report of its trim
    point: the trim, or None if there is none
    """

    name: str
    report: Report
    point: OperatingPoint | None

    @property
    def result(self) -> str:
        """Result of the trim: "trimmed", "stalled", "with a warning" or "no trim"."""
        return result_of(self.report.sheet)

    @property
    def rows(self) -> dict[str, Row]:
        """Rows of the sheet by name."""
        return {row.name: row for row in self.report.sheet}


def book_of(
    overview: Report, conditions: Sequence[Condition], model: Model, head: Mapping[str, str]
) -> Report:
    """Return the document of several conditions: their table, its figure, and a sheet of each trim.

    overview: report of all conditions, with the data for other files
    conditions: each with its report and, if there is a trim, its operating point
    model: the aircraft as loaded
    head: further entries of the cover, label -> text
    """
    count, name = len(conditions), subject(model)
    numbered = []
    loaded: list[Mapping[str, Quantity]] = []  # configuration of each condition, {} without a trim
    for number, condition in enumerate(conditions, start=1):
        report, point = condition.report, condition.point
        if point is not None:
            title = f"{number} of {count}, {report.title}"
            report = replace(report, title=title, anchor=f"condition-{number}")
        numbered.append(condition._replace(report=report))
        loaded.append(_loaded(point))
    sheets = [condition.report for condition in numbered if condition.point is not None]
    drawn = partial(matrix_figure, conditions)
    figure = Picture("conditions.png", f"{name} at {count} conditions", drawn)
    return replace(
        overview,
        title=f"{name}, {count} conditions\n{overview.title}",
        parts=[_matrix(numbered, loaded), *([figure] if _panels(conditions) else []), *sheets],
        head={"aircraft": name, **head, **_cover(conditions, loaded, model)},
    )


def _called(conditions: Sequence[Condition]) -> list[str]:
    """Return number and name of each condition."""
    return [f"{number} {condition.name}".rstrip() for number, condition in enumerate(conditions, 1)]


# The cover


def _cover(
    conditions: Sequence[Condition], loaded: Sequence[Mapping[str, Quantity]], model: Model
) -> dict[str, str]:
    """Return label -> text of mass, center of gravity, class, category, atmosphere and failures.

    loaded: configuration of each condition, {} without a trim
    """
    texts = {}
    for name, label in _COVER_LABELS.items():
        known = [each[name] for each in loaded if name in each]
        if known:
            values, unit = [entry.value for entry in known], known[0].unit
            ends = [short_number(end, unit, 6) for end in (min(values), max(values))]
            texts[label] = beside_unit(" to ".join(dict.fromkeys(ends)), unit)
    for name in _CHOSEN:
        rows = [condition.rows[name] for condition in conditions if name in condition.rows]
        if rows:
            noted = (f"{row.value} ({row.note})".removesuffix(" ()") for row in rows)
            texts[name] = "; ".join(dict.fromkeys(noted))
    if model.about.atmosphere:
        texts["atmosphere"] = model.about.atmosphere
    by_result: dict[str, list[str]] = {}  # result -> number and name of its conditions
    for called, condition in zip(_called(conditions), conditions, strict=True):
        if condition.result != TRIMMED:
            by_result.setdefault(condition.result, []).append(called)
    return texts | {result: ", ".join(names) for result, names in by_result.items()}


# The matrix


class _Number(NamedTuple):
    """Number of a cell.

    value: number, in `unit`
    used: used share of the travel, percent, shown beside the number; nan for none
    tone: color of the cell, a key of `TONES`, or ""
    figures: significant digits
    """

    value: float
    unit: str
    used: float = math.nan
    tone: str = ""
    figures: int = 4

    @property
    def cell(self) -> Cell:
        """The cell."""
        text = short_number(self.value, self.unit, self.figures)
        if math.isfinite(self.used) and text != "0":
            text += f" ({self.used:.0f} %)"
        return Cell(text, self.tone)


def _used_controls(conditions: Sequence[Condition]) -> list[str]:
    """Return the inputs that are not 0 in some condition."""
    points = [condition.point for condition in conditions if condition.point is not None]
    used = {
        margin.name
        for point in points
        for margin in point.margins.values()
        if without_rounding(margin.value, margin.scale)
    }
    inputs = points[0].model.inputs if points else ()
    return [name for name in inputs if name in used]


def _matrix(
    conditions: Sequence[Condition], loaded: Sequence[Mapping[str, Quantity]]
) -> tuple[Table | str, ...]:
    """Return the table of conditions, with sentences on failures, stalls, warnings, large angles
    and variables that are not determined.

    loaded: configuration of each condition, {} without a trim
    """
    controls = _used_controls(conditions)
    entries: list[dict[str, Any]] = []
    notes = []
    labels = [label for label in _CHOSEN if len({_chosen(each, label) for each in conditions}) > 1]
    configurations = _configuration_cells(loaded, conditions)
    for called, condition, configuration in zip(
        _called(conditions), conditions, configurations, strict=True
    ):
        result = condition.result
        entries.append(
            {
                "condition": Cell(called, link=condition.report.anchor),
                "flight": condition.report.head.get("condition", ""),
                RESULTS: Cell(result, "" if result == TRIMMED else "bad"),
                **{label.rpartition(" ")[2]: _chosen(condition, label) for label in labels},
                **configuration,
                **_figure_cells(condition, controls),
            }
        )
        rows = condition.rows
        sentences = [str(rows[name].value) for name in _ROWS_BELOW_TABLE if name in rows]
        if sentences:
            notes.append(f"{called}: {'; '.join(sentences)}")
    header = tuple(dict.fromkeys(name for entry in entries for name in entry))
    cells = ([entry.get(name, "") for name in header] for entry in entries)
    table = [tuple(getattr(each, "cell", each) for each in row) for row in cells]
    return Table(header, table), *notes


def _chosen(condition: Condition, label: str) -> str:
    """Return the class or category of a condition, or ""."""
    rows = condition.rows
    return str(rows[label].value) if label in rows else ""


def _configuration_cells(
    loaded: Sequence[Mapping[str, Quantity]], conditions: Sequence[Condition]
) -> list[dict[str, Any]]:
    """Return for each condition the cells, by heading, of the entries and parameters that a
    condition sets or that are not the same in all conditions.
    """
    points = [condition.point for condition in conditions if condition.point is not None]
    changed = {name for point in points for name in point.model.changed}
    cells: list[dict[str, Any]] = [{} for _ in loaded]
    for name in dict.fromkeys(chain(*loaded)):
        known = {each[name] for each in loaded if name in each}
        if len(known) == 1 and PARAMETER_OF_ENTRY.get(name, name) not in changed:
            continue
        for of_condition, entries in zip(cells, loaded, strict=True):
            if name in entries:
                value, unit = entries[name]
                heading = with_shown_unit(_COVER_LABELS.get(name, name), unit)
                # A word, such as that of a gear, or a number with the digits of a weighing.
                number = _Number(value, unit, figures=5)
                of_condition[heading] = value if isinstance(value, str) else number
    return cells


def _loaded(point: OperatingPoint | None) -> dict[str, Quantity]:
    """Return the configuration of a condition, and the parameters that are no entry of it."""
    if point is None:
        return {}
    configuration, model = Trimmed(point).configuration, point.model
    names = (*_COVER_LABELS, "flap", "gear")
    entries = {name: configuration[name] for name in names if name in configuration}
    known = {PARAMETER_OF_ENTRY.get(name, name) for name in entries}
    return entries | {
        name: Quantity(signal.start, signal.unit)
        for name, signal in model.parameters.items()
        if name not in known
    }


def _figure_cells(condition: Condition, controls: Sequence[str]) -> dict[str, Any]:
    """Return the cells with alpha, the controls, and key figures of a trim, by heading."""
    point = condition.point
    if point is None:
        return {}
    cells: dict[str, Any] = {}
    alpha = recognized(point.model.states).get("alpha")
    if alpha:
        margin = point.margins[alpha]
        cells[with_shown_unit(alpha, margin.unit)] = _Number(margin.value, margin.unit)
    for name in controls:
        margin = point.margins[name]
        cells[with_shown_unit(name, margin.unit)] = _Number(
            margin.value,
            margin.unit,
            used=100.0 * margin.used,
            tone="bad" if margin.at_limit else "",
        )
    for heading, name in _FIGURE_COLUMNS.items():
        if row := condition.rows.get(name):
            if name == "worst level":
                text = f"{row.value} {row.note}".rstrip()
                cells[heading] = Cell(text, "bad" if row.value != 1 else "")
            else:
                cells[with_shown_unit(heading, row.unit)] = _Number(row.value, row.unit)
    return cells


# The figure


def matrix_figure(conditions: Sequence[Condition]) -> Figure:
    """Return a figure over the conditions: alpha, the used share of the travel of each control, and
    the static margin. A condition without a trim is grey, and a stalled trim or one with a warning
    is red.

    Raises BadInputError if no condition has one of them.
    """
    from hfa_support.reporting.figure import new_figure

    panels = _panels(conditions)
    if not panels:
        raise BadInputError("no condition has an alpha, a used control or a static margin to draw")
    called = _called(conditions)
    # The label of a condition needs 0.2 inches, and a panel 1.3.
    figure = new_figure(max(_FIGURE_WIDTH, 0.2 * len(called)), 1.2 + 1.3 * len(panels))
    all_axes = figure.subplots(len(panels), 1, sharex=True, squeeze=False)[:, 0]
    for axes, (heading, lines) in zip(all_axes, panels.items(), strict=True):
        for mark, (name, values) in zip(cycle(_POINT_MARKS), lines.items()):
            axes.plot(called, values, mark, markersize=4, label=name)
        for place, condition in enumerate(conditions):
            if condition.result != TRIMMED:
                color = "0.85" if condition.point is None else "#f4c7c3"  # light grey, light red
                axes.axvspan(place - 0.5, place + 0.5, color=color, zorder=0)
        axes.set_ylabel(heading, fontsize=8)
        axes.grid(axis="y", linewidth=0.4)
        if len(lines) > 1:
            axes.legend(fontsize=7, loc="center left", bbox_to_anchor=(1.0, 0.5))
    all_axes[-1].tick_params(axis="x", rotation=90, labelsize=8)
    return figure


def _panels(conditions: Sequence[Condition]) -> dict[str, dict[str, list[float]]]:
    """Return label of an axis -> name of a line -> its value at each condition, nan if it is
    unknown. Lines without a known value and axes without a line are left out.
    """
    controls = _used_controls(conditions)
    panels: dict[str, dict[str, list[float]]] = {}
    for place, condition in enumerate(conditions):
        for heading, cell in _figure_cells(condition, controls).items():
            name = heading.partition(" [")[0]
            if not isinstance(cell, _Number) or name in ("n", "L/D"):
                continue
            panel, value = heading, float(shown_values(cell.value, cell.unit))
            if name in controls:
                panel, value = "travel used, %", cell.used
            if math.isfinite(value):
                line = panels.setdefault(panel, {}).setdefault(name, [math.nan] * len(conditions))
                line[place] = value
    return panels
