"""The sheet of a trim, and its report: title, sheet, equations and notes."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Sequence
from functools import partial
from typing import Any

from hfa_aircraft.model import Model
from hfa_support.provenance import Change
from hfa_support.reporting.report import Report
from hfa_support.reporting.results import Entries, storable, without_empty
from hfa_support.reporting.rows import Group, Row, Sheet
from hfa_support.reporting.text import Table, five_decimals, shown_unit, shown_values
from trim.linear.modes import modes_table
from trim.point.operating_point import OperatingPoint
from trim.point.status import BALANCE
from trim.reports.configuration import configuration_lines, configuration_rows
from trim.reports.doubts import doubts_of
from trim.reports.first_lines import (
    condition_words,
    control_lines,
    engines_without_power,
    subject,
    title_of,
    uniqueness_lines,
    without_line_numbers,
)
from trim.reports.flight import flight_rows, same_as_the_table
from trim.reports.handling_qualities import mode_figures
from trim.reports.levels import DEFAULT_AIRPLANE, Airplane, chosen_airplane
from trim.reports.limits import ASSUMED, limit_rows, named_nearest, nearest_first, variable_rows
from trim.reports.matrix import asked_of, matrix
from trim.reports.performance import other_outputs, performance_rows, stall_lines
from trim.reports.search import balance_row, equations_of, equations_table
from trim.reports.stability import stability_rows
from trim.reports.trimmed import Trimmed

#: Title of the group whose rows have the names of the model's variables.
VARIABLES = "trim"


def sheet_of(point: OperatingPoint) -> Sheet:
    """Return the sheet of a trim: its figures as rows, found by name.

    The groups are condition, configuration, trim (variables with their limits), limits,
    performance, stability, modes with the levels of MIL-F-8785C for the class that weight and load
    factor suggest, and category B.

    point: the trim

    >>> import hfa
    >>> sheet = hfa.trim(hfa.aircraft()).sheet
    >>> round(sheet["static margin"].value, 4), sheet["static margin"].unit
    (0.4425, 'chord')
    """
    return sheet_at(Trimmed(point), DEFAULT_AIRPLANE)


def sheet_at(trimmed: Trimmed, airplane: Airplane) -> Sheet:
    """Return the sheet. Of a point that is not a trim, it has neither loads nor modes."""
    point = trimmed.point
    condition, variables, *others = first_groups(trimmed, airplane)
    configuration = ("configuration", configuration_rows(trimmed), configuration_lines(trimmed))
    groups = [condition, configuration, variables]
    groups.append(("limits", limit_rows(nearest_first(trimmed)), ()))
    if others:
        describe = point.model.trimming.describe
        of_model = [] if describe is None else describe(point)
        repeated = {row.name for _, rows, _ in of_model for row in rows}
        (title, rows, lines), *rest = others
        rows = [*rows, *other_outputs(trimmed, rows)]
        loads = [row for row in rows if row.name not in repeated]
        groups += [(title, loads, lines), *of_model, *rest]
    sheet = Sheet.of(groups, first=VARIABLES)
    return Sheet.of([*groups, ("findings", findings(trimmed, sheet, airplane), ())], VARIABLES)


def first_groups(trimmed: Trimmed, airplane: Airplane) -> list[tuple[str, Any, Any]]:
    """Return the groups of a sheet with the figures that are read first: condition, variables, and
    of a trim performance, stability and modes.
    """
    point = trimmed.point
    has_assumed = any(each.nearer and each.assumed for each in point.margins.values())
    variables = variable_rows(trimmed)
    variable_names = {row.name for row in variables}
    flight = [row for row in flight_rows(trimmed) if row.name not in variable_names]
    flight.append(balance_row(point))
    groups: list[tuple[str, Any, Any]] = [
        ("condition", flight, same_as_the_table(trimmed)),
        (VARIABLES, variables, [ASSUMED] if has_assumed else []),
    ]
    if point.ok:
        groups.append(("performance", performance_rows(trimmed), ()))
        groups.append(("stability", [*stability_rows(trimmed)], ()))
        groups.append(("modes and levels", *mode_figures(trimmed, airplane)))
    return groups


def findings(trimmed: Trimmed, sheet: Sheet, airplane: Airplane) -> list[Row]:
    """Return rows with what the first lines and the sentences of a sheet say, the limits that are
    reached, and the worst level.

    sheet: the other groups of the sheet
    """
    point = trimmed.point
    margins = point.margins.values()
    said: dict[str, Iterable[str]] = {
        "stalled": stall_lines(sheet),
        "doubts": doubts_of(trimmed),
        "not determined": uniqueness_lines(trimmed),
        "far out": point._large_angles,
        "engines out": engines_without_power(trimmed).values(),
        "limits reached": [each.name for each in nearest_first(trimmed) if each.at_limit],
        "assumed limits": [each.name for each in margins if each.nearer and each.assumed],
        "search": [*trimmed.search.sentences, *trimmed.search.unlimited],
        "notes": without_line_numbers(point.warnings),
    }
    for title, _, lines in sheet.groups:
        said[f"on {title}"] = [line for line in lines if line != ASSUMED]
    rows = [Row(name, _joined(words), rare=True) for name, words in said.items() if words]
    levels = {row.name: row for row in sheet if row.level is not None}
    if levels:
        chosen, why = chosen_airplane(trimmed, airplane)
        worst = max(levels.values(), key=lambda row: row.level or 0)
        named = [name for name, row in levels.items() if row.level == worst.level != 1]
        rows += [
            Row("airplane class", chosen.class_, note=why, rare=True),
            Row("flight phase category", chosen.category, rare=True),
            Row("worst level", worst.stated_level, note=", ".join(named), rare=True),
        ]
    return rows


def _joined(words: Iterable[str]) -> str:
    """Return names with commas between them, or sentences with semicolons."""
    return ("; " if any(" " in word for word in words) else ", ").join(words)


def report_of(
    trimmed: Trimmed, *, full: bool, airplane: Airplane, others: Sequence[Group] = ()
) -> Report:
    """Return the report of a trim with its sheet (`trim.trim_report`).

    others: figures of other models at the same condition
    """
    point = trimmed.point
    sheet = sheet_at(trimmed, airplane)
    head = {
        "aircraft": subject(point.model),
        "data": revision(point.model),
        "condition": ", ".join(condition_words(trimmed)),
    }
    return Report(
        title=title_with_controls(trimmed, sheet),
        parts=[*_parts(trimmed, sheet, full=full), *others],
        notes=point.warnings if full else without_line_numbers(point.warnings),
        data=Entries(partial(_data, trimmed, sheet)),
        records=matrix([asked_of(point)], [sheet]),
        head=head,
        sheet=sheet,
    )


def title_with_controls(trimmed: Trimmed, rows: Iterable[Row]) -> str:
    """Return the first lines of a sheet: those of the point, and below them alpha, controls, L/D.

    rows: rows of the sheet
    """
    controls = control_lines(trimmed, {row.name: row for row in rows}.get("L/D"))
    return "\n".join(filter(None, [title_of(trimmed), controls]))


def _parts(trimmed: Trimmed, sheet: Sheet, *, full: bool) -> list[Any]:
    """Return the parts of a report: the sheet, tables of equations and modes, and sentences on the
    search. The table of equations is also in a report that is not full if one does not balance.
    """
    point, search = trimmed.point, trimmed.search
    parts: list[Any] = [*sheet.shown(full)]
    equations = equations_of(point)
    if full or not all(entry["ok"] for entry in equations.values()):
        parts.append(equations_table(point, equations))
    if full and point.ok and trimmed.modes:
        parts.append(modes_table(trimmed.modes, point.model.time_unit))
    if search.sentences:
        parts.append(tuple(search.sentences))
    return [*parts, *search.unlimited]


def _data(trimmed: Trimmed, sheet: Sheet) -> dict[str, Any]:
    """Return the entries of the file of a trim, name -> value."""
    point = trimmed.point
    nearest = named_nearest(nearest_first(trimmed))
    return {
        "schema": "hfa.trim/1",
        "dynamics": point.dynamics,
        "operating_point": point,
        "status": point.status,
        "sheet": sheet.to_dict(),
        "not_in_model": sheet.lacking,
        "variables": point.margins,
        "nearest_limits": [margin.name for margin in nearest],
        "binding": [each.name for each in nearest if each.at_limit and each.role != "held"],
        "equations": equations_of(point),
        "scaled_residuals": point.scaled_residuals,
        "balance_limit": BALANCE,
        "modes": trimmed.modes if point.ok else (),
        "search": trimmed.search.data,
        "warnings": point.warnings,
    } | without_empty(
        dihedral_deg=point.dihedral_deg,
        scheduled=point.scheduled,
        doubts=doubts_of(trimmed),
        stalled=stall_lines(sheet),
    )


def revision(model: Model) -> str:
    """Return the file of an aircraft with its digest and the changed parameters, or the digest of
    its parameters.
    """
    model = model.native
    source = model.source
    if source.digest:
        changes = []
        for name, usual in model.changed.items():
            signal = model.parameters[name]
            change = Change(signal.start, usual, signal.unit)
            changes.append(f"{name} {change.words('as loaded')}")
        return ", ".join((f"{source.text} (SHA-256 {source.digest[:12]})", *changes))
    values = ",".join(
        f"{name}={value!r}" for name, value in zip(model.parameters, model.p.tolist(), strict=True)
    )
    return f"parameters (SHA-256 {hashlib.sha256(values.encode()).hexdigest()[:12]})"


def saved_report(point: OperatingPoint) -> Report:
    """Return a report of the states and inputs of a point that was not found by a search. Its
    records have the residuals too.
    """
    unit = point.model.unit
    rows: list[tuple[str, str, float, str]] = []
    for kind, values in (("state", point.states), ("input", point.inputs)):
        rows += [(kind, name, value, unit(name)) for name, value in values._asdict().items()]
    shown = [(kind, name, *five_decimals(value, unit)) for kind, name, value, unit in rows]
    for name, value in point.residuals.items():
        rows.append(("residual", name, value, point.equation_unit(name)))
    header = ("kind", "name", "value", "unit")
    records = [
        (kind, name, float(shown_values(value, unit)), shown_unit(unit))
        for kind, name, value, unit in rows
    ]
    notes = without_line_numbers(point.warnings)
    title = title_of(Trimmed(point))
    return Report(title, [Table(header, shown)], notes, storable(point), Table(header, records))
