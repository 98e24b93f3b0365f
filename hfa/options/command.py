"""Commands, and the requests that the parser makes of their command lines."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, TypeVar

from hfa.options.argument_types import PICTURES, output_file, whole
from hfa.options.parser import option
from hfa_support.errors import NoSolutionError, printable
from hfa_support.progress import drop, print_notes, print_to_stderr
from hfa_support.provenance import Provenance
from hfa_support.reporting.report import SUFFIXES, Report
from hfa_support.reporting.results import storable
from hfa_support.units import system_of

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from hfa_support.reporting.results import Result


class ProgressLine:
    """Display of the progress of a run, on one line of standard error that is erased at the end.

    The line is shown only on a terminal.
    """

    def __init__(self, name: str) -> None:
        self._name = name
        self._is_terminal = sys.stderr is not None and sys.stderr.isatty()
        self._last_line = ""

    def __call__(self, done: float, total: float, what: str = "", /) -> None:
        """Show the progress as a percentage.

        done, total: amounts of work, in any unit
        what: current step, shown after the percentage
        """
        line = f"{self._name}: {int(100 * done / total):3d} %"
        if what:
            line += f"  {what}"
        if self._is_terminal and line != self._last_line:
            self._last_line = line
            print_to_stderr(line, end="\r\033[K" if done >= total else "")  # erased at the end


def output_option(*more: str, stores: tuple[str, ...] = (), purpose: str = "") -> Any:
    """Return the option -o, which names a file or store to write.

    more: accepted suffixes besides those of a report (`SUFFIXES`)
    stores: accepted suffixes of stores
    purpose: text on the additional suffixes for the help
    """
    suffixes = (*SUFFIXES, *more)
    about = f"write results: {', '.join((*suffixes, *stores))}{purpose}"
    kind = output_file(*suffixes, stores=stores)
    return option(about, "FILE", kind, names="-o --output")


def picture_option(shows: str) -> Any:
    """Return the option --picture, which names the image file to write.

    shows: content of the picture for the help
    """
    return option(f"draw {shows} ({', '.join(PICTURES)})", "FILE", output_file(*PICTURES))


@dataclass(frozen=True, kw_only=True, eq=False)
class Request:
    """Input of one run: the options of its command line, as plain values.

    An option about the aircraft is a text until its model is loaded.

    line: the command line as typed
    date: start of the run in UTC, as text
    """

    output: Path | None = output_option()
    picture: Path | None = None
    json: bool = option("print JSON (angles in radians) instead of text")
    quiet: bool = option("suppress notes and progress messages", names="-q --quiet", rare=True)
    line: str = ""
    date: str = ""


@dataclass(frozen=True, kw_only=True, eq=False)
class Outcome:
    """What a command found, which `hfa.options.command.show` prints and writes.

    report: the report
    ok: whether the exit code is 0, otherwise 1
    source: entries of the provenance on the plant
    notes: notes on the result
    figure: function that draws the picture of --picture, or None if there is none
    printed: shorter report to print in place of `report`, or None
    only_in_files: result or entries added to the file of -o only, or None
    write: function that writes the file of -o in a format of the command's own, or None
    is_written: whether the command wrote the file or store of -o itself
    """

    report: Report
    ok: bool = True
    source: Mapping[str, Any] = field(default_factory=dict)
    notes: Iterable[str] = ()
    figure: Callable[[], Figure] | None = None
    printed: Report | None = None
    only_in_files: Result | Mapping[str, Any] | None = None
    write: Callable[[Path], object] | None = None
    is_written: bool = False


class Command(NamedTuple):
    """A command of `hfa`.

    request: class whose fields are the options
    run: function (request) -> outcome, or (request, given) -> outcome, with the help as its
        docstring
    given: function that reads from the request what the command is about, or None
    install: optional packages that the command requires, as pip names them
    example: last line of the help
    """

    request: type[Request]
    run: Callable[..., Outcome]
    given: Callable[[Any], Any] | None = None
    install: tuple[str, ...] = ()
    example: str = ""


R = TypeVar("R", bound=Request)


def command(
    request: type[R], given: Callable[[R], Any] | None = None
) -> Callable[[Callable[..., Outcome]], Command]:
    """Return a decorator that makes a `Command` from a function.

    The function is (request) -> outcome, or (request, given) -> outcome.

    request: class of the requests, whose fields are the options
    given: function (request) -> what the command is about, such as `given_trim`, or None
    """
    return lambda run: Command(request, run, given)


def provenance(request: Request, source: Mapping[str, Any]) -> Provenance:
    """Return the provenance of a run.

    source: entries of the provenance on the plant
    """
    return Provenance(request.line, date=request.date, **source)


def with_provenance(request: Request, report: Report, source: Mapping[str, Any]) -> Report:
    """Return a report with the provenance of the run and the system of the units in its data.

    source: entries of the provenance on the plant
    """
    if units := {*_units_in(storable(report.data))}:
        report = report.with_data(units=system_of(units))
    origin = provenance(request, source)
    return replace(report, source=origin.text()).with_data(provenance=origin)


def _units_in(data: Mapping[str, Any]) -> Iterator[str]:
    """Yield the units in stored data: those of entries such as `state_units`."""
    for name, entry in data.items():
        if name.endswith("_units"):
            yield from entry.values() if isinstance(entry, Mapping) else entry
        elif isinstance(entry, Mapping):
            yield from _units_in(entry)


def show(request: Request, outcome: Outcome) -> None:
    """Write the files of -o and --picture, then print the report and the notes.

    Raises NoSolutionError with the `failure` of the report if this text is not empty.
    """
    output = None if outcome.is_written else request.output  # or the command wrote it
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
        text = report.json()
    elif sys.stdout is None or not sys.stdout.isatty():
        text = report.text()
    else:
        # Colors are turned off by NO_COLOR (no-color.org).
        from shutil import get_terminal_size

        plain = os.environ.get("NO_COLOR") or os.environ.get("TERM") == "dumb"
        text = report.text(not plain, get_terminal_size().columns)
    try:
        print(text, flush=True)  # a full disk raises an OSError here
    except BrokenPipeError:  # the reader of the pipe has stopped
        drop(sys.stdout)
    if notes:
        print_notes(notes)


MOST_WORKERS = 1000


def _workers(text: str) -> int | str:
    """Return the number of worker processes, or the address of a Dask scheduler."""
    return text if "://" in text else whole(1, MOST_WORKERS)(text)


@dataclass(frozen=True, kw_only=True, eq=False)
class WorkerOptions:
    """The worker processes of a run."""

    workers: int | str = option(
        "number of processes, or address of a Dask scheduler (tcp://host:port); default 1",
        "N|URL",
        _workers,
        default=1,
        rare=True,
    )
