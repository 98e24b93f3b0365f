"""The command `hfa trim`."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

from hfa.options.advice import trimmed
from hfa.options.command import Outcome, Request, command, output_option, picture_option
from hfa.options.conditions import ListedCondition, airplane_class, flight_category
from hfa.options.parser import option, refuse
from hfa.options.points import GivenPoints, PointOptions, given_points
from hfa.options.trims import TrimInput, trim_input
from hfa_aircraft.model import Model
from hfa_support.errors import BadInputError
from hfa_support.reporting.parts import Picture
from hfa_support.reporting.report import Report
from hfa_support.reporting.results import Entries
from hfa_support.reporting.rows import Row, Sheet
from hfa_support.reporting.text import Table
from trim.hfa.reports import trim_figure, trim_report
from trim.point.condition import stated_cells
from trim.point.solve import TrimError
from trim.point.status import (
    CATEGORY,
    CLASS,
    NAME,
    RESULTS,
    STALLED,
    TRIMMED,
    UNTRIMMED,
    WARNED,
)
from trim.reports.book import Condition, book_of, matrix_figure, with_range
from trim.reports.levels import CATEGORIES, CLASSES, Airplane
from trim.reports.sheet import brief, brief_list, matrix, revision

if TYPE_CHECKING:
    from trim.point.operating_point import OperatingPoint

#: Largest number of sheets.
_MOST_SHEETS = 100


@dataclass(frozen=True, kw_only=True, eq=False)
class TrimRequest(Request, PointOptions):
    """Options of `hfa trim`."""

    needs_dihedral: ClassVar = True

    output: Path | None = output_option(".pdf")
    picture: Path | None = picture_option(
        "the HFA from the front with its loads, the variables of another aircraft in their "
        "limits, or alpha, controls and static margin of several conditions"
    )
    document: str = option("number and revision, in the head of files of -o", "TEXT", default="")
    full: bool = option("print all figures, outputs, equations, limits and participations")
    show: tuple[str, ...] = option(
        "print an output on the short sheet; repeatable", "NAME", repeated=True
    )
    class_: str = option(
        f"airplane class of MIL-F-8785C: {', '.join(CLASSES)}; default by weight",
        "CLASS",
        airplane_class,
        default="",
        rare=True,
    )
    category: str = option(
        f"flight phase category of MIL-F-8785C: {', '.join(CATEGORIES)}; default B",
        "CATEGORY",
        flight_category,
        default="B",
        rare=True,
    )


@command(TrimRequest, trim_input)
def trim(request: TrimRequest, given: TrimInput) -> Outcome:
    """Trim the aircraft and print a sheet: variables, limits, configuration, loads, performance,
    stability, modes and their levels by MIL-F-8785C. Several values give one sheet each."""
    swept = (*given.hold.values(), given.at or ())  # the values of each variable
    is_several = any(len(values) > 1 for values in swept)
    if is_several or (given.rows and request.row is None):
        return _several(request, given_points(request, given))
    return _single(request, given)


def _single(request: TrimRequest, given: TrimInput) -> Outcome:
    """Return the outcome of a single trim: its sheet, printed in short unless --full or --json."""
    single = given.single()
    point = trimmed(single)
    # The condition is a row of --conditions, or has the values of --at and --hold.
    at = {} if single.at is None else {single.model.schedule: single.at}
    row = given.rows[0] if given.rows else ListedCondition("", {**single.hold, **at}, (), {})
    name, airplane = row.name, row.airplane(request.class_, request.category)
    printed = None  # in place of the report, which has the whole sheet
    if not (request.full or request.json):
        printed = _with_name(brief(point, airplane, request.show), name)
    report = printed
    if report is None or request.output is not None:  # files contain the whole sheet
        sheet = _sheet(point, airplane, full=request.full)
        whole = _with_document(_with_name(sheet, name), request)
        report = replace(whole, records=matrix([_stated(given, row)], [whole.sheet]))
    return Outcome(
        report=report,
        printed=printed,
        source=single.source,
        figure=partial(trim_figure, point),
    )


def _several(request: TrimRequest, points: GivenPoints) -> Outcome:
    """Return the outcome of several trims: their overview, and a book of their sheets."""
    refuse(request, ("show",), "is of a single trim; add --row NAME, or remove it")
    source = points.source()
    overview, conditions = _sheets(request, points)
    report, model = overview, points.trims.model
    if request.output is not None:
        files = {"data": revision(model)}
        if request.conditions is not None:
            path = Path(request.conditions)
            digest = hashlib.sha256(path.read_bytes()).hexdigest()[:12]
            files["conditions"] = f"{path.name} (SHA-256 {digest})"
        report = book_of(overview, conditions, model, files)
    return Outcome(
        report=_with_document(report, request),
        printed=_with_document(overview if request.full else brief_list(overview), request),
        source=source,
        figure=partial(matrix_figure, conditions),
    )


def _with_document(report: Report, request: TrimRequest) -> Report:
    """Return a report with the text of --document."""
    return report.with_document(request.document) if request.document else report


def _sheet(point: OperatingPoint, airplane: Airplane, *, full: bool) -> Report:
    """Return the report of a trim, with its picture."""
    report = trim_report(point, full=full, airplane=airplane)
    if not with_range(point):  # the picture would show no variable between its limits
        return report
    picture = Picture("trim.png", report.title.partition("\n")[0], partial(trim_figure, point))
    return replace(report, parts=(*report.parts, picture))


def _sheets(request: TrimRequest, points: GivenPoints) -> tuple[Report, list[Condition]]:
    """Return the report of several trims, and each condition with its sheet, or with the reason why
    it has no trim.
    """
    model = points.trims.model
    conditions: list[Condition] = []
    stated: list[dict[str, Any]] = []
    refused: list[BadInputError] = []  # with the row of the file
    for row in points.conditions(_MOST_SHEETS):
        stated.append(_stated(points.trims, row))
        point: OperatingPoint | None
        airplane = row.airplane(request.class_, request.category)
        try:
            point = trimmed(points.trims.trim_of(row))
            report = _with_name(_sheet(point, airplane, full=request.full), row.name)
        except TrimError as error:
            point, report = None, _failed(model, row, error, error.found.data)
        except BadInputError as error:
            point, report = None, _failed(model, row, error, {"reason": str(error)})
            refused.append(BadInputError(": ".join(filter(None, (row.where, str(error))))))
        conditions.append(Condition(row.name, report, point))
    if len(refused) == len(conditions):  # no condition is valid
        raise refused[0]

    # The overview: the title counts the results, and the table has a row for each condition.
    reports = [condition.report for condition in conditions]
    results = [condition.result for condition in conditions]
    failed = results.count(UNTRIMMED)
    counts = [f"{results.count(TRIMMED)} of {len(results)} conditions are trimmed"]
    for result in (STALLED, WARNED, UNTRIMMED):
        if result in results:
            words = "without a trim" if result == UNTRIMMED else result
            counts.append(f"{results.count(result)} {words}")
    overview = Report(
        title=", ".join(counts),
        parts=[_overview(conditions), *reports],
        data={"schema": "hfa.trims/1", "sheets": [report.data for report in reports]},
        records=matrix(stated, [report.sheet for report in reports]),
        failure=f"{failed} of {len(results)} conditions have no trim" if failed else "",
    )
    return overview, conditions


def _with_name(report: Report, name: str) -> Report:
    """Return a report that begins with the name of its condition."""
    if not name:
        return report
    data = Entries({"name": name}, report.data)
    return replace(report, title=f"{name}: {report.title}", data=data)


def _stated(trims: TrimInput, row: ListedCondition) -> dict[str, Any]:
    """Return heading -> cell of the columns that define a condition, with its name, for a file."""
    texts = {NAME: row.name, CLASS: row.class_, CATEGORY: row.category}
    stated = {heading: text for heading, text in texts.items() if text}
    return stated | stated_cells(trims.model, trims.stated(row))


#: Column of the overview -> name of its figure on a sheet.
_OVERVIEW = {
    "alpha": "alpha",
    "n": "load factor",
    "L/D": "L/D",
    "margin": "static margin",
    "level": "worst level",
}


def _overview(conditions: Sequence[Condition]) -> Table:
    """Return the table of conditions by name or number, with the result and figures of each."""
    lines = []
    for number, condition in enumerate(conditions, start=1):
        rows, cells = condition.rows, [condition.name or str(number), condition.result]
        for figure in _OVERVIEW.values():
            _name, value, unit, _note = rows[figure].cells() if figure in rows else ("",) * 4
            cells.append(f"{value} {unit}".strip())
        lines.append(tuple(cells))
    return Table(("condition", RESULTS, *_OVERVIEW), lines)


def _failed(
    model: Model, row: ListedCondition, reason: Exception, data: Mapping[str, Any]
) -> Report:
    """Return the report of one of several conditions that has no trim: values and reason.

    data: entries of the file: the nearest point of a failed search, or else the reason
    """
    values = [f"{name} {model.describe(name, value)}" for name, value in row.values.items()]
    condition = ", ".join(filter(None, (row.name, *values)))
    title = f"{condition}: {reason}"
    sheet = Sheet.of([("findings", [Row("failure", str(reason))], ())])
    entries: dict[str, Any] = {"name": row.name} if row.name else {}
    entries |= data
    entries["sheet"] = {**data.get("sheet", {}), **sheet.to_dict()}
    head = {"condition": ", ".join(values)}
    return Report(title, data=entries, failure=title, sheet=sheet, head=head)
