"""The document of several trims: cover, matrix of conditions with a figure, and the sheets."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from itertools import cycle
from typing import TYPE_CHECKING, NamedTuple

from hfa_aircraft.model import Model
from hfa_support.errors import BadInputError
from hfa_support.reporting.parts import Picture
from hfa_support.reporting.report import Report
from hfa_support.reporting.text import (
    Cell,
    Table,
    beside_unit,
    is_zero,
    short_number,
    shown_values,
    with_shown_unit,
)
from trim.point.margins import Margin
from trim.point.operating_point import OperatingPoint
from trim.point.status import RESULTS, TRIMMED
from trim.reports.configuration import PARAMETER_OF_ENTRY, Quantity, configuration_of
from trim.reports.first_lines import subject
from trim.reports.matrix import result_of
from trim.reports.trimmed import Trimmed

if TYPE_CHECKING:
    from matplotlib.figure import Figure

#: Column of the matrix -> row of a sheet.
_KEY_FIGURES = {
    "n": "load factor",
    "L/D": "L/D",
    "static margin": "static margin",
    "worst level": "worst level",
}
#: Rows of a sheet whose sentences stand below the matrix.
_SAID = ("failure", "stalled", "doubts", "far out", "not determined")
#: Entries of the configuration on the cover -> label.
_LOADED = {"mass": "mass", "center_of_gravity": "c.g."} | {
    f"center_of_gravity_{axis}": f"c.g. {axis}" for axis in "xyz"
}
#: Width of the figure, inches, and marks of its points.
_WIDTH = 10.5
_MARKS = "osD^v<>p*h"


class Condition(NamedTuple):
    """One of several conditions.

    name: name, or ""
    report: report of its trim
    point: the trim, or None if there is none
    """

    name: str
    report: Report
    point: OperatingPoint | None

    @property
    def result(self) -> str:
        """Result of the trim: "trimmed", "stalled", "doubted" or "no trim"."""
        return result_of(self.report.sheet)


def book_of(
    overview: Report, conditions: Sequence[Condition], model: Model, head: Mapping[str, str]
) -> Report:
    """Return the document of several conditions: the matrix, its figure, and a sheet for each trim.

    overview: report of all conditions, with the data for other files
    conditions: each with its report and, if there is a trim, its operating point
    model: the aircraft as loaded
    head: further entries of the cover, label -> text
    """
    count = len(conditions)
    conditions = [_numbered(number, count, each) for number, each in enumerate(conditions, start=1)]
    sheets = [each.report for each in conditions if each.point is not None]
    name = subject(model)
    drawn = partial(matrix_figure, conditions)
    figure = Picture("conditions.png", f"{name} at {count} conditions", drawn)
    has_curves = bool(_panels(conditions))
    return replace(
        overview,
        title=f"{name}, {count} conditions\n{overview.title}",
        parts=[_matrix(conditions), *([figure] if has_curves else []), *sheets],
        head={"aircraft": name, **head, **_loading(conditions)},
    )


def _numbered(number: int, count: int, condition: Condition) -> Condition:
    """Return a condition whose report has its number in the title, and a key for links."""
    if condition.point is None:
        return condition
    report = condition.report
    title = f"{number} of {count}, {report.title}"
    return condition._replace(report=replace(report, title=title, anchor=f"condition-{number}"))


# The cover


def _loading(conditions: Sequence[Condition]) -> dict[str, str]:
    """Return label -> text of the mass and the center of gravity: as the aircraft was loaded, and
    over the conditions.
    """
    points = [condition.point for condition in conditions if condition.point is not None]
    configurations = [configuration_of(Trimmed(point)) for point in points]
    texts = {}
    for name, label in _LOADED.items():
        known = [
            (point, configuration[name])
            for point, configuration in zip(points, configurations, strict=True)
            if name in configuration
        ]
        if known:
            texts[label] = _loading_text(name, known)
    return texts


def _loading_text(name: str, known: Sequence[tuple[OperatingPoint, Quantity]]) -> str:
    """Return an entry of the configuration as text: "14 kg as loaded; 13.5 to 15 kg in the
    conditions".

    known: trim, and the entry there
    """
    unit = known[0][1].unit
    values = [entry.value for _, entry in known]
    lowest, highest = (short_number(end, unit, 6) for end in (min(values), max(values)))
    range_text = lowest if lowest == highest else f"{lowest} to {highest}"
    in_conditions = f"{beside_unit(range_text, unit)} in the conditions"
    for point, entry in known:
        loaded = _as_loaded(point, name, entry.value)
        if loaded is not None:
            loaded_text = short_number(loaded, unit, 6)
            as_loaded = f"{beside_unit(loaded_text, unit)} as loaded"
            return as_loaded if loaded_text == range_text else f"{as_loaded}; {in_conditions}"
    return in_conditions


def _as_loaded(point: OperatingPoint, name: str, value: float) -> float | None:
    """Return an entry of the configuration as the aircraft was loaded, or None where it is unknown
    because it may depend on a changed parameter.

    value: the entry at the point
    """
    changed = point.model.changed
    parameter = PARAMETER_OF_ENTRY.get(name, name)
    if parameter in changed:
        return changed[parameter]
    return value if parameter in point.model.parameters or not changed else None


# The matrix


def _used_controls(conditions: Sequence[Condition]) -> list[str]:
    """Return the inputs that are not 0 in some condition."""
    points = [condition.point for condition in conditions if condition.point is not None]
    if not points:
        return []

    def is_used(name: str) -> bool:
        """Return whether an input is not 0 in some condition."""
        margins = [point.margins[name] for point in points]
        return not all(is_zero(margin.value, margin.scale) for margin in margins)

    return [*filter(is_used, points[0].model.inputs)]


def _matrix(conditions: Sequence[Condition]) -> tuple[Table | str, ...]:
    """Return the table of conditions, with sentences on those that are not plainly trimmed."""
    controls = _used_controls(conditions)
    entries = []
    notes = []
    for number, condition in enumerate(conditions, start=1):
        called = f"{number} {condition.name}".rstrip()
        entries.append({**_name_cells(condition, called), **_figure_cells(condition, controls)})
        values = {row.name: str(row.value) for row in condition.report.sheet}
        sentences = [values[name] for name in _SAID if name in values]
        if sentences:
            notes.append(f"{called}: {'; '.join(sentences)}")
    header = tuple(dict.fromkeys(name for entry in entries for name in entry))
    table = Table(header, [tuple(entry.get(name, "") for name in header) for entry in entries])
    return table, *notes


def _name_cells(condition: Condition, called: str) -> dict[str, str]:
    """Return the cells with the name, the flight and the result of a condition, by heading."""
    tone = "" if condition.result == TRIMMED else "bad"
    flight = condition.report.head.get("condition", "")
    link = condition.report.anchor
    return {
        "condition": Cell(called, link=link),
        "flight": flight,
        RESULTS: Cell(condition.result, tone),
    }


def _figure_cells(condition: Condition, controls: Sequence[str]) -> dict[str, str]:
    """Return the cells with alpha, the controls, and key figures of a trim, by heading."""
    point = condition.point
    if point is None:
        return {}
    cells: dict[str, str] = {}
    alpha = Trimmed(point).roles.get("alpha")
    if alpha:
        margin = point.margins[alpha]
        cells[with_shown_unit(alpha, margin.unit)] = Cell(short_number(margin.value, margin.unit))
    for name in controls:
        margin = point.margins[name]
        cells[with_shown_unit(name, margin.unit)] = _control_cell(margin)
    rows = {row.name: row for row in condition.report.sheet}
    for heading, name in _KEY_FIGURES.items():
        if name in rows:
            _name, value, unit, _note = rows[name].cells()
            tone = "bad" if name == "worst level" and value != "1" else ""
            cells[f"{heading} [{unit}]" if unit else heading] = Cell(value, tone)
    return cells


def _control_cell(margin: Margin) -> Cell:
    """Return the value of a control with the used share of its travel: "-1.37 (5 %)"."""
    text = short_number(margin.value, margin.unit)
    if math.isfinite(margin.used) and text != "0":
        text = f"{text} ({100.0 * margin.used:.0f} %)"
    return Cell(text, "bad" if margin.at_limit else "")


# The figure


def matrix_figure(conditions: Sequence[Condition]) -> Figure:
    """Return a figure of alpha, of the used share of the travel of each control, and of the static
    margin over the conditions. Conditions without a trim are grey, those that are stalled or
    doubted red.

    Raises BadInputError if no condition has one of them.
    """
    from hfa_support.reporting.figure import new_figure

    panels = _panels(conditions)
    if not panels:
        raise BadInputError("no condition has an alpha, a used control or a static margin to draw")
    count = len(conditions)
    figure = new_figure(max(_WIDTH, 0.2 * count), 1.2 + 1.3 * len(panels))
    all_axes = figure.subplots(len(panels), 1, sharex=True, squeeze=False)[:, 0]
    for axes, (heading, lines) in zip(all_axes, panels.items(), strict=True):
        marks = cycle(_MARKS)
        for name, values in lines.items():
            axes.plot(range(count), values, next(marks), markersize=4, label=name)
        for place, condition in enumerate(conditions):
            if condition.result != TRIMMED:
                color = "0.85" if condition.point is None else "#f4c7c3"
                axes.axvspan(place - 0.5, place + 0.5, color=color, zorder=0)
        axes.set_ylabel(heading, fontsize=8)
        axes.tick_params(labelsize=8)
        axes.grid(axis="y", linewidth=0.4)
        if len(lines) > 1:
            axes.legend(fontsize=7, loc="center left", bbox_to_anchor=(1.0, 0.5))
    names = [f"{number} {each.name}".rstrip() for number, each in enumerate(conditions, start=1)]
    all_axes[-1].set_xticks(range(count), names, rotation=90, fontsize=8)
    all_axes[-1].set_xlim(-0.5, count - 0.5)
    return figure


def _panels(conditions: Sequence[Condition]) -> dict[str, dict[str, list[float]]]:
    """Return label of an axis -> name of a line -> its value at each condition, or nan.

    Lines of nan alone, and panels without a line, are omitted.
    """
    points = [condition.point for condition in conditions]
    first = next((point for point in points if point is not None), None)
    alpha = None if first is None else Trimmed(first).roles.get("alpha")
    panels: dict[str, dict[str, list[float]]] = {}
    if first is not None and alpha:
        unit = first.model.unit(alpha)
        angles = [
            math.nan if point is None else float(shown_values(point[alpha], unit))
            for point in points
        ]
        panels[beside_unit(f"{alpha},", unit)] = {alpha: angles}
    panels["travel used, %"] = {
        control: [
            math.nan if point is None else 100.0 * point.margins[control].used for point in points
        ]
        for control in _used_controls(conditions)
    }
    panels["static margin, chord"] = {"static margin": [*map(_static_margin, conditions)]}
    drawn = {}
    for label, lines in panels.items():
        known = {name: line for name, line in lines.items() if not all(map(math.isnan, line))}
        if known:
            drawn[label] = known
    return drawn


def _static_margin(condition: Condition) -> float:
    """Return the static margin of a trim, or nan."""
    rows = {row.name: row for row in condition.report.sheet}
    if condition.point is None or "static margin" not in rows:
        return math.nan
    return float(rows["static margin"].value)
