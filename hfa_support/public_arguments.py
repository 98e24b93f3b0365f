"""Check of the kinds of arguments of public functions, by the annotations of the functions."""

from __future__ import annotations

import builtins
import inspect
import sys
from collections import ChainMap
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import fields
from functools import wraps
from itertools import chain
from pathlib import Path
from types import FunctionType, NoneType, UnionType
from typing import Any, Literal, Union, get_args, get_origin

import numpy as np

from hfa_support.errors import OWN, BadInputError, numbers_in
from hfa_support.imports import origins_in
from hfa_support.progress import Progress

#: Kind in an annotation -> the word of a refusal, and methods of which its objects have one.
_KINDS: dict[Any, tuple[str, tuple[str, ...]]] = {
    NoneType: ("None", ()),
    str: ("a text", ()),
    bool: ("True or False", ()),
    int: ("a whole number", ("__index__",)),
    float: ("a number", ("__float__",)),
    Path: ("a path", ("__fspath__",)),
    Mapping: ("a dictionary", ("keys",)),
    **dict.fromkeys((Callable, Progress), ("a function", ("__call__",))),
    np.ndarray: ("an array", ("__array__", "__float__", "__iter__")),  # others are converted
    **dict.fromkeys((Sequence, Collection, Iterable, tuple), ("a list", ("__iter__",))),
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


def _alternatives(annotation: str, module: str) -> tuple[Any, ...]:
    """Return the kinds in an annotation, "ArrayLike | None", one of which a value must have.

    module: name of the module with the annotation
    """
    names = _Names({"ArrayLike": np.ndarray}, vars(sys.modules[module]), vars(builtins))
    # An array of symbols is converted from other arrays.
    kind = eval(annotation.replace("ca.SX", "ArrayLike"), {}, names)
    return get_args(kind) if get_origin(kind) in (Union, UnionType) else (kind,)


def _is_of(value: Any, annotated: Any) -> bool:
    """Return whether a value is of one kind in an annotation."""
    kind, of_value = get_origin(annotated) or annotated, type(value)
    if kind in (Any, Literal) or isinstance(kind, str):  # aliases and words, which functions check
        return True
    if kind is not annotated and hasattr(kind, "_fields"):  # of any quantities, by its names
        return hasattr(value, "_fields")
    if kind is bool:
        return of_value.__name__ == "bool"  # also that of NumPy
    if kind in (int, float) and (of_value is bool or getattr(value, "ndim", 0) > 0):
        return False  # an array of one number is not a number
    word, methods = _KINDS.get(kind, ("", ()))
    if not methods:
        return isinstance(value, kind)
    if word in ("an array", "a list") and isinstance(value, str | bytes):
        return False
    # By its class: a class itself has the `__call__` of its type.
    has_method = any(name in vars(base) for base in of_value.__mro__ for name in methods)
    has_texts = word == "a list" and str in get_args(annotated) and isinstance(value, Collection)
    return has_method and not (has_texts and any(not isinstance(each, str) for each in value))


def _word(annotated: Any) -> str:
    """Return what a refusal calls a kind, "a list of texts"."""
    kind = get_origin(annotated) or annotated
    name = getattr(kind, "__name__", "")
    article = "an" if name[:1] in "AEIO" else "a"  # "a LinearModel": a class of the project
    word, _ = _KINDS.get(kind, (f"{article} {name}", ()))
    return f"{word} of texts" if word == "a list" and str in get_args(annotated) else word


def checked(function: Callable[..., Any], makers: Callable[[str], str]) -> Callable[..., Any]:
    """Return a public function or method that refuses arguments of another kind than its
    annotations state, and whose results have such methods.

    Only callers outside of the project are checked, and only the kind, and whether arrays are real:
    the function checks shapes, units and signs.

    makers: name of a class -> advice on how an object of this class is made, or ""

    The returned function raises BadInputError for an argument of another kind.
    """
    accepted: dict[str, set[Any]] = {}  # argument -> kinds that need no further check

    @wraps(function)
    def called(*args: Any, **options: Any) -> Any:
        """Check the arguments, unless the project calls, and call the function."""
        caller = sys._getframe(1).f_globals.get("__name__", "")
        if caller.startswith(OWN):
            return function(*args, **options)
        if not accepted:
            accepted.update({name: set() for name in inspect.signature(function).parameters})
        for name, value in chain(zip(accepted, args, strict=False), options.items()):
            is_array = type(value) is np.ndarray
            kind = value.dtype if is_array else type(value)
            if name in accepted and kind not in accepted[name]:
                _check(name, value, function.__annotations__.get(name, "object"), function, makers)
                # Another list may have elements of other types, and is checked again.
                if is_array or kind is str or not isinstance(value, Collection):
                    accepted[name].add(kind)
        try:
            made = function(*args, **options)
        except TypeError:
            try:
                inspect.signature(function).bind(*args, **options)
            except TypeError as error:
                missing = [name for name in accepted if f"'{name}'" in str(error)]
                hints = (str(function.__annotations__.get(name, "object")) for name in missing)
                kinds = (_alternatives(hint, function.__module__) for hint in hints)
                advice = _advice(chain(*kinds), makers)
                raise BadInputError(f"{function.__name__}: {error}{advice}") from None
            raise
        if type(made) not in _checking_classes:
            check_methods(type(made), makers)
        return made

    return called


def _advice(kinds: Iterable[Any], makers: Callable[[str], str]) -> str:
    """Return the end of a message: how objects of kinds are made."""
    return "".join(f"; {text}" for kind in kinds if (text := makers(getattr(kind, "__name__", ""))))


def check_methods(kind: type, makers: Callable[[str], str]) -> None:
    """Replace the public methods of a class of the project, and of its bases, by `checked` ones.

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
            if name.startswith("_"):
                continue
            if isinstance(member, FunctionType):
                setattr(base, name, checked(member, makers))
            elif isinstance(member, staticmethod | classmethod):
                setattr(base, name, type(member)(checked(member.__func__, makers)))


#: Classes whose methods check their arguments.
_checking_classes: set[type] = set()


def check_fields(made: Any) -> None:
    """Raise BadInputError if a field of a new object of a dataclass, given by a user, is of another
    kind than its annotation.

    As in `checked`, calls of the project's own code are not checked.
    """
    # Below this call are `__post_init__`, the generated `__init__`, and for a changed copy
    # `dataclasses.replace`; who makes the object calls these.
    level, of_class = 1, (type(made).__module__, "dataclasses")
    while (caller := sys._getframe(level).f_globals.get("__name__", "")) in of_class:
        level += 1
    if caller.startswith(OWN):
        return
    for field in fields(made):
        value = getattr(made, field.name)
        if value is not field.default:  # which need not be of the kind that users give
            _check(field.name, value, str(field.type), type(made))


def _check(
    name: str,
    value: Any,
    annotation: str,
    owner: Callable[..., Any],
    makers: Callable[[str], str] = lambda _: "",
) -> None:
    """Raise BadInputError if an argument is not of a kind of its annotation.

    owner: the function, or the class of a field, for the message
    makers: name of a class -> advice on how an object of this class is made, or ""
    """
    kinds = _alternatives(annotation, owner.__module__)
    accepting = [kind for kind in kinds if _is_of(value, kind)]
    # The function itself reads the labels of a frame, which has `loc`.
    if accepting and {*accepting} <= {np.ndarray} and not hasattr(value, "loc"):
        numbers_in(name, value)
    if accepting:
        return
    known = " or ".join(_word(kind) for kind in kinds if kind is not NoneType)
    raise BadInputError(
        f"{owner.__name__}: {name} is of type {_type_of(value)}; give {known}"
        f"{_advice(kinds, makers)}"
    )


def _type_of(value: Any) -> str:
    """Return the name of the type of a value: "float", "list of int" for a list with an int."""
    kind = type(value).__name__
    if kind not in ("list", "tuple"):
        return kind
    others = {type(element).__name__ for element in value if not isinstance(element, str)}
    return f"{kind} of {min(others)}" if others else kind
