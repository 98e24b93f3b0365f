"""Run-time checks of the arguments of public functions against their annotations."""

from __future__ import annotations

import inspect
import sys
from collections.abc import Callable, Mapping, Sequence
from functools import cache, wraps
from numbers import Integral, Real
from pathlib import Path
from types import NoneType, UnionType
from typing import TYPE_CHECKING, Any, TypeVar, Union, cast, get_args, get_origin

import numpy as np

from hfa_support.entry_points import PARTS, part

if TYPE_CHECKING:
    from numpy.typing import ArrayLike as ArrayLike
else:
    ArrayLike = np.ndarray  # annotation that is checked as an array of numbers

Public = TypeVar("Public", bound=Callable[..., Any])
_NUMBERS = "an array of numbers"
#: Bound on the magnitude of whole numbers.
_LARGEST = 2**63
#: Function that tests the type of a value.
_Test = Callable[[Any], bool]


def checks_arguments(public: Public) -> Public:
    """Return a function or class that checks its arguments against their annotations, as a
    decorator.

    For a class, the arguments of the constructor are checked. An argument that does not match
    raises BadInputError. These annotations are checked: classes and unions of classes, numbers,
    whole numbers, booleans, texts, arrays of numbers, mappings, sequences and functions. Items of
    arrays and mappings are not checked. The attribute `how_to_make` of a class is quoted in the
    message. Arrays of pandas and xarray are aligned by their labels.

    >>> import hfa
    >>> hfa.linearize(hfa.aircraft(), None)
    Traceback (most recent call last):
    ...
    hfa_support.errors.BadInputError: linearize: point is None; give an OperatingPoint, made by
    trim(model)
    """
    if isinstance(public, type):
        public.__init__ = _checked(public.__init__, public.__name__, 1)  # type: ignore[misc]
        return public
    return cast(Public, _checked(public, public.__name__, 0))


def _checked(function: Callable[..., Any], name: str, first: int) -> Callable[..., Any]:
    """Return a function that checks its arguments and then calls `function`.

    function: function, or constructor of a class
    name: name of the function or class in messages
    first: position of the first checked argument, 1 to skip `self`
    """

    @wraps(function)
    def checked(*arguments: Any, **named: Any) -> Any:
        if any(hasattr(type(value), "loc") for value in (*arguments, *named.values())):
            in_order = part(PARTS, "notebook.call", "a labelled array")
            arguments, named = in_order(function, arguments, named) or (arguments, named)
        # Annotations are evaluated at the first call, because they may name later definitions.
        for place, parameter, holds, wanted in argument_tests(function, first):
            if place < len(arguments):
                value = arguments[place]
            elif parameter in named:
                value = named[parameter]
            else:
                continue
            if not holds(value):
                from hfa_support.unknown import misfit, result_as_meant

                error = misfit(name, parameter, value, wanted)
                return result_as_meant(checked, arguments, named, error)
        try:
            return function(*arguments, **named)
        except TypeError as error:
            from hfa_support.unknown import mismatch, result_as_meant

            wrong = mismatch(function, name, arguments, named, error)
            return result_as_meant(checked, arguments, named, wrong)

    return checked


@cache
def argument_tests(function: Callable[..., Any], first: int) -> list[tuple[int, str, _Test, str]]:
    """Return the tests of a function's arguments, as (position, name, test, description of valid
    values).

    Arguments without an annotation that can be checked are omitted.

    first: position of the first checked argument
    """
    tests = []
    for place, parameter in enumerate(inspect.signature(function).parameters.values()):
        if place < first or parameter.kind in (parameter.VAR_POSITIONAL, parameter.VAR_KEYWORD):
            continue
        if parameter.kind is parameter.KEYWORD_ONLY:
            place = sys.maxsize
        annotation = evaluated(parameter.annotation, function)
        is_union = get_origin(annotation) in (Union, UnionType)
        members = get_args(annotation) if is_union else (annotation,)
        kinds = [_kind(member) for member in members]
        if parameter.default is None:
            kinds.append(_KINDS[NoneType])
        if all(kind is not None for kind in kinds):
            known = [kind for kind in kinds if kind is not None]
            words = " or ".join(dict.fromkeys(word for _, word in known if word))
            tests.append((place, parameter.name, _any_of([test for test, _ in known]), words))
    return tests


def _any_of(tests: Sequence[_Test]) -> _Test:
    return lambda value: any(test(value) for test in tests)


def evaluated(annotation: Any, function: Callable[..., Any]) -> Any:
    """Return the class or type that the annotation of an argument denotes.

    The result is Any if there is no annotation, or if its name is not defined at run time.

    annotation: the annotation, or its text
    function: function with this argument
    """
    if annotation is inspect.Parameter.empty:
        return Any
    if not isinstance(annotation, str):
        return annotation
    try:
        return eval(annotation, vars(sys.modules[function.__module__]))
    except NameError:
        return Any


def _kind(annotation: Any) -> tuple[_Test, str] | None:
    """Return (test of a value, description of valid values) for an annotation.

    The result is None if annotations of this form are not checked.
    """
    if annotation in _KINDS:
        return _KINDS[annotation]
    origin = get_origin(annotation)
    if origin in _GENERIC:
        return _of_members(_GENERIC[origin], get_args(annotation))
    if annotation is Any or not isinstance(annotation, type):  # Any is a class since Python 3.11
        return None
    if getattr(annotation, "_is_protocol", False):
        return (callable, "a function") if "__call__" in vars(annotation) else None
    name = annotation.__name__
    article = "an" if name[0] in "AEIOU" else "a"
    made = getattr(annotation, "how_to_make", "")
    words = f"{article} {name}" + (f", made by {made}" if made else "")
    return lambda value: isinstance(value, annotation), words


def _of_members(whole: tuple[_Test, str], arguments: tuple[Any, ...]) -> tuple[_Test, str]:
    """Return (test of a value, description of valid values) for a sequence and, if possible, its
    items.

    Items are tested for `Sequence[X]` and `tuple[X, ...]`, where X is a class other than a number
    or an array.

    whole: test and description of the sequence itself
    arguments: arguments of the annotation, for example (X, ...)
    """
    holds, words = whole
    of_one_kind = len(arguments) == 1 or (len(arguments) == 2 and arguments[1] is Ellipsis)
    member = arguments[0] if of_one_kind else Any
    is_class = isinstance(member, type) and member not in (Any, float, int, bool, np.ndarray)
    known = _kind(member) if is_class else None
    if known is None:
        return whole
    is_member, called = known
    return (
        lambda value: holds(value) and all(map(is_member, value)),
        f"{words} in which each is {called}",
    )


def _is_number(value: Any) -> bool:
    return isinstance(value, Real) and not isinstance(value, bool)


def _is_whole(value: Any) -> bool:
    is_integer = isinstance(value, Integral) and not isinstance(value, bool)
    return is_integer and -_LARGEST <= value < _LARGEST


def _is_array(value: Any) -> bool:
    """Return whether NumPy converts a value to an array of real numbers or to an empty array."""
    try:
        array = np.asarray(value)
        return array.dtype.kind in "fiu" or array.size == 0
    except Exception:  # a user's class may raise any exception
        return False


def _is_sequence(value: Any) -> bool:
    return isinstance(value, Sequence) and not isinstance(value, (str, bytes)) and _is_read(value)


def _is_mapping(value: Any) -> bool:
    return isinstance(value, Mapping) and _is_read(value)


def _is_read(value: Any) -> bool:
    """Return whether the items of a collection can be iterated without an exception."""
    try:
        list(value.items() if isinstance(value, Mapping) else value)
    except Exception:
        return False
    return True


_KINDS: dict[Any, tuple[_Test, str]] = {
    float: (_is_number, "a number"),
    int: (_is_whole, "a whole number"),
    bool: (lambda value: isinstance(value, (bool, np.bool_)), "True or False"),
    str: (lambda value: isinstance(value, str), "a text"),
    Path: (lambda value: isinstance(value, Path), "a path"),
    np.ndarray: (_is_array, _NUMBERS),
    NoneType: (lambda value: value is None, ""),
}
_GENERIC: dict[Any, tuple[_Test, str]] = {
    Mapping: (_is_mapping, "a dictionary"),
    Sequence: (_is_sequence, "a list or tuple"),
    tuple: (_is_sequence, "a tuple"),
    list: (_is_sequence, "a list"),
    Callable: (callable, "a function"),
}
