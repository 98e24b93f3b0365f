"""The command `hfa trim`."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from itertools import product
from typing import TYPE_CHECKING, Any

import hfa_model
from hfa.options.aircraft import Aircraft
from hfa.options.argument_types import breakpoint_value, one_of
from hfa.options.output import Output, output_option, picture_option
from hfa.options.part import OfModel, option, part
from hfa.options.ranges import Range, array_of, scheduled_range, value_range
from hfa.options.request import Request, command
from hfa.options.trim import Trim, scheduled
from hfa_support.errors import BadInputError
from hfa_support.reporting.parts import Picture
from hfa_support.reporting.report import Report
from hfa_support.reporting.text import Table
from trim.linear.levels import CATEGORIES, CLASSES, Airplane
from trim.point.solve import TrimError
from trim.point.trim_report import point_figure, trim_report

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from trim.point.operating_point import OperatingPoint

#: Largest number of sheets.
_MOST_SHEETS = 100


@dataclass(frozen=True, kw_only=True, eq=False)
class OneTrimRequest(Request):
    """Request about one trim of any aircraft."""

    aircraft: Aircraft = part(Aircraft)
    trim: Trim = part(Trim, at=scheduled(breakpoint_value, required=True))

    def trimmed(self) -> OperatingPoint:
        """Return the operating point at the trim condition given by the options.

        If no trim is found, the command reports the reason. With --json, the report of the nearest
        point within the limits, with the active limits, is printed before the error is raised.

        Raises TrimError if no trim is found.
        """
        return _trimmed(self, self.trim)


def _trimmed(request: Request, one: Trim) -> OperatingPoint:
    """Return a trim. Prints the nearest point with --json before TrimError is raised."""
    try:
        return one.point()
    except TrimError as error:
        if request.output.json:
            request.print(_failed(one, error))
        raise


def _failed(trim: Trim, error: TrimError) -> Report:
    """Return the report of the nearest point of a condition without a trim."""
    report = trim_report(trim.aircraft, trim.condition, error.attempt)
    return report.with_data(reason=str(error))


#: Content of the picture.
_SHOWN = (
    "the HFA from the front with its loads, or the variables of another aircraft in their limits"
)


@dataclass(frozen=True, kw_only=True, eq=False)
class ManyTrims(Trim):
    """The conditions of one or more trims: every combination of the values."""

    at: Range | None = scheduled(
        scheduled_range,
        "DEG",
        "also a list a,b,c or a range start:stop:step, a sheet for each",
        required=True,
    )
    hold: Mapping[str, Range] = option(
        "hold a variable at a value (repeatable); also a list or a range, a sheet for each",
        "NAME=VALUE",
        OfModel(value_range),
        named=True,
    )

    def each(self) -> list[Trim]:
        """Return the single trims, in the order of the grid.

        Raises BadInputError for more than `_MOST_SHEETS`.
        """
        schedule = {} if self.at is None else {self.model.schedule: self.at}
        ranges = {**schedule, **self.hold}
        columns = [array_of(name, each, _MOST_SHEETS).tolist() for name, each in ranges.items()]
        grid = list(product(*columns))
        if len(grid) > _MOST_SHEETS:
            raise BadInputError(
                f"{len(grid)} sheets are asked for (maximum {_MOST_SHEETS}); use `hfa sweep`"
            )
        trims = []
        for values in grid:
            held = dict(zip(ranges, values, strict=True))
            at = held.pop(self.model.schedule) if schedule else None
            if self.model.schedule in self.hold:
                held[self.model.schedule] = at if at is not None else held[self.model.schedule]
            own = {name: value for name, value in vars(self).items() if name in _OF_ONE}
            trims.append(Trim(**own, at=at, hold=held))
        return trims

    def origin(self) -> dict[str, Any]:
        """Return the provenance of the trim conditions."""
        origins = [trim.origin() for trim in self.each()]
        if len(origins) == 1:
            return origins[0]
        return {"condition": {"sheets": [each["condition"] for each in origins]}}

    @property
    def held_parameters(self) -> dict[str, float]:
        """Parameter -> value, for the parameters that all trims hold at the same value."""
        first, *others = (trim.held_parameters for trim in self.each())
        return {
            name: value
            for name, value in first.items()
            if all(other.get(name) == value for other in others)
        }


#: Fields that a trim shares with the other sheets.
_OF_ONE = ("model", "typed", "given", "free", "limit", "start")


#: Number of an airplane class -> its Roman number.
_ROMAN = {"1": "i", "2": "ii", "3": "iii", "4": "iv"}


def _airplane_class(text: str) -> str:
    """Return the class of an airplane, "iii" or "3", in lower case and Roman numbers."""
    number, dash, letter = text.partition("-")
    roman = f"{_ROMAN.get(number, number)}{dash}{letter}"
    return one_of(*(name.lower() for name in CLASSES))(roman)


@dataclass(frozen=True, kw_only=True, eq=False)
class TrimRequest(Request):
    """Options of `hfa trim`."""

    aircraft: Aircraft = part(Aircraft)
    trim: ManyTrims = part(ManyTrims)
    output: Output = part(Output, file=output_option(".pdf"), picture=picture_option(_SHOWN))
    full: bool = option("print each equation, all near limits, outputs and participations")
    class_: str | None = option(
        f"airplane class of MIL-F-8785C: {', '.join(CLASSES)}; default I",
        "CLASS",
        _airplane_class,
        names="--class",
    )
    category: str | None = option(
        f"flight phase category of MIL-F-8785C: {', '.join(CATEGORIES)}; default B",
        "CATEGORY",
        one_of(*(name.lower() for name in CATEGORIES)),
    )

    @property
    def airplane(self) -> Airplane | None:
        """Class and category, or None if neither is given."""
        if self.class_ is None and self.category is None:
            return None
        usual = Airplane()
        name = (self.class_ or usual.class_).upper()
        return Airplane(name, (self.category or usual.category).upper())


@command(TrimRequest)
def trim(request: TrimRequest) -> int:
    """Trim the aircraft and print a sheet: variables, limits, configuration, loads, performance,
    stability, modes and their levels by MIL-F-8785C. Several values give one sheet each."""
    trims = request.trim.each()
    if len(trims) == 1:
        return _one(request, trims[0])
    if request.output.picture is not None:
        raise BadInputError("--picture requires a single trim; -o FILE.html contains all pictures")
    sheets = [_sheet_or_failure(request, each) for each in trims]
    failed = [sheet for sheet in sheets if sheet.failure]
    title = f"{len(sheets) - len(failed)} of {len(sheets)} conditions are trimmed"
    failure = f"{len(failed)} of {len(sheets)} conditions have no trim" if failed else ""
    data = {"schema": "hfa.trims/1", "sheets": [sheet.data for sheet in sheets]}
    header = next((sheet.records.header for sheet in sheets if not sheet.failure), ())
    rows = [(k, *row) for k, sheet in enumerate(sheets, 1) for row in sheet.records.rows]
    records = Table(("sheet", *header), rows)
    request.show(Report(title, sheets, data=data, records=records, failure=failure))
    return 0


def _one(request: TrimRequest, one: Trim) -> int:
    sheet = _sheet(request, one, _trimmed(request, one))
    (picture,) = sheet.pictures()
    request.show(sheet, figure=lambda: picture.figure)
    return 0


def _sheet(request: TrimRequest, one: Trim, point: OperatingPoint) -> Report:
    """Return the sheet of a trim, with its picture."""
    aircraft = one.aircraft
    report = trim_report(
        aircraft, one.condition, point, full=request.full, airplane=request.airplane
    )
    if hfa_model.is_hfa(aircraft):
        from trim.hfa.other_dynamics import beside_other_dynamics

        report = beside_other_dynamics(report, point)

    def figure() -> Figure:
        if not hfa_model.is_hfa(aircraft):
            return point_figure(point)
        from trim.hfa.front_view import trim_figure

        return trim_figure(aircraft, point)

    picture = Picture("trim.png", point.title.partition("\n")[0], figure)
    return replace(report, parts=(*report.parts, picture))


def _sheet_or_failure(request: TrimRequest, one: Trim) -> Report:
    """Return the sheet of one of several trims, or a report of the reason for a missing trim."""
    try:
        return _sheet(request, one, one.point())
    except TrimError as error:
        data = _failed(one, error).data
        where = one.condition.in_words()
        return Report(f"{where}: {error}", data=data, failure=str(error))
