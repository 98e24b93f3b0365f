"""Commands, and the requests that the parser makes of their command lines."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple, TypeVar

from hfa.options.argument_types import PICTURES, output_file
from hfa.options.option import option
from hfa_support.reporting.report import SUFFIXES


def output_option(*more: str, stores: tuple[str, ...] = (), purpose: str = "") -> Any:
    """Return the option -o, which names a file or store to write.

    more: accepted suffixes besides those of a report
    stores: accepted suffixes of stores
    purpose: text on the additional suffixes for the help
    """
    suffixes = (*SUFFIXES, *more)
    about = f"write results: {', '.join((*suffixes, *stores))}{purpose}"
    return option(about, "FILE", output_file(*suffixes, stores=stores), names="-o --output")


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


class Command(NamedTuple):
    """A command of `hfa`.

    request: class whose fields are the options
    run: function (request) -> exit code, or (request, given) -> exit code, with the help as its
        docstring
    given: function that reads from the request what the command is about, or None
    install: optional packages that the command requires, as pip names them
    example: last line of the help
    """

    request: type[Request]
    run: Callable[..., int]
    given: Callable[[Any], Any] | None = None
    install: tuple[str, ...] = ()
    example: str = ""


R = TypeVar("R", bound=Request)


def command(
    request: type[R], given: Callable[[R], Any] | None = None
) -> Callable[[Callable[..., int]], Command]:
    """Return a decorator that makes a `Command` from a function.

    The function is (request) -> exit code, or (request, given) -> exit code.

    request: class of the requests, whose fields are the options
    given: function (request) -> what the command is about, such as `given_trim`, or None
    """
    return lambda run: Command(request, run, given)
