"""Which argument of a call from outside is of the wrong kind, said where Python would speak of our own lines."""

from __future__ import annotations

import ast
import functools
import inspect
import numbers
import os
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import is_dataclass
from types import FunctionType, UnionType
from typing import Any, Union, get_args, get_origin

from hfa_model.support.errors import BadInputError, NoSolutionError, on_one_line, shown

#: Package -> name at its door -> module, of the doors that are open.
DOORS: dict[str, dict[str, str]] = {}
_WORDS = {"ndarray": "array", "float": "number", "int": "integer", "str": "text", "Quantity": "number"}


def explained(name: str, call: Callable[..., Any]) -> Callable[..., Any]:
    """The same function. BadInputError in place of Python's own error where an argument is not what the signature says,
    or where its number or shape is what NumPy refuses.

    Nothing is tested before the call: what works with an argument of another kind goes on to work.
    """

    @functools.wraps(call)
    def called(*given: Any, **named: Any) -> Any:
        try:
            return call(*given, **named)
        except NoSolutionError:
            raise
        except Exception as error:
            said, ours = str(error), isinstance(error, BadInputError)
            if ours and "\n" not in said:
                raise
            # A message of ours of many lines repeats what was given: something that prints as a report, or an array.
            wrong = _wrong_argument(call, given, named, said if isinstance(error, ValueError) and not ours else "")
            if wrong or ours:
                raise BadInputError(on_one_line(f"{name}: {wrong or said}")) from error
            raise

    return called


def explained_class(cls: type) -> None:
    """The same for what makes an object of a class; it stays the class that it is.

    A dataclass keeps what it is given, and nobody would say what is wrong with it until it is used. So one that checks
    nothing itself (`__post_init__`) refuses every argument of a wrong kind, and any other those that are to be objects
    of our classes.
    """
    made = vars(cls).get("__init__")
    if not isinstance(made, FunctionType) or hasattr(made, "__wrapped__"):
        return
    make, all_kinds = explained(cls.__name__, made), not hasattr(cls, "__post_init__")
    if not is_dataclass(cls):
        cls.__init__ = make  # type: ignore[misc]
        return
    fitting: set[tuple[Any, ...]] = set()  # the packages make objects by the thousand, all of the same kinds

    @functools.wraps(made)
    def checked(*given: Any, **named: Any) -> None:
        make(*given, **named)
        kinds = (*map(_kind_of, given), *named, *map(_kind_of, named.values()))
        if kinds in fitting:
            return
        if wrong := _wrong_argument(made, given, named, "", all_kinds=all_kinds):
            raise BadInputError(on_one_line(f"{cls.__name__}: {wrong}"))
        fitting.add(kinds)

    cls.__init__ = checked  # type: ignore[method-assign]


def _kind_of(value: Any) -> Any:
    """What decides whether an argument fits: its class, and of an array what is in it and its dimensions."""
    cls = type(value)
    return (cls, value.dtype.kind, value.ndim) if hasattr(value, "ndim") and hasattr(value, "dtype") else cls


def _wrong_argument(
    call: Callable[..., Any], given: tuple[Any, ...], named: dict[str, Any], refused: str, *, all_kinds: bool = True
) -> str:
    """The first argument that does not fit, what it is, and what it must be.

    When all fit: the numbers and arrays with the reason for which they are `refused`, or "" where there is none.
    all_kinds: else only of those that must be objects of our classes.
    """
    signature = inspect.signature(call)
    try:
        arguments = signature.bind(*given, **named).arguments
    except TypeError:  # Python names what is missing or too much
        return ""
    kinds = {
        name: parameter.annotation
        for name, parameter in signature.parameters.items()
        if isinstance(parameter.annotation, str) and parameter.kind is not parameter.VAR_KEYWORD
    }
    for name, value in arguments.items():
        if name in kinds and (all_kinds or _is_ours(kinds[name], call)) and not _fits(value, kinds[name], call):
            others = [each for each in kinds if each != name and _is_ours(kinds[each], call)]
            meant = [each for each in others if value is not None and _fits(value, kinds[each], call)]
            hint = f"; give it as {meant[0]}" if len(meant) == 1 else ""
            kind = " or ".join(_WORDS.get(each, each) for each in _names(kinds[name]))
            made = ", ".join(maker for each in _names(kinds[name]) for maker in _makers(each))
            return f"{name} is {_said(value)}; it must be: {kind}{f' (made by {made})' if made else ''}{hint}"
    plain = [name for name, value in arguments.items() if isinstance(value, numbers.Number) or hasattr(value, "shape")]
    return (
        f"{', '.join(f'{each} is {_said(arguments[each])}' for each in plain)}: {refused}" if plain and refused else ""
    )


def _fits(value: Any, kind: str, call: Callable[..., Any]) -> bool:
    return any(_is_a(value, name, call) for name in _names(kind))


def _names(kind: str) -> list[str]:
    """The alternatives of an annotation, without what is in their brackets: Mapping[str, float] | None."""

    def split(node: ast.expr) -> Iterator[str]:
        if isinstance(node, ast.BinOp):
            yield from split(node.left)
            yield from split(node.right)
        elif isinstance(node, ast.Subscript):
            yield from split(node.value)
        else:
            yield ast.unparse(node).rpartition(".")[2]

    return list(split(ast.parse(kind, mode="eval").body))


def _is_a(value: Any, name: str, call: Callable[..., Any]) -> bool:
    import numpy as np

    array = isinstance(value, np.ndarray) and value.dtype.kind in "biufc"
    number = (isinstance(value, numbers.Real) and not isinstance(value, bool)) or (array and np.ndim(value) == 0)
    plain = {
        "None": value is None,
        "bool": isinstance(value, (bool, np.bool_)),
        "str": isinstance(value, str),
        "tuple": isinstance(value, (tuple, list)),
        "Path": isinstance(value, os.PathLike),
        "float": number,
        "Quantity": number or type(value).__module__.startswith("casadi"),
        "int": isinstance(value, numbers.Integral),
        "ndarray": array and np.ndim(value) > 0,
        "Mapping": isinstance(value, Mapping),
        "dict": isinstance(value, Mapping),
        "Sequence": isinstance(value, Sequence) and not isinstance(value, str),
        "Callable": callable(value),
    }
    if name in plain:
        return plain[name]
    classes = _classes(name, call)  # none: a name that nobody knows, and anything may be one
    return not classes or any(_is_one(value, each) for each in classes)


def _is_one(value: Any, cls: type) -> bool:
    if getattr(cls, "_is_protocol", False):
        return all(hasattr(value, each) for each in {*vars(cls), *inspect.get_annotations(cls)} if each[0] != "_")
    return isinstance(value, numbers.Real if cls is float else cls)


def _classes(name: str, call: Callable[..., Any]) -> tuple[type, ...]:
    """The class of that name, or those that it is another name of, where the function or a door knows it."""
    found = getattr(inspect.unwrap(call), "__globals__", {}).get(name)
    for package, homes in DOORS.items():
        if found is None and name in homes:
            found = getattr(sys.modules[package], name)
    alternatives = get_args(found) if isinstance(found, UnionType) or get_origin(found) is Union else (found,)
    classes = tuple(get_origin(each) or each for each in alternatives)
    return classes if all(isinstance(each, type) for each in classes) else ()


def _is_ours(kind: str, call: Callable[..., Any]) -> bool:
    """Whether it may be an object of a class of ours."""
    return any(each.__module__.partition(".")[0] in DOORS for name in _names(kind) for each in _classes(name, call))


def _makers(name: str) -> list[str]:
    """Functions at the doors that return one of that class, of the modules that are loaded."""
    return [
        each
        for homes in DOORS.values()
        for each, home in homes.items()
        if name[:1].isupper() and name != "None" and home in sys.modules
        if getattr(getattr(sys.modules[home], each, None), "__annotations__", {}).get("return") == name
    ]


def _said(value: Any) -> str:
    if value is None or isinstance(value, (str, numbers.Number)):
        return shown(value)
    if type(value).__module__ == "numpy":
        return f"an array of shape {value.shape}"
    name = type(value).__name__
    return f"{'an' if name[0] in 'AEIOUaeiou' else 'a'} {name}"
