"""The command `hfa trim`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import product
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from hfa.commands.sweep import listed_points
from hfa.options.advice import trimmed
from hfa.options.argument_types import one_of
from hfa.options.command import Request, command, output_option, picture_option
from hfa.options.option import option
from hfa.options.plants import aircraft_source, loaded_model
from hfa.options.ranges import array_of, value_range
from hfa.options.show import show, show_text
from hfa.options.trims import (
    GivenTrim,
    SeveralTrims,
    at_value,
    held_values,
    refuse_doubles,
    trim_with,
)
from hfa_aircraft.model import Model
from hfa_support.errors import BadInputError
from hfa_support.reporting.parts import Picture
from hfa_support.reporting.report import Report
from hfa_support.reporting.rows import Row, Sheet, matrix_of
from trim.hfa.trim_report import trim_figure, trim_report
from trim.point.condition import usual_condition
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
class TrimRequest(Request, SeveralTrims):
    """Options of `hfa trim`."""

    hold: Mapping[str, str] = option(
        "hold a variable at a value (repeatable); also a list or a range, a sheet for each",
        "NAME=VALUE",
        named=True,
    )
    conditions: Path | None = option(
        "a .csv file of conditions, a sheet for each: a row of names, rows of values (degrees)",
        "FILE",
    )
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


@command(TrimRequest)
def trim(request: TrimRequest) -> int:
    """Trim the aircraft and print a sheet: variables, limits, configuration, loads, performance,
    stability, modes and their levels by MIL-F-8785C. Several values give one sheet each."""
    trims = _each_trim(request)
    valid = [each for each in trims if isinstance(each, GivenTrim)]
    if not valid:
        raise next(each.error for each in trims if isinstance(each, _Refused))
    if len(trims) == 1 and request.conditions is None:
        point = trimmed_or_shown(request, valid[0])
        report, _ = _sheet(request, valid[0], point)
        show(request, report, valid[0].source, figure=partial(trim_figure, point))
        return 0
    if request.picture is not None:
        raise BadInputError("--picture requires a single trim; -o FILE.html contains all pictures")
    reports, sheets = zip(*(_sheet_or_failure(request, each) for each in trims), strict=True)
    show(request, _together(reports, sheets), _common_source(request, valid))
    return 0


class _Refused(NamedTuple):
    """Condition with a value beyond its limits: its values, and the error that names this value."""

    hold: Mapping[str, float]
    model: Model
    error: BadInputError


def _each_trim(request: TrimRequest) -> Sequence[GivenTrim | _Refused]:
    """Return the single trims, in the order of the grid.

    Raises BadInputError for more than `_MOST_SHEETS`.
    """
    model = loaded_model(request)
    hold = held_values(request, model, value_range)
    if request.conditions is not None:
        return _each_listed(request, model, request.conditions, hold)
    at = at_value(request, model, value_range, required=True)
    refuse_doubles(model, (), at, hold)
    ranges = hold if at is None else {model.schedule: at, **hold}
    columns = [array_of(name, each, _MOST_SHEETS).tolist() for name, each in ranges.items()]
    grid = list(product(*columns))
    if len(grid) > _MOST_SHEETS:
        raise BadInputError(
            f"{len(grid)} sheets are asked for (maximum {_MOST_SHEETS}); use `hfa sweep`"
        )
    trims = []
    for values in grid:
        held = dict(zip(ranges, values, strict=True))
        single = None if at is None else held.pop(model.schedule)
        trims.append(trim_with(request, model, single, held))
    return trims


def _each_listed(
    request: TrimRequest, model: Model, file: Path, hold: Mapping[str, Any]
) -> list[GivenTrim | _Refused]:
    """Return the trims of a file of conditions, in its order; the options hold for each.

    Raises BadInputError for a variable in the file and in an option, and for several values of an
    option.
    """
    listed = listed_points(file, usual_condition(model))
    at = at_value(request, model, value_range, required=False)
    common = hold if at is None else {model.schedule: at, **hold}
    for name, values in common.items():
        if name in listed or len(values) > 1:
            raise BadInputError(
                f"give {name} either as a column of {file} or by an option with one value"
            )
    held = {name: float(array_of(name, values, 1)[0]) for name, values in common.items()}
    trims: list[GivenTrim | _Refused] = []
    for row in zip(*listed.values(), strict=True):
        values = held | dict(zip(listed, map(float, row), strict=True))
        others = dict(values)
        single = others.pop(model.schedule, None) if model.about.names_schedule else None
        try:
            trims.append(trim_with(request, model, single, others))
        except BadInputError as error:
            trims.append(_Refused(values, model, error))
    return trims


def trimmed_or_shown(request: Request, given: GivenTrim) -> OperatingPoint:
    """Return a trim. Prints the nearest point with --json before TrimError is raised."""
    try:
        return trimmed(given)
    except TrimError as error:
        if request.json:
            show_text(request, _failed(given, error), given.source)
        raise


def _failed(given: GivenTrim, error: TrimError) -> Report:
    """Return the report of the nearest point of a condition without a trim."""
    report = trim_report(error.attempt, given.condition)
    return report.with_data(reason=str(error))


def _sheet(request: TrimRequest, given: GivenTrim, point: OperatingPoint) -> tuple[Report, Sheet]:
    """Return the report of a trim, with its picture, and its sheet."""
    airplane = Airplane(request.class_, request.category)
    report = trim_report(point, given.condition, full=request.full, airplane=airplane)
    if with_range(point):
        picture = Picture("trim.png", report.title.partition("\n")[0], partial(trim_figure, point))
        report = replace(report, parts=(*report.parts, picture))
    return report, report.sheet


def _sheet_or_failure(request: TrimRequest, given: GivenTrim | _Refused) -> tuple[Report, Sheet]:
    """Return the report and the sheet of one of several trims. Without a trim, the sheet has the
    values of the condition and the reason.
    """
    model, values = given.model, dict(given.hold)
    data: Mapping[str, Any] = {}
    if isinstance(given, _Refused):
        reason = str(given.error)
    else:
        if given.at is not None:
            values = {model.schedule: given.at, **values}
        try:
            return _sheet(request, given, trimmed(given))
        except TrimError as error:
            data, reason = _failed(given, error).data, str(error)
        except BadInputError as error:
            reason = str(error)
    words = ", ".join(f"{name} {model.describe(name, value)}" for name, value in values.items())
    title = f"{words}: {reason}"
    rows = [Row(name, value, model.unit(name)) for name, value in values.items()]
    sheet = Sheet.of([("", [*rows, Row("failure", title)], ())])
    return Report(title, data={"reason": reason, **data}, failure=title), sheet


def _together(reports: Sequence[Report], sheets: Sequence[Sheet]) -> Report:
    """Return one report of several sheets."""
    failed = [report for report in reports if report.failure]
    title = f"{len(reports) - len(failed)} of {len(reports)} conditions are trimmed"
    failure = f"{len(failed)} of {len(reports)} conditions have no trim" if failed else ""
    data = {"schema": "hfa.trims/1", "sheets": [report.data for report in reports]}
    return Report(title, reports, data=data, records=matrix_of(sheets), failure=failure)


def _common_source(request: TrimRequest, trims: list[GivenTrim]) -> dict[str, Any]:
    """Return the entries of the provenance on several trims of one aircraft."""
    first, *others = (each.parameters for each in trims)
    held = {
        name: value
        for name, value in first.items()
        if all(other.get(name) == value for other in others)
    }
    sheets = [each.source["condition"] for each in trims]
    return aircraft_source(request, trims[0].common.model, held) | {"condition": {"sheets": sheets}}
