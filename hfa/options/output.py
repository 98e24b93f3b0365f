"""Output of a command: text, files, pictures and notes."""

from __future__ import annotations

import os
import shutil
import sys
import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from hfa.options.argument_types import PICTURES, output_file
from hfa.options.part import Part, option
from hfa_support.progress import drop, print_notes, print_to_stderr
from hfa_support.reporting.report import SUFFIXES, Report

if TYPE_CHECKING:
    from hfa_aircraft.model import Model


def output_option(
    *more: str, stores: Sequence[str] = (), purpose: str | Callable[[], str] = ""
) -> Any:
    """Return the option -o, which names a file or store to write.

    more: accepted suffixes besides those of a report
    stores: accepted suffixes of stores
    purpose: text on the additional suffixes for the help, or a function that returns it
    """
    suffixes = (*SUFFIXES, *more)

    def about(_: Model) -> str:
        """Return the help of -o, with the accepted suffixes."""
        use = purpose() if callable(purpose) else purpose
        return f"write results: {', '.join((*suffixes, *stores))}{use}"

    return option(about, "FILE", output_file(*suffixes, stores=stores), names="-o --output")


def picture_option(shows: str | Callable[[Model | None], str]) -> Any:
    """Return the option --picture, which names the image file to write.

    shows: content of the picture for the help, or a function of the model that returns it
    """

    def about(model: Model | None) -> str:
        content = shows(model) if callable(shows) else shows
        return f"draw {content} ({', '.join(PICTURES)})"

    return option(about, "FILE", output_file(*PICTURES))


@dataclass(frozen=True, kw_only=True, eq=False)
class Output(Part):
    """Where a report goes: text or JSON on standard output, a file, a picture.

    `Request.show` writes the files and prints the report.
    """

    file: Path | None = output_option()
    picture: Path | None = None
    json: bool = option("print JSON (angles in radians) instead of text")

    def print(self, report: Report, *, notes: Iterable[str] = ()) -> None:
        """Print the report or, with --json, its data, and then the notes.

        The text is colored only on a terminal, unless NO_COLOR is set or TERM is "dumb".
        """
        if self.json:
            print_flushed(report.json())
        elif sys.stdout is None or not sys.stdout.isatty():
            print_flushed(report.text())
        else:
            # Colors are turned off by NO_COLOR (no-color.org).
            plain = os.environ.get("NO_COLOR") or os.environ.get("TERM") == "dumb"
            print_flushed(report.text(not plain, shutil.get_terminal_size().columns))
        if notes:
            print_notes(notes)


def print_flushed(text: str) -> None:
    """Print a text on standard output and flush the stream.

    A full disk therefore raises an OSError here. If the reader of the pipe has stopped, later
    output is discarded.
    """
    try:
        print(text, flush=True)
    except BrokenPipeError:
        drop(sys.stdout)


# Standard error during a run.


#: Seconds of work before the duration is estimated, and shortest duration that is announced.
_TRIAL = 3.0
_LONG = 60.0


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
        """Print a note with the remaining time of a long run, at most once."""
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
