"""The command `hfa trim`."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from hfa.options.advice import trimmed
from hfa.options.argument_types import one_of
from hfa.options.command import Outcome, Request, command, output_option, picture_option
from hfa.options.option import option
from hfa.options.points import GivenPoints, PointOptions, given_points
from hfa_aircraft.model import Model
from hfa_support.errors import BadInputError
from hfa_support.reporting.parts import Picture
from hfa_support.reporting.report import Report
from hfa_support.reporting.rows import Row, Sheet, matrix_of
from trim.hfa.trim_report import trim_figure, trim_report
from trim.point.solve import TrimError
from trim.reports.levels import CATEGORIES, CLASSES, Airplane
from trim.reports.point_figure import with_range

if TYPE_CHECKING:
    from trim.point.operating_point import OperatingPoint

#: Largest number of sheets.
_MOST_SHEETS = 100
#: Number of an airplane class -> its Roman number.
_ROMAN = {"1": "i", "2": "ii", "3": "iii", "4": "iv"}


def _airplane_class(text: str) -> str:
    """Return the class of an airplane, "iii" or "3", in upper case and Roman numbers."""
    number, dash, letter = text.partition("-")
    roman = f"{_ROMAN.get(number, number)}{dash}{letter}"
    return one_of(*(name.lower() for name in CLASSES))(roman).upper()


def _category(text: str) -> str:
    return one_of(*(name.lower() for name in CATEGORIES))(text).upper()


@dataclass(frozen=True, kw_only=True, eq=False)
class TrimRequest(Request, PointOptions):
    """Options of `hfa trim`."""

    output: Path | None = output_option(".pdf")
    picture: Path | None = picture_option(
        "the HFA from the front with its loads, or the variables of another aircraft in their "
        "limits"
    )
    full: bool = option("print each equation, all near limits, outputs and participations")
    class_: str = option(
        f"airplane class of MIL-F-8785C: {', '.join(CLASSES)}; default by weight",
        "CLASS",
        _airplane_class,
        default="",
        rare=True,
    )
    category: str = option(
        f"flight phase category of MIL-F-8785C: {', '.join(CATEGORIES)}; default B",
        "CATEGORY",
        _category,
        default="B",
        rare=True,
    )


@command(TrimRequest, given_points)
def trim(request: TrimRequest, points: GivenPoints) -> Outcome:
    """Trim the aircraft and print a sheet: variables, limits, configuration, loads, performance,
    stability, modes and their levels by MIL-F-8785C. Several values give one sheet each."""
    if not points.listed:
        points.trims.refuse_unscheduled()
    if points.trims.is_single and not points.listed:
        given = points.trims.single()
        point = trimmed(given)
        report = _sheet(request, point)
        return Outcome(report=report, source=given.source, figure=partial(trim_figure, point))
    if request.picture is not None:
        raise BadInputError("--picture requires a single trim; -o FILE.html contains all pictures")
    source = points.source()
    return Outcome(report=_sheets(request, points), source=source)


def _sheet(request: TrimRequest, point: OperatingPoint) -> Report:
    """Return the report of a trim, with its picture."""
    airplane = Airplane(request.class_, request.category)
    report = trim_report(point, full=request.full, airplane=airplane)
    if not with_range(point):
        return report
    picture = Picture("trim.png", report.title.partition("\n")[0], partial(trim_figure, point))
    return replace(report, parts=(*report.parts, picture))


def _sheets(request: TrimRequest, points: GivenPoints) -> Report:
    """Return the report of several trims, each with its sheet, or with the reason why it has none.

    Raises the first BadInputError if each point is refused.
    """
    reports: list[Report] = []
    refused: list[BadInputError] = []
    for values in points.rows(_MOST_SHEETS):
        try:
            given = points.trims.trim(None, values)
            reports.append(_sheet(request, trimmed(given)))
        except TrimError as error:
            reports.append(_failed(points.trims.model, values, error, error.found.data))
        except BadInputError as error:
            reports.append(_failed(points.trims.model, values, error, {"reason": str(error)}))
            refused.append(error)
    if len(refused) == len(reports):
        raise refused[0]
    count, failed = len(reports), sum(bool(report.failure) for report in reports)
    return Report(
        title=f"{count - failed} of {count} conditions are trimmed",
        parts=reports,
        data={"schema": "hfa.trims/1", "sheets": [report.data for report in reports]},
        records=matrix_of([report.sheet for report in reports]),
        failure=f"{failed} of {count} conditions have no trim" if failed else "",
    )


def _failed(
    model: Model, values: Mapping[str, float], error: Exception, data: Mapping[str, Any]
) -> Report:
    """Return the report of one of several conditions that has no trim: its values and the reason.

    values: variable or parameter -> value
    data: data of the report
    """
    words = ", ".join(f"{name} {model.describe(name, value)}" for name, value in values.items())
    title = f"{words}: {error}"
    rows = [Row(name, value, model.unit(name)) for name, value in values.items()]
    sheet = Sheet.of([("", [*rows, Row("failure", title)], ())])
    return Report(title, data=data, failure=title, sheet=sheet)
