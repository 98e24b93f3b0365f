"""Checks of the arguments of public functions: their names, and the kind of the main ones."""

from __future__ import annotations

import inspect
import re
from collections.abc import Callable
from functools import wraps
from typing import TYPE_CHECKING, Any, TypeVar, cast

import numpy as np

from hfa_support.errors import BadInputError, advice, shown

if TYPE_CHECKING:
    from numpy.typing import ArrayLike as ArrayLike
else:
    ArrayLike = np.ndarray

Public = TypeVar("Public", bound=Callable[..., Any])


def need(value: Any, kind: type | tuple[type, ...], name: str, how: str) -> None:
    """Raise BadInputError unless a value is of a kind.

    kind: class of the value, or several
    name: function and argument, "linearize: point"
    how: what to write instead

    >>> need(3, str, "load_model: text", "the name of a file")
    Traceback (most recent call last):
    ...
    hfa_support.errors.BadInputError: load_model: text is 3; give the name of a file
    """
    if not isinstance(value, kind):
        raise BadInputError(f"{name} is {_description(value)}; give {how}")


def checks_arguments(public: Public) -> Public:
    """Return a function or class whose missing and unknown arguments raise BadInputError.

    The message names the arguments, the nearest one to an unknown name, and for a class with the
    attribute `_how_to_make` what to write instead. The public methods of a class are checked too.
    """
    if isinstance(public, type):
        maker = "__new__" if issubclass(public, tuple) else "__init__"
        how = getattr(public, "_how_to_make", "")
        setattr(public, maker, _named(getattr(public, maker), public.__name__, how))
        for name, member in list(vars(public).items()):
            method = getattr(member, "__func__", member)
            if name[0] != "_" and inspect.isfunction(method):
                checked: Any = _named(method, f"{public.__name__}.{name}")
                kind = type(member) if method is not member else None
                setattr(public, name, kind(checked) if kind else checked)
        return public
    return cast(Public, _named(public, public.__name__))


def _named(function: Callable[..., Any], name: str, how: str = "") -> Callable[..., Any]:
    """Return a function that reports arguments under the name of the function or class."""

    @wraps(function)
    def checked(*arguments: Any, **named: Any) -> Any:
        try:
            return function(*arguments, **named)
        except TypeError as error:
            raise _mismatch(function, name, how, arguments, named, error) from None

    return checked


def _mismatch(
    function: Callable[..., Any],
    name: str,
    how: str,
    arguments: tuple[Any, ...],
    named: dict[str, Any],
    error: TypeError,
) -> Exception:
    """Return the BadInputError for a call with missing, unknown or too many arguments."""
    # The result is `error` itself if the arguments match the signature of the function.
    signature = inspect.signature(function)
    try:
        signature.bind(*arguments, **named)
    except TypeError as wrong:
        known = [each for each in signature.parameters if each not in ("self", "cls", "_cls")]
        unknown = next((word for word in named if word not in known), "")
        near = advice(unknown, known) if unknown else ""
        first = type(arguments[0]) if arguments else None
        calls = getattr(first, "_instead", {})
        word = name.rpartition(".")[2]
        how = calls.get(f"{word}({unknown})") or how or calls.get(word, "")
        instead = f"; write {how}" if how else _main_argument(function, first)
        instead = instead or _description_of(function, str(wrong))
        arguments_are = f"the arguments are {', '.join(known) or 'none'}"
        return BadInputError(f"{name}: {wrong}{near}; {arguments_are}{instead}")
    return error


def _description_of(function: Callable[..., Any], wrong: str) -> str:
    """Return the text of the docstring on the argument that is missing, "" without one."""
    missing = re.search(r"^missing .*'(\w+)'$", wrong)
    if missing is None:
        return ""
    name = missing[1]
    paragraph = rf"^(?:\w+, )*{name}(?:, \w+)*: (.+(?:\n +\S.*)*)"
    found = re.search(paragraph, inspect.getdoc(function) or "", re.MULTILINE)
    return f"; {name}: {' '.join(found[1].split())}" if found else ""


def _main_argument(function: Callable[..., Any], first: type | None) -> str:
    """Return advice on the first argument of a function, "" if its type `first` is right."""
    main = next(iter(inspect.signature(function).parameters.values()), None)
    kind = None if main is None else getattr(function, "__globals__", {}).get(main.annotation)
    how = getattr(kind, "_how_to_make", "")
    return f"; {main.name} is {how}" if main and how and first is not kind else ""


def _description(value: Any) -> str:
    """Return a description of a value for messages."""
    # Numbers, texts and None are shown. An array is described by its shape, another object by its
    # type.
    if value is None or isinstance(value, (bool, int, float, complex, str, bytes)):
        return shown(value)
    if isinstance(value, np.ndarray):
        return f"an array of shape {value.shape}"
    name = type(value).__name__
    return f"{'an' if name[:1].lower() in 'aeiou' else 'a'} {name}"
