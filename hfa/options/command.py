"""A command: its class of requests, and the function that runs it."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple, TypeVar

from hfa.options.request import Request

R = TypeVar("R", bound=Request)


class Command(NamedTuple):
    """A command of `hfa`.

    request: the class whose fields are the options.
    run: request -> exit code; its docstring is the help.
    install: what pip installs where a package that it needs is missing.
    example: a line that ends the help.
    """

    request: type[Request]
    run: Callable[[Any], int]
    install: str = ""
    example: str = ""


def command(request: type[R]) -> Callable[[Callable[[R], int]], Command]:
    """Return a decorator that makes a `Command` of a function of a request of this class."""
    return lambda run: Command(request, run)
