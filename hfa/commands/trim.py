"""The command `hfa trim`."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from itertools import product
from pathlib import Path
from typing import TYPE_CHECKING, Any

import hfa_model
from hfa.options.advice import trimmed
from hfa.options.argument_types import each_of, one_of
from hfa.options.command import Request, command, output_option, picture_option
from hfa.options.option import option
from hfa.options.plants import aircraft_source, loaded_model
from hfa.options.ranges import array_of, scheduled_range, value_range
from hfa.options.show import show, show_text
from hfa.options.trims import (
    AT_SEVERAL,
    DIHEDRAL_SEVERAL,
    GivenTrim,
    TrimOptions,
    at_option,
    at_value,
    dihedral_option,
    held_texts,
    refuse_doubles,
    trim_with,
)
from hfa_support.errors import BadInputError
from hfa_support.reporting.parts import Picture
from hfa_support.reporting.report import Report
from hfa_support.reporting.text import Table
from trim.point.solve import TrimError
from trim.reports.levels import CATEGORIES, CLASSES, Airplane
from trim.reports.point_figure import point_figure
from trim.reports.trim_report import trim_report

if TYPE_CHECKING:
    from matplotlib.figure import Figure

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
class TrimRequest(Request, TrimOptions):
    """Options of `hfa trim`."""

    at: str | None = at_option(f"{AT_SEVERAL}, a sheet for each")
    dihedral: str | None = dihedral_option(DIHEDRAL_SEVERAL)
    hold: Mapping[str, str] = option(
        "hold a variable at a value (repeatable); also a list or a range, a sheet for each",
        "NAME=VALUE",
        named=True,
    )
    output: Path | None = output_option(".pdf")
    picture: Path | None = picture_option(
        "the HFA from the front with its loads, or the variables of another aircraft in their "
        "limits"
    )
    full: bool = option("print each equation, all near limits, outputs and participations")
    class_: str | None = option(
        f"airplane class of MIL-F-8785C: {', '.join(CLASSES)}; default by weight",
        "CLASS",
        _airplane_class,
        rare=True,
    )
    category: str | None = option(
        f"flight phase category of MIL-F-8785C: {', '.join(CATEGORIES)}; default B",
        "CATEGORY",
        _category,
        rare=True,
    )


@command(TrimRequest)
def trim(request: TrimRequest) -> int:
    """Trim the aircraft and print a sheet: variables, limits, configuration, loads, performance,
    stability, modes and their levels by MIL-F-8785C. Several values give one sheet each."""
    trims = _each_trim(request)
    if len(trims) == 1:
        point = trimmed_or_shown(request, trims[0])
        sheet = _sheet(request, trims[0], point)
        (picture,) = sheet.pictures()
        show(request, sheet, trims[0].source, figure=lambda: picture.figure)
        return 0
    if request.picture is not None:
        raise BadInputError("--picture requires a single trim; -o FILE.html contains all pictures")
    sheets = [_sheet_or_failure(request, each) for each in trims]
    show(request, _together(sheets), _common_source(request, trims))
    return 0


def _each_trim(request: TrimRequest) -> list[GivenTrim]:
    """Return the single trims, in the order of the grid.

    Raises BadInputError for more than `_MOST_SHEETS`.
    """
    model = loaded_model(request)
    hold = each_of("--hold", model, held_texts(request), value_range)
    at = at_value(request, model, scheduled_range, required=True)
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


def _sheet(request: TrimRequest, given: GivenTrim, point: OperatingPoint) -> Report:
    """Return the sheet of a trim, with its picture."""
    aircraft = given.model
    airplane = None
    if request.class_ is not None or request.category is not None:
        airplane = Airplane(request.class_ or "", request.category or Airplane().category)
    report = trim_report(point, given.condition, full=request.full, airplane=airplane)
    if hfa_model.is_hfa(aircraft):
        from trim.hfa.other_dynamics import beside_other_dynamics

        report = beside_other_dynamics(report, point)

    def figure() -> Figure:
        if not hfa_model.is_hfa(aircraft):
            return point_figure(point)
        from trim.hfa.front_view import trim_figure

        return trim_figure(aircraft, point)

    picture = Picture("trim.png", report.title.partition("\n")[0], figure)
    return replace(report, parts=(*report.parts, picture))


def _sheet_or_failure(request: TrimRequest, given: GivenTrim) -> Report:
    """Return the sheet of one of several trims, or a report of the reason for a missing trim."""
    try:
        return _sheet(request, given, trimmed(given))
    except TrimError as error:
        data = _failed(given, error).data
        where = given.condition.in_words()
        return Report(f"{where}: {error}", data=data, failure=str(error))


def _together(sheets: list[Report]) -> Report:
    """Return one report of several sheets."""
    failed = [sheet for sheet in sheets if sheet.failure]
    title = f"{len(sheets) - len(failed)} of {len(sheets)} conditions are trimmed"
    failure = f"{len(failed)} of {len(sheets)} conditions have no trim" if failed else ""
    data = {"schema": "hfa.trims/1", "sheets": [sheet.data for sheet in sheets]}
    header = next((sheet.records.header for sheet in sheets if not sheet.failure), ())
    rows = [(k, *row) for k, sheet in enumerate(sheets, 1) for row in sheet.records.rows]
    records = Table(("sheet", *header), rows)
    return Report(title, sheets, data=data, records=records, failure=failure)


def _common_source(request: TrimRequest, trims: list[GivenTrim]) -> dict[str, Any]:
    """Return the entries of the provenance on several trims of one aircraft."""
    first, *others = (each.held_parameters for each in trims)
    held = {
        name: value
        for name, value in first.items()
        if all(other.get(name) == value for other in others)
    }
    sheets = [each.source["condition"] for each in trims]
    return aircraft_source(request, trims[0].common.model, held) | {"condition": {"sheets": sheets}}
