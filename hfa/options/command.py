"""Commands, and the requests that the parser makes of their command lines."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple, TypeVar

from hfa.options.argument_types import PICTURES, output_file
from hfa.options.option import option
from hfa_support.reporting.report import SUFFIXES, Report

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from hfa_support.reporting.results import Result


def output_option(
    *more: str, stores: tuple[str, ...] = (), folder: bool = False, purpose: str = ""
) -> Any:
    """Return the option -o, which names a file or store to write.

    more: accepted suffixes besides those of a report
    stores: accepted suffixes of stores
    folder: whether a folder is accepted, too
    purpose: text on the additional suffixes for the help
    """
    suffixes = (*SUFFIXES, *more)
    about = f"write results: {', '.join((*suffixes, *stores))}{purpose}"
    kind = output_file(*suffixes, folder=folder, stores=stores)
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

    moved: option of an earlier version -> what to type in place of it
    line: the command line as typed
    date: start of the run in UTC, as text
    """

    moved: ClassVar[Mapping[str, str]] = {}

    output: Path | None = output_option()
    picture: Path | None = None
    json: bool = option("print JSON (angles in radians) instead of text")
    quiet: bool = option("suppress notes and progress messages", names="-q --quiet", rare=True)
    line: str = ""
    date: str = ""


@dataclass(frozen=True, kw_only=True, eq=False)
class Outcome:
    """What a command found, which `hfa.options.show.show` prints and writes.

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
