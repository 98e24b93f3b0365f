"""Output of a run: its report as text, JSON or file, its picture, and its provenance."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterable, Mapping
from dataclasses import replace
from typing import Any

from hfa.options.command import Outcome, Request
from hfa.options.option import options_of
from hfa.options.output import print_flushed
from hfa_support.errors import NoSolutionError, printable
from hfa_support.progress import print_notes, print_to_stderr
from hfa_support.provenance import Provenance
from hfa_support.reporting.report import Report


def provenance(request: Request, source: Mapping[str, Any]) -> Provenance:
    """Return the provenance of a run.

    source: entries of the provenance on the plant
    """
    return Provenance(request.line, date=request.date, **source)


def with_provenance(request: Request, report: Report, source: Mapping[str, Any]) -> Report:
    """Return a report with the provenance of the run and the unit system of --units.

    source: entries of the provenance on the plant
    """
    if "units" in options_of(type(request)):
        report = report.with_data(units=getattr(request, "units", None))
    origin = provenance(request, source)
    return replace(report, source=origin.text()).with_data(provenance=origin)


def show(request: Request, outcome: Outcome) -> None:
    """Write the files of -o and --picture, then print the report and the notes.

    Raises NoSolutionError with the `failure` of the report if this text is not empty.
    """
    output = None if outcome.is_written else request.output
    picture = None if outcome.figure is None else request.picture
    if output is not None and outcome.write is not None:
        outcome.write(output)
    elif output is not None:
        whole = with_provenance(request, outcome.report, outcome.source)
        whole.with_data(outcome.only_in_files or {}).save(output)
    if picture is not None and outcome.figure is not None:
        from hfa_support.reporting.figure import save

        save(outcome.figure(), picture, provenance(request, outcome.source).text())
    show_text(request, outcome.printed or outcome.report, outcome.source, notes=outcome.notes)
    for written in filter(None, (output, picture)):
        print_to_stderr(f"wrote {printable(written)}")
    if outcome.report.failure:
        raise NoSolutionError(outcome.report.failure)


def show_text(
    request: Request, report: Report, source: Mapping[str, Any], *, notes: Iterable[str] = ()
) -> None:
    """Print a report or, with --json, its data, and then the notes. Write no file.

    The text is colored only on a terminal, unless NO_COLOR is set or TERM is "dumb".

    source: entries of the provenance on the plant
    """
    report = with_provenance(request, report, source)
    if request.json:
        print_flushed(report.json())
    elif sys.stdout is None or not sys.stdout.isatty():
        print_flushed(report.text())
    else:
        # Colors are turned off by NO_COLOR (no-color.org).
        from shutil import get_terminal_size

        plain = os.environ.get("NO_COLOR") or os.environ.get("TERM") == "dumb"
        print_flushed(report.text(not plain, get_terminal_size().columns))
    if notes:
        print_notes(notes)
