"""Where results go: standard output, or a file whose suffix chooses the format."""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from hfa_cli.options.shared_options import FORMATS
from hfa_cli.origin import provenance, signed
from hfa_cli.progress import say_notes
from hfa_model.reporting.report import Report
from hfa_model.reporting.text import Style
from hfa_model.units_of_data import in_units_in_force

if TYPE_CHECKING:
    from controller.flight.flight_result import NonlinearFlight
    from trim.point.operating_point import OperatingPoint


def show(report: Report, arguments: argparse.Namespace, *, target: Path | None) -> None:
    """Print the report as --format says or, with --json, its data; write the file, if one was asked for, first."""
    report = signed(in_units_in_force(report) if hasattr(arguments, "units") else report)
    if target is not None:
        report.save(target)
    form = arguments.format or "text"
    if not arguments.json and form == "text":
        print(report.text(_style()))
    else:
        print(report.json() if arguments.json else FORMATS[form](report))


def _style() -> Style:
    """Bars on a terminal, and colors unless the user wants none (no-color.org)."""
    on_terminal = sys.stdout is not None and sys.stdout.isatty()
    plain = os.environ.get("NO_COLOR") or os.environ.get("TERM") == "dumb"
    return Style(bars=on_terminal, color=on_terminal and not plain)


def tell(
    report: Report,
    points: Sequence[OperatingPoint],
    arguments: argparse.Namespace,
    target: Path | None,
    only_in_files: dict[str, Any] | None = None,
) -> None:
    """Print the report, or its data, and write the file; then what should be known of the trims `points`."""
    notes = list(dict.fromkeys(warning for point in points for warning in point.warnings))
    told = report.with_data(warnings=notes)
    if target is not None:
        signed(told.with_data(**(only_in_files or {}))).save(target)
    show(told, arguments, target=None)
    sys.stdout.flush()
    say_notes(notes)


def draw_flight(result: NonlinearFlight, report: Report, picture: Path | None) -> None:
    """The picture of a flight, if one was asked for."""
    if picture is not None:
        from hfa_model.reporting.figure import save
        from verification.flights.flight_figures import flight_figure

        save(flight_figure(result, report.title.partition("\n")[0]), picture, provenance().text())
