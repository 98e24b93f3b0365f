"""The class `Command`, and the decorator that makes one from a function."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple, TypeVar

from hfa.options.request import Request

R = TypeVar("R", bound=Request)


class Command(NamedTuple):
    """A command of `hfa`.

    request: class whose fields are the options
    run: function that maps a request to the exit code, with the help as its docstring
    install: pip requirement to install if a needed package is missing
    example: last line of the help
    """

    request: type[Request]
    run: Callable[[Any], int]
    install: str = ""
    example: str = ""


def command(request: type[R]) -> Callable[[Callable[[R], int]], Command]:
    """Return a decorator that makes a `Command` from a function (request) -> exit code.

    request: class of the requests, whose fields are the options
    """
    return lambda run: Command(request, run)
