"""Where results go: standard output, or a file whose suffix chooses the format."""

from __future__ import annotations

import argparse
import os
import sys
import time
from collections.abc import Callable, Iterable
from pathlib import Path

from hfa_cli.origin import signed
from hfa_model.reporting.data_files import SUFFIXES as SUFFIXES
from hfa_model.reporting.report import Report
from hfa_model.reporting.text import Style
from hfa_model.support.errors import BadInputError
from hfa_model.units_of_data import in_units_in_force

#: What --format names. A page of HTML holds its pictures; nothing is written beside the other forms.
FORMATS: dict[str, Callable[[Report], str]] = {
    "text": Report.text,
    "markdown": lambda report: report.without_pictures().markdown(),
    "latex": lambda report: report.without_pictures().latex(),
    "html": Report.html,
}


def check_target(path: str | Path | None, suffixes: tuple[str, ...] = SUFFIXES) -> Path | None:
    """The output file of a command, refused before anything is computed when it cannot be written."""
    if path is None:
        return None
    target = Path(path)
    if target.suffix.lower() not in suffixes:
        raise BadInputError(f"{path or repr(path)}: unknown suffix {target.suffix!r}; use one of {', '.join(suffixes)}")
    if not target.parent.is_dir():
        raise BadInputError(f"{path}: the folder {target.parent} does not exist; create it first")
    if target.is_dir() and target.suffix.lower() != ".zarr":  # a Zarr store is a folder
        raise BadInputError(f"{path}: it is a folder; name a file")
    return target


def check_folder(path: str) -> Path:
    """A folder that exists or can be made; made only when there is something to put in."""
    folder = Path(path)
    if not path or (not folder.is_dir() and (folder.exists() or not folder.parent.is_dir())):
        raise BadInputError(f"{path or repr(path)}: cannot make the folder; choose another, in a folder that exists")
    return folder


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


def say_notes(warnings: Iterable[str]) -> None:
    """What a user should know before trusting a result, on standard error, a line each."""
    for warning in warnings:
        print(f"hfa: note: {warning}", file=sys.stderr)


#: Seconds: of work from which its length is estimated, and from which it is announced.
_TRIAL, _LONG = 3.0, 300.0


class Progress:
    """A counter on standard error, only when it is a terminal; at most one line, gone when done."""

    def __init__(self, what: str) -> None:
        self._what = what
        self._first: tuple[float, int] | None = None
        self._announced = False
        self._shown = sys.stderr.isatty()
        self._last = ""

    def __call__(self, done: int, total: int) -> None:
        """Show `done` of `total`."""
        self._announce(done, total)
        self._say(100 * done // total, "")

    def _announce(self, done: int, total: int) -> None:
        """Say once, terminal or not, what will take long: by the pace of the first `_TRIAL` seconds."""
        now = time.monotonic()
        if self._first is None:
            self._first = now, done
        began, before = self._first
        if self._announced or now - began < _TRIAL or done <= before:
            return
        self._announced = True
        left = (now - began) * (total - done) / (done - before)
        if left > _LONG:
            say_notes([f"{self._what}: about {left / 60:.3g} minutes more; Ctrl-C ends it"])

    def say(self, fraction: float, message: str) -> None:
        """Show the fraction that is done, and what is at work."""
        self._say(int(100 * fraction), f"  {message}")

    def _say(self, percent: int, message: str) -> None:
        line = f"\r\033[K{self._what}: {percent:3d} %{message}"
        if self._shown and line != self._last:
            self._last = line
            print(line, end="\r\033[K" if percent >= 100 else "", file=sys.stderr, flush=True)
