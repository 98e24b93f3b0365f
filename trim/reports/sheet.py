"""The sheet of a trim, its report, and what of it is printed."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Container, Iterable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

from hfa_aircraft.model import Model
from hfa_support.errors import refuse_unknown
from hfa_support.provenance import Change
from hfa_support.reporting.parts import Part
from hfa_support.reporting.report import Report
from hfa_support.reporting.results import Entries, storable, without_empty
from hfa_support.reporting.rows import Group, Row, Sheet, matrix_of
from hfa_support.reporting.text import (
    Table,
    beside_unit,
    short_number,
    shown_value,
)
from trim.linear.modes import modes_table
from trim.point.condition import stated_cells, stated_values
from trim.point.margins import Margin
from trim.point.operating_point import OperatingPoint
from trim.point.status import BALANCE, FREE, LIMIT, RESULTS, STALLED, TRIMMED, UNTRIMMED, WARNED
from trim.reports.balances import balances_rows
from trim.reports.figures import (
    flight_rows,
    other_outputs,
    performance_rows,
    stability_rows,
    stall_lines,
)
from trim.reports.first_lines import (
    condition_words,
    first_lines,
    mode_lines,
    subject,
    title_with_controls,
    uniqueness_lines,
    without_line_numbers,
)
from trim.reports.levels import (
    DEFAULT_AIRPLANE,
    Airplane,
    chosen_airplane,
    level_lines,
    mode_rows,
)
from trim.reports.trimmed import Trimmed, balance_row, equations_group, equations_of
from trim.reports.warnings import configuration_rows, inertia_lines, warnings_of

#: Verdict on a free variable at its limit.
_BINDS = "BINDS"
#: Meaning of the star beside a limit.
ASSUMED = "* assumed: no data of the aircraft state this limit"


def variable_rows(trimmed: Trimmed) -> list[Row]:
    """Return a row for each state, relevant output and input, with its role in the trim and its
    limits as note.
    """
    rows = []
    for name, margin in trimmed.point.margins.items():
        role = "imposed" if margin.role == "held" else margin.role
        limits = _limits_text(margin, name in trimmed.model.inputs)
        note = f"{role}, {limits}" if limits else role
        rows.append(Row(name, margin.value, margin.unit, note, digits=6))
    return rows


def _limits_text(margin: Margin, is_input: bool) -> str:
    """Return the limits of an input as "±25, 12 % used", and those of another variable as "0* to
    60*, margin 5". The text is "" without limits. A star marks assumed limits.
    """
    if not margin.nearer:
        return ""
    star = "*" if margin.assumed else ""
    low, high = (
        f"{shown_value(end, margin.unit)}{star}" for end in (margin.lowest, margin.highest)
    )
    if math.isinf(margin.lowest):
        limits = f"up to {high}"
    elif math.isinf(margin.highest):
        limits = f"from {low}"
    elif margin.lowest == -margin.highest:
        limits = f"±{high}"
    else:
        limits = f"{low} to {high}"
    if is_input:
        return limits if math.isnan(margin.used) else f"{limits}, {100 * margin.used:.1f} % used"
    return f"{limits}, margin {short_number(margin.distance, margin.unit)}"


def nearest_first(trimmed: Trimmed) -> list[Margin]:
    """Return the variables whose limits matter: reached limits come first, then declared ones, then
    limits of variables with two limits, and among equals the nearest in shares of the range.

    These are free variables and held inputs, whose travel is limited too; a held state is where the
    condition demands it.
    """
    inputs, margins = trimmed.model.inputs, trimmed.point.margins.values()
    limited = [
        each for each in margins if each.nearer and (each.role != "held" or each.name in inputs)
    ]
    return sorted(
        limited,
        key=lambda each: (
            not each.at_limit,
            each.assumed,
            math.isinf(each.highest - each.lowest),
            each.share,
        ),
    )


def limit_rows(limited: Sequence[Margin]) -> list[Row]:
    """Return a row for the margin of each variable. Only a full sheet prints that of a limit that
    is not reached.

    limited: the variables, the nearest limit first (`nearest_first`)
    """
    rows = []
    for margin in limited:
        verdict = _verdict(margin)
        words = [verdict, _limit_text(margin), "assumed" if margin.assumed else ""]
        row = Row(
            f"{margin.name} margin",
            margin.distance,
            margin.unit,
            ", ".join(filter(None, words)),
            tone="far" if verdict == _BINDS else "",
            rare=not verdict,
        )
        rows.append(row)
    return rows


def _verdict(margin: Margin) -> str:
    """Return "" within the limits, "held there" at a limit at which the condition holds the
    variable, and "BINDS" at a limit to which the trim has moved a free one.
    """
    if not margin.at_limit:
        return ""
    return "held there" if margin.role == "held" else _BINDS


def _limit_text(margin: Margin) -> str:
    """Return the nearer limit as text: "thrust lowest 0 N"."""
    value = short_number(margin.nearer_limit, margin.unit, 6)
    return beside_unit(f"{margin.name} {margin.nearer} {value}", margin.unit)


def result_of(sheet: Sheet) -> str:
    """Return the result of a trim by its sheet: TRIMMED, STALLED, WARNED or UNTRIMMED."""
    names = {row.name for row in sheet}
    for row, result in (("failure", UNTRIMMED), ("stalled", STALLED), ("warnings", WARNED)):
        if row in names:
            return result
    return TRIMMED


def asked_of(point: OperatingPoint) -> dict[str, Any]:
    """Return the cells that state the condition of a point: values, free variables, limits."""
    model = point.model
    stated = stated_values(point.trim_problem.asked)
    # Changed parameters are a part of the condition.
    changed = {
        name: model.parameters[name].start for name in model.changed if name not in stated.free
    }
    return stated_cells(model, stated._replace(held={**stated.held, **changed}))


def matrix(asked: Sequence[Mapping[str, Any]], sheets: Sequence[Sheet]) -> Table:
    """Return the table of trims: what was asked, the column `results`, and what was found.

    A file of conditions may be this table: its columns before `results` state the conditions.

    asked: heading -> cell that states a part of a condition, for each trim (`stated_cells`)
    """
    found = matrix_of(sheets)
    headings = [*dict.fromkeys(heading for cells in asked for heading in cells)]
    last = [heading for heading in (FREE, LIMIT) if heading in headings]
    headings = [heading for heading in headings if heading not in last] + last
    # The note of the row "worst level" names the qualities that have this level.
    worst = [{row.name: row.note for row in sheet}.get("worst level", "") for sheet in sheets]
    rows = [
        (*(cells.get(heading, "") for heading in headings), result_of(sheet), *row, qualities)
        for cells, sheet, row, qualities in zip(asked, sheets, found.rows, worst, strict=True)
    ]
    return Table((*headings, RESULTS, *found.header, "qualities of the worst level"), rows)


#: Title of the group whose rows have the names of the model's variables.
VARIABLES = "trim"
#: Group of a sheet: title, figures, and sentences below them.
_Titled = tuple[str, Any, Sequence[str]]


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
    """Return the sheet of a point. A point that is not a trim has no loads and no modes."""
    point = trimmed.point
    variables = variable_rows(trimmed)
    groups: list[_Titled] = [
        (
            "condition",
            [*flight_rows(trimmed), balance_row(point), *balances_rows(trimmed)],
            (),
        ),
        ("configuration", configuration_rows(trimmed), inertia_lines(trimmed)),
        (VARIABLES, variables, _meaning_of_stars(variables)),
        ("limits", limit_rows(nearest_first(trimmed)), ()),
    ]
    if point.ok:
        describe = point.model.trimming.describe  # function: point -> groups of its own
        of_model = [] if describe is None else describe(point)
        repeated = {row.name for _, rows, _ in of_model for row in rows}
        loads = performance_rows(trimmed)
        loads += other_outputs(trimmed, loads)
        modes = mode_rows(trimmed, airplane)
        groups += [
            ("performance", [row for row in loads if row.name not in repeated], ()),
            *of_model,
            ("stability", [*stability_rows(trimmed)], ()),
            ("modes and levels", modes, level_lines(trimmed, airplane, modes)),
        ]
    without_findings = Sheet.of(groups, first=VARIABLES)
    found = findings(trimmed, without_findings, airplane)
    return Sheet.of([*groups, ("findings", found, ())], VARIABLES)


def findings(trimmed: Trimmed, sheet: Sheet, airplane: Airplane) -> list[Row]:
    """Return the rows of the group "findings", which repeat first lines and sentences of the
    groups, with the limits that are reached and the worst level.

    sheet: the other groups of the sheet
    """
    point = trimmed.point
    said: dict[str, Iterable[str]] = {  # row -> sentences, or names
        "stalled": stall_lines(trimmed),
        "warnings": warnings_of(trimmed),
        "not determined": uniqueness_lines(trimmed),
        "far out": point._large_angles,
        "limits reached": [margin.name for margin in nearest_first(trimmed) if margin.at_limit],
        "assumed limits": [
            margin.name for margin in point.margins.values() if margin.nearer and margin.assumed
        ],
        "search": trimmed.search,
        "notes": without_line_numbers(point.warnings),
    }
    for title, _, lines in sheet.groups:
        said[f"on {title}"] = [line for line in lines if line != ASSUMED]

    # A rare row is printed in a full sheet only. Sentences are separated by semicolons.
    rows = []
    for name, words in said.items():
        are_sentences = any(" " in word for word in words)
        separator = "; " if are_sentences else ", "
        if words:
            rows.append(Row(name, separator.join(words), rare=True))

    levels = {row.name: row for row in sheet if row.level is not None}
    if levels:
        chosen, why = chosen_airplane(trimmed, airplane)
        worst = max(levels.values(), key=lambda row: row.level or 0)
        # At level 1, all qualities have the worst level, and none is named.
        named = [name for name, row in levels.items() if row.level == worst.level != 1]
        rows += [
            Row("airplane class", chosen.class_, note=why, rare=True),
            Row("flight phase category", chosen.category, rare=True),
            Row("worst level", worst.stated_level, note=", ".join(named), rare=True),
        ]
    return rows


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


def _parts(trimmed: Trimmed, sheet: Sheet, *, full: bool) -> list[Any]:
    """Return the groups of the sheet, tables of the equations and modes, and sentences on the
    search.

    full: whether to add rare rows and the tables; that of the equations is always there if one does
        not balance
    """
    point = trimmed.point
    parts: list[Any] = [*sheet.shown(full)]
    if full or point.residual > BALANCE:
        parts.append(equations_group(point))
    if full and point.ok and trimmed.modes:
        parts.append(modes_table(trimmed.modes, point.model.time_unit))
    if trimmed.search:
        parts.append(tuple(trimmed.search))
    return parts


def _data(trimmed: Trimmed, sheet: Sheet) -> dict[str, Any]:
    """Return the entries of the file of a trim, name -> value."""
    point = trimmed.point
    return {
        "schema": "hfa.trim/1",
        "dynamics": point.dynamics,
        "operating_point": point,
        "status": point.status,
        "sheet": sheet.to_dict(),
        "not_in_model": sheet.lacking,
        "variables": point.margins,
        "equations": equations_of(point),
        "modes": trimmed.modes if point.ok else (),
        # Without warnings of the trim, the notes of the point; else the sheet has these in "notes".
        "warnings": [*warnings_of(trimmed)] or point.warnings,
    } | without_empty(
        dihedral_deg=point.dihedral_deg,
        scheduled=point.scheduled,
        stalled=stall_lines(trimmed),
    )


def revision(model: Model) -> str:
    """Return the file of an aircraft with its digest and the changed parameters; without a file,
    the digest of the parameters.
    """
    model = model.native  # in the units of the file
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
    """Return a report of the values of a point that was not found by a search."""
    unit_of = point.model.unit
    rows = [Row(name, value, unit_of(name), digits=6) for name, value in dict(point).items()]
    sheet = Sheet.of([(VARIABLES, rows, ())])
    notes = without_line_numbers(point.warnings)
    title = first_lines(Trimmed(point))
    return Report(title, sheet.shown(False), notes, storable(point), matrix_of([sheet]))


#: Rows that are read first, in addition to variables and to rows with a tone of `_JUDGED`.
_READ_FIRST = (
    *("true airspeed", "calibrated airspeed", "mach", "ground speed", "track", "balances"),
    *("weight", "thrust", "thrust force", "thrust available", "rate of climb left"),
    *("speed / stall speed", "speed / stall speed at n", "stall speed at 1 g", "static margin"),
)
_JUDGED = ("far", "bad")
#: Ends of the names of further rows that are read first: distances from the condition of the data,
#: and control gradients.
_ENDS_READ_FIRST = (" from the table's", " per g", " per knot")


def brief(point: OperatingPoint, airplane: Airplane, show: Sequence[str] = ()) -> Report:
    """Return the report of a trim with the rows that are read first, and no others.

    These are airspeeds, variables that are not 0 with their limits, limits that are reached,
    performance, stability, the modes, and levels that are not 1.

    point: the trim
    airplane: class and flight phase category for the levels
    show: further outputs

    Raises BadInputError for a name that is no output.
    """
    outputs = point.model.outputs
    for name in show:
        refuse_unknown("--show names the unknown output", name, outputs)
    chosen = {n.replace("_", " ") for n in outputs if n in show or outputs[n].show}
    trimmed = Trimmed(point)
    sheet = sheet_at(trimmed, airplane)

    fault = trimmed.fault
    modes = f"no modes: {fault}" if fault else mode_lines(trimmed.modes, point.model)
    # Notes on the trim are printed; those on the aircraft's file only with --full.
    of_the_file = without_line_numbers(point.model.about.notes)
    all_notes = without_line_numbers(point.warnings)
    notes = [note for note in all_notes if note not in of_the_file]
    adds = "rows" if len(notes) == len(all_notes) else "rows and notes"

    shortened = (_shortened(group, chosen) for group in sheet.groups)
    parts: list[Part] = [group for group in shortened if group.rows]
    if modes:
        parts.append(modes)
    if trimmed.search:
        parts.append(tuple(trimmed.search))
    parts.append(f"--full adds {adds}; -o FILE has all")
    return Report(title_with_controls(trimmed, sheet), parts, notes)


def brief_list(report: Report) -> Report:
    """Return the report of several trims with their overview, and the first lines of those that
    have no trim, are stalled, or have a warning. The data and records are those of the report.

    report: the overview, then a report for each trim
    """
    overview, *sheets = report.parts
    titles = [
        part.title
        for part in sheets
        if isinstance(part, Report) and result_of(part.sheet) != TRIMMED
    ]
    return replace(report, parts=[overview, *titles, "--full prints each sheet; -o FILE has all"])


def _shortened(group: Group, chosen: Container[str]) -> Group:
    """Return a group with the rows that are read first, and chosen ones.

    These are the variables that are not printed as 0, a load factor that is not printed as 1, the
    rows named in `_READ_FIRST` or by `_ENDS_READ_FIRST`, and judged rows, which have a tone.
    """
    rows = []
    for row in group.rows:
        is_read_first = row.name in _READ_FIRST or row.name.endswith(_ENDS_READ_FIRST)
        if group.title == VARIABLES:
            is_read_first = row.cells().value != "0"
        elif row.name == "load factor":
            is_read_first = row.cells().value != "1"
        elif row.level is not None:
            is_read_first = row.level > 1
        if row.name in chosen or ((is_read_first or row.tone in _JUDGED) and not row.rare):
            rows.append(row)
    return group._replace(rows=tuple(rows), lines=_meaning_of_stars(rows))


def _meaning_of_stars(rows: Iterable[Row]) -> tuple[str, ...]:
    """Return the meaning of the stars in the notes of rows, or () if there is none."""
    return (ASSUMED,) if any("*" in row.note for row in rows) else ()
