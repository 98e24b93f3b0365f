"""Where results go: standard output, or a file whose suffix chooses the format."""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from hfa_cli.options.argument_types import OWN
from hfa_cli.options.shared_options import REPORTS
from hfa_cli.origin import provenance, signed
from hfa_cli.progress import say_notes
from hfa_model.aircraft import HFA
from hfa_support.files import write_text
from hfa_support.reporting.report import Report
from hfa_support.reporting.text import Style
from hfa_support.reporting.units_of_data import in_units_in_force
from hfa_support.streams import say

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from hfa_model.aircraft import Aircraft
    from hfa_support.model import Model
    from trim.point.operating_point import OperatingPoint
    from verification.regeneration.regeneration import Regeneration
    from verification.validation.comparison import Validation


def show(
    report: Report,
    arguments: argparse.Namespace,
    *,
    target: Path | None,
    only_in_files: Mapping[str, Any] | None = None,
) -> None:
    """Print the report or, with --json, its data; write the file, if one was asked for, first.

    only_in_files: data that would drown the rest on a terminal.
    """
    if target is not None:
        written = stated(report.with_data(**(only_in_files or {})), arguments)
        if (form := REPORTS.get(target.suffix.lower())) is not None:
            write_text(target, form(written))
        else:
            written.save(target)
    report = stated(report, arguments)
    say(report.json() if arguments.json else report.text(_style()))


def show_verdict(found: Regeneration | Validation, arguments: argparse.Namespace) -> int:
    """Print the report of a comparison and write it where -o says; the exit code, 1 when a check has failed."""
    show(found.report(), arguments, target=arguments.output)
    return 0 if found.ok else 1


def stated(report: Report, arguments: argparse.Namespace) -> Report:
    """The report in the units that --units names, where the command has it, and with its provenance."""
    return signed(in_units_in_force(report, OWN.get() or HFA) if hasattr(arguments, "units") else report)


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
    show(told, arguments, target=target, only_in_files=only_in_files)
    say_notes(notes)


@contextmanager
def failure_as_data(arguments: argparse.Namespace, aircraft: Aircraft | Model) -> Iterator[None]:
    """With --json a trim that fails is printed as data too: the nearest point within the limits, which limits bind,
    and the reason."""
    from trim.point.solve import TrimError

    try:
        yield
    except TrimError as error:
        if arguments.json:
            from hfa_cli.options.shared_options import condition_of
            from trim.point.trim_report import trim_report

            report = trim_report(aircraft, condition_of(arguments), error.attempt)
            show(report.with_data(reason=str(error)), arguments, target=None)
        raise


def draw(picture: Path | None, figure: Callable[[], Figure]) -> None:
    """Draw the figure into the file, if one was asked for."""
    if picture is not None:
        from hfa_support.reporting.figure import save

        save(figure(), picture, provenance().text())
