"""Check of the kinds of arguments of public functions, by the annotations of the functions."""

from __future__ import annotations

import builtins
import os
import sys
from collections import ChainMap
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from functools import cache, wraps
from inspect import signature
from itertools import chain
from pathlib import Path
from types import FunctionType, NoneType, UnionType
from typing import (
    Any,
    Protocol,
    SupportsFloat,
    SupportsIndex,
    Union,
    get_args,
    get_origin,
    runtime_checkable,
)

import numpy as np

from hfa_support.errors import OWN, BadInputError, numbers_in
from hfa_support.imports import origins_in
from hfa_support.progress import Progress


def _with(method: str) -> type:
    """Return a class of which all objects with a method are."""
    return runtime_checkable(type("_With", (Protocol,), {method: None}))


#: Kind in an annotation -> the word of a refusal, and the classes of its objects.
_KINDS: dict[Any, tuple[str, Any]] = {
    NoneType: ("None", NoneType),
    str: ("a text", str),
    bool: ("True or False", (bool, np.bool_)),
    int: ("a whole number", SupportsIndex),
    float: ("a number", SupportsFloat),
    Path: ("a path", os.PathLike),
    Mapping: ("a dictionary", _with("keys")),
    **dict.fromkeys((Callable, Progress), ("a function", Callable)),
    np.ndarray: ("an array", (SupportsFloat, Iterable, _with("__array__"))),  # others are converted
    **dict.fromkeys((Sequence, Collection, Iterable, tuple), ("a list", Iterable)),
}


class _Unloaded(type):
    """Class without objects, for one of a package that is not loaded, or such a package."""

    def __getattr__(cls, name: str) -> _Unloaded:
        return _Unloaded(name, (), {})


class _Names(ChainMap[str, Any]):
    """Names of a module, with those that it imports for annotations alone."""

    def __missing__(self, name: str) -> Any:
        module, name_there = origins_in(self["__file__"]).get(name, ("", ""))
        if module not in sys.modules:
            return _Unloaded(name, (), {})
        return getattr(sys.modules[module], name_there) if name_there else sys.modules[module]


@cache
def _code_of(annotation: str) -> Any:
    """Return the compiled text of an annotation."""
    # An array of symbols is converted from other arrays.
    return compile(annotation.replace("ca.SX", "ArrayLike"), annotation, "eval")


def _alternatives(annotation: str, module: str) -> tuple[Any, ...]:
    """Return the kinds in an annotation, "ArrayLike | None", one of which a value must have.

    module: name of the module with the annotation
    """
    names = _Names({"ArrayLike": np.ndarray}, vars(sys.modules[module]), vars(builtins))
    kind = eval(_code_of(annotation), {}, names)
    return get_args(kind) if get_origin(kind) in (Union, UnionType) else (kind,)


def _is_of(value: Any, annotated: Any) -> bool:
    """Return whether a value is of one kind in an annotation."""
    kind = get_origin(annotated) or annotated
    if kind is Any or not isinstance(kind, type):  # aliases and words, which functions check
        return True
    if hasattr(kind, "_fields"):  # of any quantities, by its names
        return hasattr(value, "_fields")
    word, classes = _KINDS.get(kind, ("", kind))
    if not isinstance(value, classes):
        return False
    if kind in (int, float):  # an array of one number is not a number
        return not (isinstance(value, bool) or getattr(value, "ndim", 0) > 0)
    if word in ("an array", "a list") and isinstance(value, str | bytes):
        return False
    has_texts = str in get_args(annotated) and isinstance(value, Collection)
    return word != "a list" or not has_texts or all(isinstance(each, str) for each in value)


def _word(annotated: Any) -> str:
    """Return what a refusal calls a kind, "a list of texts"."""
    kind = get_origin(annotated) or annotated
    name = getattr(kind, "__name__", "")
    article = "an" if name[:1] in "AEIO" else "a"  # "a LinearModel": a class of the project
    word, _ = _KINDS.get(kind, (f"{article} {name}", ()))
    return f"{word} of texts" if word == "a list" and str in get_args(annotated) else word


_signature = cache(signature)


def checked(function: Callable[..., Any], makers: Callable[[str], str]) -> Callable[..., Any]:
    """Return a public function or method that refuses arguments of another kind than its
    annotations state, and whose results have such methods.

    Only callers outside of the project are checked, and only the kind, and whether arrays are real:
    the function checks shapes, units and signs.

    makers: name of a class -> advice on how an object of this class is made, or ""

    The returned function raises BadInputError for an argument of another kind.
    """

    of_class, _, name = function.__qualname__.rpartition(".")
    subject = of_class if name == "__init__" else name
    accepted: dict[str, set[Any]] = {}  # argument -> kinds that need no further check

    @wraps(function)
    def called(*args: Any, **options: Any) -> Any:
        """Check the arguments, unless the project calls, and call the function."""
        frame: Any = sys._getframe(1)
        while (caller := frame.f_globals.get("__name__", "")) == "dataclasses":  # of `replace`
            frame = frame.f_back
        if caller.startswith(OWN):
            return function(*args, **options)
        if not accepted:
            accepted.update({name: set() for name in _signature(function).parameters})
        hints = function.__annotations__
        for name, value in chain(zip(accepted, args, strict=False), options.items()):
            is_array = type(value) is np.ndarray
            kind = value.dtype if is_array else type(value)
            if name in hints and name in accepted and kind not in accepted[name]:
                _check(subject, name, value, hints[name], function, makers)
                # Another list may have elements of other types, and is checked again.
                if is_array or kind is str or not isinstance(value, Collection):
                    accepted[name].add(kind)
        try:
            made = function(*args, **options)
        except TypeError:
            try:
                _signature(function).bind(*args, **options)
            except TypeError as error:
                missing = (hints[name] for name in accepted if f"'{name}'" in str(error))
                kinds = (_alternatives(hint, function.__module__) for hint in missing)
                advice = _advice(chain(*kinds), makers)
                raise BadInputError(f"{subject}: {error}{advice}") from None
            raise
        check_methods(type(made), makers)
        return made

    return called


def _advice(kinds: Iterable[Any], makers: Callable[[str], str]) -> str:
    """Return the end of a message: how objects of kinds are made."""
    return "".join(f"; {text}" for kind in kinds if (text := makers(getattr(kind, "__name__", ""))))


class Declared:
    """Base class of dataclasses whose fields are given as their annotations state."""


def check_methods(kind: type, makers: Callable[[str], str]) -> None:
    """Replace the public methods of a class of the project, and of its bases, by `checked` ones,
    and how a `Declared` object is made.

    Each class is changed once.

    makers: name of a class -> advice on how an object of this class is made, or ""
    """
    for base in kind.__mro__:
        if base in _checking_classes:
            continue
        _checking_classes.add(base)
        if not base.__module__.startswith(OWN):
            continue
        for name, member in [*vars(base).items()]:
            if name.startswith("_") and not (name == "__init__" and issubclass(base, Declared)):
                continue
            if isinstance(member, FunctionType):
                setattr(base, name, checked(member, makers))
            elif isinstance(member, staticmethod | classmethod):
                setattr(base, name, type(member)(checked(member.__func__, makers)))


#: Classes whose methods check their arguments.
_checking_classes: set[type] = set()


def _check(
    subject: str,
    name: str,
    value: Any,
    annotation: str,
    function: Callable[..., Any],
    makers: Callable[[str], str],
) -> None:
    """Raise BadInputError if an argument of a function is not of a kind of its annotation.

    subject: the function or the class, for the message
    makers: name of a class -> advice on how an object of this class is made, or ""
    """
    kinds = _alternatives(annotation, function.__module__)
    accepting = {kind for kind in kinds if _is_of(value, kind)}
    if not accepting:
        known = " or ".join(_word(kind) for kind in kinds if kind is not NoneType)
        raise BadInputError(
            f"{subject}: {name} is of type {_type_of(value)}; give {known}{_advice(kinds, makers)}"
        )
    # The function itself reads the labels of a frame, which has `loc`.
    if accepting == {np.ndarray} and not hasattr(value, "loc"):
        numbers_in(name, value)


def _type_of(value: Any) -> str:
    """Return the name of the type of a value: "float", "list of int" for a list with an int."""
    kind = type(value).__name__
    if kind not in ("list", "tuple"):
        return kind
    others = {type(element).__name__ for element in value if not isinstance(element, str)}
    return f"{kind} of {min(others)}" if others else kind
