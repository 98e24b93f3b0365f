"""Section on drawn aircraft, which `--draws N` and Monte Carlo simulations add to reports."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

from hfa.options.argument_types import whole
from hfa.options.output import ProgressLine
from hfa.options.part import option
from hfa_support.errors import BadInputError
from hfa_support.reporting.report import Report
from hfa_support.reporting.text import WIDTH, Table, shown_unit, shown_value, wrapped

if TYPE_CHECKING:
    from hfa.options.aircraft import Aircraft
    from hfa.options.trim import Trim
    from trim.point.operating_point import OperatingPoint
    from verification.drawn import DrawnAircraft, Draws

#: Seed of the draws.
SEED = 0
#: A band that is narrower than this fraction of its ends is not listed.
_CONSTANT = 1e-9


def draws_option() -> Any:
    """Return the field `draws` of a request, with the option --draws."""
    return option(
        "add the spread of the result for N aircraft with random parameters", "N", whole(1)
    )


def with_draws(report: Report, count: int, aircraft: Aircraft, trim: Trim, subject: Any) -> Report:
    """Return a report with a section on `count` aircraft with random parameters.

    report: report without the section
    count: number of --draws
    aircraft, trim: the options of the aircraft and its trim
    subject: the reported pair (`NamedGame`, gain)

    Raises BadInputError if the covariance of the parameters is unknown, or if the game has no
    aircraft.
    """
    progress = ProgressLine("draws")
    named, gain = subject
    if named.linear is None:
        raise BadInputError("--draws does not support --design; remove one of the two")
    drawn = _drawn(count, aircraft, trim, named.linear.point)
    return reported(report, drawn.gain(named.game, gain, progress))


def reported(report: Report, draws: Draws) -> Report:
    """Return the report with a table of the bands and a line that summarizes the draws.

    The line follows the first line of the report, or is the first if the draws fail and the report
    does not. Bands of constant quantities are omitted.
    """
    from verification.drawn import WithDraws

    rows = []
    for name, band in draws.bands.items():
        if band.high - band.low <= _CONSTANT * max(abs(band.high), abs(band.low)):
            continue
        values = [shown_value(value, band.unit) for value in (band.value, band.low, band.high)]
        rows.append((name, *values, shown_unit(band.unit)))
    about = f"95 % of {draws.count} aircraft, drawn from {len(draws.parameters)} parameters"
    table = Table((about, "itself", "low", "high", "unit"), tuple(rows))
    line = wrapped(draws.first_line, WIDTH - len("FAIL: "))
    lines = report.title.splitlines()
    if not draws.ok and not report.title.startswith("FAIL"):
        lines.insert(0, f"FAIL: {line}")
    else:
        # A line that ends with ; or , is continued.
        ends = [number for number, each in enumerate(lines) if each[-1:] not in (";", ",")]
        lines.insert(ends[0] + 1, line)
    title = "\n".join(lines)
    parts = (*report.parts, table)
    failure = "" if draws.ok else draws.first_line
    shown = replace(report, title=title, parts=parts, failure=failure)
    return shown.with_data(WithDraws(draws))


def _drawn(count: int, aircraft: Aircraft, trim: Trim, point: OperatingPoint) -> DrawnAircraft:
    """Return `count` aircraft with random parameters."""
    from verification.drawn import DrawnAircraft

    spread = aircraft.spread(trim.held_parameters)
    models = spread.aircraft(trim.aircraft, count, SEED)
    return DrawnAircraft(models, tuple(spread.values), SEED, trim.condition, point)
