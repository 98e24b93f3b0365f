"""Output of a run: its report as text, JSON or file, its picture, and its provenance."""

from __future__ import annotations

import os
import shutil
import sys
from collections.abc import Callable, Iterable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from hfa.options.command import Request
from hfa.options.option import options_of
from hfa.options.output import print_flushed
from hfa_support.errors import NoSolutionError, printable
from hfa_support.progress import print_notes, print_to_stderr
from hfa_support.provenance import Provenance
from hfa_support.reporting.report import Report

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from hfa_support.reporting.results import Result


def provenance(request: Request, source: Mapping[str, Any]) -> Provenance:
    """Return the provenance of a run.

    source: entries of the provenance on the plant
    """
    return Provenance(request.line, date=request.date, **source)


def stated(request: Request, report: Report, source: Mapping[str, Any]) -> Report:
    """Return a report with the provenance of the run and the unit system of --units.

    source: entries of the provenance on the plant
    """
    if "units" in options_of(type(request)):
        report = report.with_data(units=getattr(request, "units", None))
    origin = provenance(request, source)
    return replace(report, source=origin.text()).with_data(provenance=origin)


def show(
    request: Request,
    report: Report,
    source: Mapping[str, Any] | None = None,
    *,
    figure: Callable[[], Figure] | None = None,
    printed: Report | None = None,
    only_in_files: Result | Mapping[str, Any] | None = None,
    write: Callable[[Path], object] | None = None,
    notes: Iterable[str] = (),
) -> None:
    """Write the files of -o and --picture, then print the report and the notes.

    report: the report
    source: entries of the provenance on the plant, or None
    figure: function that draws the picture, or None if there is none
    printed: shorter report to print in place of `report`, or None
    only_in_files: result or entries added to the file of -o only, or None
    write: function that writes the file of -o in a format of the command's own, or None
    notes: notes on the result

    Raises NoSolutionError with `report.failure` if this text is not empty.
    """
    source = source or {}
    picture = None if figure is None else request.picture
    if request.output is not None and write is not None:
        write(request.output)
    elif request.output is not None:
        stated(request, report, source).with_data(only_in_files or {}).save(request.output)
    if picture is not None and figure is not None:
        from hfa_support.reporting.figure import save

        save(figure(), picture, provenance(request, source).text())
    show_text(request, printed or report, source, notes=notes)
    for written in filter(None, (request.output, picture)):
        print_to_stderr(f"wrote {printable(written)}")
    if report.failure:
        raise NoSolutionError(report.failure)


def show_text(
    request: Request, report: Report, source: Mapping[str, Any], *, notes: Iterable[str] = ()
) -> None:
    """Print a report or, with --json, its data, and then the notes. Write no file.

    The text is colored only on a terminal, unless NO_COLOR is set or TERM is "dumb".

    source: entries of the provenance on the plant
    """
    report = stated(request, report, source)
    if request.json:
        print_flushed(report.json())
    elif sys.stdout is None or not sys.stdout.isatty():
        print_flushed(report.text())
    else:
        # Colors are turned off by NO_COLOR (no-color.org).
        plain = os.environ.get("NO_COLOR") or os.environ.get("TERM") == "dumb"
        print_flushed(report.text(not plain, shutil.get_terminal_size().columns))
    if notes:
        print_notes(notes)
