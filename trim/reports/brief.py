"""The short sheet of a terminal: the rows of a trim that are read first, within 40 lines."""

from __future__ import annotations

from dataclasses import replace

from hfa_support.reporting.report import Part, Report
from hfa_support.reporting.rows import Group, Row, Sheet
from trim.point.operating_point import OperatingPoint
from trim.point.status import TRIMMED
from trim.reports.first_lines import mode_lines, without_line_numbers
from trim.reports.levels import Airplane
from trim.reports.limits import ASSUMED, limit_rows, nearest_first
from trim.reports.matrix import result_of
from trim.reports.trim_report import VARIABLES, first_groups, title_with_controls
from trim.reports.trimmed import Trimmed

#: Group of a sheet -> names of the rows that are printed. A row with a tone is printed too.
_ROWS = {
    "condition": ("true airspeed", "calibrated airspeed", "mach", "ground speed", "track"),
    "performance": (
        "weight",
        "thrust",
        "thrust force",
        "thrust available",
        "rate of climb left",
        "speed / stall speed",
        "speed / stall speed at n",
        "stall speed at 1 g",
    ),
    "stability": ("static margin",),
}
#: Beginning or end of the name of a row that is printed too: distances from the condition of the
#: data, and stick-free gradients.
_ALSO = (" from the table's", " per g", " per knot")


def brief(point: OperatingPoint, airplane: Airplane) -> Report:
    """Return the report of a trim with the rows that are read first, and no others.

    These are airspeeds, variables that are not 0 with their limits, limits that are reached,
    performance, stability, the modes, and levels that are not 1.

    point: the trim
    airplane: class and flight phase category for the levels
    """
    trimmed = Trimmed(point)
    condition, variables, *others = first_groups(trimmed, airplane)
    reached = [margin for margin in nearest_first(trimmed) if margin.at_limit]
    groups = [condition, variables, ("limits", limit_rows(reached), ()), *others]
    sheet = Sheet.of(groups, first=VARIABLES)
    shown = [group for each in sheet.groups if (group := _shortened(each)).rows]
    modes = f"no modes: {trimmed.fault}"
    if not trimmed.fault:
        modes = mode_lines(trimmed.modes, point.model)
    sentences = trimmed.search.sentences
    of_the_file = without_line_numbers(point.model.about.notes)
    all_notes = without_line_numbers(point.warnings)
    notes = [note for note in all_notes if note not in of_the_file]
    left_out = "--full adds rows" + " and notes" * (len(notes) < len(all_notes))
    parts: list[Part] = [*shown]
    if modes:
        parts.append(modes)
    if sentences:
        parts.append(tuple(sentences))
    parts.append(f"{left_out}; -o FILE has all")
    return Report(title_with_controls(trimmed, sheet), parts, notes)


def brief_list(report: Report) -> Report:
    """Return the report of several trims with their overview, and the first lines of those that
    have no trim, are stalled, or are doubted. The data and records are those of the report.

    report: the overview, then a report for each trim
    """
    overview, *sheets = report.parts
    titles = [
        each.title
        for each in sheets
        if isinstance(each, Report) and result_of(each.sheet) != TRIMMED
    ]
    return replace(report, parts=[overview, *titles, "--full prints each sheet; -o FILE has all"])


def _shortened(group: Group) -> Group:
    """Return a group with the rows that are read first, and the meaning of the stars in them."""
    rows = tuple(row for row in group.rows if _is_read_first(group.title, row))
    has_star = any("*" in row.note for row in rows)
    return group._replace(rows=rows, lines=(ASSUMED,) if has_star else ())


def _is_read_first(title: str, row: Row) -> bool:
    """Return whether a short sheet prints a row of a group."""
    if row.rare or title == "configuration":  # the last line says what was changed
        return False
    match title:
        case "trim":
            return row.cells()[1] != "0"
        case "limits":
            return row.tone != ""
        case "modes and levels":
            return row.level is not None and row.level > 1
    is_named = row.name in _ROWS.get(title, ()) or row.name.endswith(_ALSO)
    is_load = row.name == "load factor" and row.cells()[1] != "1"
    return is_named or is_load or row.tone != ""
