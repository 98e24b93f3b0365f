"""Check of the kinds of arguments of public functions, by the annotations of the functions."""

from __future__ import annotations

import ast
import inspect
import os
import sys
from collections.abc import Callable, Collection, Iterator
from dataclasses import fields
from functools import cache, wraps
from itertools import chain
from types import EllipsisType, FunctionType, UnionType
from typing import Any, NamedTuple, get_args

import numpy as np

from hfa_support.errors import OWN, BadInputError, numbers_in

#: Names of arrays in annotations.
_ARRAYS = {"ArrayLike", "np.ndarray"}
#: Types of texts, which are iterable and are no lists.
_TEXTS = str | bytes
#: Name in an annotation, of kinds that are not classes of the project -> the word of a refusal, and
#: whether a type of arguments is of this kind.
_KINDS: dict[str, tuple[str, Callable[[type], bool]]] = {
    "Any": ("", lambda kind: True),
    **dict.fromkeys(("None", "NoneType"), ("None", lambda kind: kind is type(None))),
    "str": ("a text", lambda kind: issubclass(kind, str)),
    "Path": ("a path", lambda kind: issubclass(kind, os.PathLike)),
    "int": ("a whole number", lambda kind: kind is not bool and _has(kind, "__index__")),
    "bool": ("True or False", lambda kind: kind.__name__ == "bool"),  # also that of NumPy
    "float": ("a number", lambda kind: kind is not bool and _has(kind, "__float__")),
    "Mapping": ("a dictionary", lambda kind: _has(kind, "keys")),
    **dict.fromkeys(("Callable", "Progress"), ("a function", lambda kind: _has(kind, "__call__"))),
    **dict.fromkeys(
        (*_ARRAYS, "ca.SX"),  # a number and a sequence are converted
        (
            "an array",
            lambda kind: (
                not issubclass(kind, _TEXTS) and _has(kind, "__array__", "__float__", "__iter__")
            ),
        ),
    ),
    **dict.fromkeys(
        ("Sequence", "Collection", "Iterable", "tuple"),
        ("a list", lambda kind: not issubclass(kind, _TEXTS) and _has(kind, "__iter__")),
    ),
}


class _Alternative(NamedTuple):
    """One kind of a union in an annotation.

    name: name of the kind, "Sequence" of Sequence[str]
    elements: kind of its elements, "str" of Sequence[str] and of tuple[str, ...], else ""
    arguments: number of the arguments of a function, 2 of Callable[[Any, Any], float], else None
    """

    name: str
    elements: str = ""
    arguments: int | None = None

    @property
    def word(self) -> str:
        """What a refusal calls the kind, "a list of texts"."""
        what = " of texts" if self.elements == "str" else ""
        if self.arguments is not None:
            what = " of 1 argument" if self.arguments == 1 else f" of {self.arguments} arguments"
        of_class = self.name.rpartition(".")[2]  # "a LinearModel": a class of the project
        of_class = f"{'an' if of_class[0] in 'AEIO' else 'a'} {of_class}"
        return _KINDS.get(self.name, (of_class,))[0] + what

    def accepts(self, value: Any, module: str) -> bool:
        """Return whether a value is of this kind.

        module: name of the module with the annotation, which may import the kind
        """
        if not _is_of(type(value), self.name, module):
            return False
        if self.name in ("int", "float"):
            return getattr(value, "ndim", 0) == 0  # an array of one number is not a number
        if self.arguments is not None:
            return _takes(value, self.arguments)
        has_texts = self.elements == "str" and isinstance(value, Collection)
        return not has_texts or all(isinstance(element, str) for element in value)


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
                _check(name, value, function.__annotations__.get(name, "Any"), function, makers)
                # Another list may have elements of other types, and is checked again.
                if is_array or kind is str or not isinstance(value, Collection):
                    accepted[name].add(kind)
        try:
            made = function(*args, **options)
        except TypeError as error:
            _refuse_other_arguments(function, args, options, makers, str(error))
            raise
        if type(made) not in _checking_classes:
            check_methods(type(made), makers)
        return made

    return called


def _refuse_other_arguments(
    function: Callable[..., Any],
    args: tuple[Any, ...],
    options: dict[str, Any],
    makers: Callable[[str], str],
    reason: str,
) -> None:
    """Raise BadInputError if a function has no such arguments, or requires others.

    reason: message of Python
    """
    signature = inspect.signature(function)
    try:
        signature.bind(*args, **options)
    except TypeError:
        given = [*signature.parameters][: len(args)]
        missing = (
            kind
            for name, parameter in signature.parameters.items()
            if parameter.default is parameter.empty and name not in given and name not in options
            for kind in _alternatives(str(parameter.annotation))
        )
        how = "".join(f"; {text}" for kind in missing if (text := makers(kind.name)))
        raise BadInputError(f"{reason}{how}") from None


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
    kinds = _alternatives(annotation)
    accepting = {kind.name for kind in kinds if kind.accepts(value, owner.__module__)}
    # The function itself reads the labels of a frame, which has `loc`.
    if accepting and accepting <= _ARRAYS and not hasattr(value, "loc"):
        numbers_in(name, value)
    if accepting:
        return
    known = " or ".join(kind.word for kind in kinds if kind.name != "None")
    how = "".join(f"; {text}" for text in (makers(kind.name) for kind in kinds) if text)
    raise BadInputError(f"{owner.__name__}: {name} is of type {_type_of(value)}; give {known}{how}")


def _type_of(value: Any) -> str:
    """Return the name of the type of a value: "float", "list of int" for a list with an int."""
    kind = type(value).__name__
    if kind not in ("list", "tuple"):
        return kind
    others = {type(element).__name__ for element in value if not isinstance(element, str)}
    return f"{kind} of {min(others)}" if others else kind


@cache
def _alternatives(annotation: str) -> tuple[_Alternative, ...]:
    """Return the kinds in an annotation, "ArrayLike | None", one of which a value must have."""
    return (*_kinds_in(ast.parse(annotation, mode="eval").body),)


def _kinds_in(annotation: ast.expr) -> Iterator[_Alternative]:
    """Yield the kinds of a union, from left to right."""
    match annotation:
        case ast.BinOp(left=left, op=ast.BitOr(), right=right):
            yield from _kinds_in(left)
            yield from _kinds_in(right)
        case ast.Subscript(slice=ast.Name(id="Quantity")):  # State[Quantity] may have symbols
            yield _Alternative("Any")
        case ast.Subscript(
            value=kind,
            slice=ast.Name(id=elements)  # Sequence[str]
            | ast.Tuple(elts=[ast.Name(id=elements), ast.Constant(value=EllipsisType())]),
        ):  # tuple[str, ...]
            yield _Alternative(ast.unparse(kind), elements)
        case ast.Subscript(
            value=kind, slice=ast.Tuple(elts=[ast.List(elts=arguments), _])
        ):  # Callable[[Any], float]
            yield _Alternative(ast.unparse(kind), arguments=len(arguments))
        case ast.Subscript(value=kind):  # Mapping[str, float]
            yield _Alternative(ast.unparse(kind))
        case _:
            yield _Alternative(ast.unparse(annotation))


def _takes(function: Any, count: int) -> bool:
    """Return whether a function takes this number of arguments; True if it has no signature."""
    try:
        inspect.signature(function).bind(*range(count))
    except ValueError:  # no signature
        return True
    except TypeError:
        return False
    return True


def _is_of(kind: type, name: str, module: str) -> bool:
    """Return whether a type is of the kind that a name in an annotation states.

    Classes are known by their names, so that they need not be imported. Of other objects of this
    name only a union is examined: a protocol, or a list of words, is the function's to check.

    module: name of the module with the annotation
    """
    if name in _KINDS:
        _, is_of_kind = _KINDS[name]
        return is_of_kind(kind)
    if any(base.__name__ == name.rpartition(".")[2] for base in kind.__mro__):
        return True
    own = (each for title, each in [*sys.modules.items()] if title.startswith(OWN))
    modules = [vars(each) for each in (sys.modules[module], *own)]
    annotated = next((each[name] for each in modules if name in each), type)
    if isinstance(annotated, UnionType):
        return any(_is_of(kind, each.__name__, module) for each in get_args(annotated))
    meant = getattr(annotated, "__name__", name)
    if annotated is not type and meant != name:  # another name of a class
        return _is_of(kind, meant, module)
    return not isinstance(annotated, type) or getattr(annotated, "_is_protocol", False)


def _has(kind: type, *attributes: str) -> bool:
    """Return whether objects of a type have one of some attributes by their class: `hasattr` would
    say that a type has `__call__` if the type itself can be called.
    """
    return any(name in vars(base) for base in kind.__mro__ for name in attributes)
