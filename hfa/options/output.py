"""Output of a command: text, files, pictures and notes."""

from __future__ import annotations

import os
import shutil
import sys
import time
from collections.abc import Callable, Iterable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from hfa_support.errors import NoSolutionError, on_one_line, printable
from hfa_support.progress import print_flushed, print_to_stderr

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from hfa.options.request import Request
    from hfa.options.trims import JsonOption, OneTrimRequest, OutputOptions
    from hfa_aircraft.model import Model
    from hfa_support.reporting.report import Report
    from trim.point.operating_point import OperatingPoint


# Results.


def stated(report: Report, request: Request) -> Report:
    """Return the report with the provenance of the run and the unit system of --units."""
    units = getattr(request, "units", None)
    if units is not None:
        report = report.with_data(units=units)
    origin = request.provenance
    return replace(report, source=origin.text()).with_data(provenance=origin.to_dict())


def show(
    report: Report,
    request: OutputOptions,
    *,
    figure: Callable[[], Figure] | None = None,
    printed: Report | None = None,
    only_in_files: Mapping[str, Any] | None = None,
    notes: Iterable[str] = (),
) -> None:
    """Write the files of -o and --picture, then print the report or, with --json, its data.

    Either both files are written or none. Notes are printed after the report.

    report: the report
    request: the options of the command
    figure: function that draws the picture, or None if there is none
    printed: shorter report to print in place of `report`, or None
    only_in_files: data added to the file of -o only, or None
    notes: notes on the result

    Raises NoSolutionError with `report.failure` if this text is not empty.
    """
    from hfa_support.files import all_or_none

    picture = None if figure is None else request.picture
    with all_or_none():
        if request.output is not None:
            _write(stated(report.with_data(**(only_in_files or {})), request), request.output)
        if picture is not None and figure is not None:
            from hfa_support.reporting.figure import save

            save(figure(), picture, request.provenance.text())
    print_report(printed or report, request, notes=notes)
    for written in filter(None, (request.output, picture)):
        print_to_stderr(f"wrote {printable(written)}")
    if report.failure:
        raise NoSolutionError(report.failure)


def _write(report: Report, path: Path) -> None:
    from hfa.options.trims import REPORTS
    from hfa_support.files import write_text

    form = REPORTS.get(path.suffix.lower())
    if form is None:
        report.save(path)
    else:
        write_text(path, form(report))


def print_report(report: Report, request: JsonOption, *, notes: Iterable[str] = ()) -> None:
    """Print the report or, with --json, its data, and then the notes.

    The text is colored only on a terminal, unless NO_COLOR is set or TERM is "dumb".

    report: the report
    request: the options of the command
    notes: notes on the result
    """
    report = stated(report, request)
    if request.json:
        print_flushed(report.json())
    elif sys.stdout is None or not sys.stdout.isatty():
        print_flushed(report.text())
    else:
        # Colors are turned off by NO_COLOR (no-color.org).
        plain = os.environ.get("NO_COLOR") or os.environ.get("TERM") == "dumb"
        print_flushed(report.text(not plain, shutil.get_terminal_size().columns))
    print_notes(notes)


def trimmed(request: OneTrimRequest, aircraft: Model) -> OperatingPoint:
    """Return the operating point at the trim condition given by the options.

    If no trim is found, the command reports the reason. With --json, the report of the nearest
    point within the limits, with the active limits, is printed before the error is raised.

    Raises TrimError if no trim is found.
    """
    from trim.point.solve import TrimError
    from trim.point.trim_report import trim_report

    try:
        return request.operating_point(aircraft)
    except TrimError as error:
        if request.json:
            report = trim_report(aircraft, request.trim_condition, error.attempt)
            print_report(report.with_data(reason=str(error)), request)
        raise


# Standard error during a run.


def print_notes(warnings: Iterable[str]) -> None:
    """Print each note as one line on standard error, prefixed by "hfa: note: "."""
    for warning in warnings:
        print_to_stderr(f"hfa: note: {on_one_line(warning)}")


#: Seconds of work before the duration is estimated, and shortest duration that is announced.
_TRIAL = 3.0
_LONG = 300.0


class ProgressLine:
    """Display of the progress of a run, on one line of standard error that is erased at the end.

    The line is shown only on a terminal. A note on a long run is printed in any case.
    """

    def __init__(self, name: str) -> None:
        self._name = name
        self._first: tuple[float, float] | None = None
        self._announced = False
        self._shown = sys.stderr is not None and sys.stderr.isatty()
        self._last = ""

    def __call__(self, done: float, total: float, what: str = "", /) -> None:
        """Show the progress as a percentage.

        done, total: amounts of work, in any unit
        what: current step, shown after the percentage
        """
        self._announce(done, total)
        line = f"{self._name}: {int(100 * done / total):3d} %"
        if what:
            line += f"  {what}"
        if self._shown and line != self._last:
            self._last = line
            print_to_stderr(line, end="\r\033[K" if done >= total else "")

    def _announce(self, done: float, total: float) -> None:
        """Print a note with the remaining time of a long run, at most once.

        The time is estimated from the progress in the first `_TRIAL` seconds. The note is printed
        if more than `_LONG` seconds remain.
        """
        now = time.monotonic()
        is_next = self._first is not None and done < self._first[1]  # of several computations
        if self._first is None or is_next or not done:  # preparation until now
            self._first = now, done
        began, before = self._first
        if self._announced or now - began < _TRIAL or done <= before:
            return
        self._announced = True
        seconds = (now - began) * (total - done) / (done - before)
        if seconds > _LONG:
            print_notes([f"{self._name}: about {seconds / 60:.3g} minutes more; Ctrl-C ends it"])
