"""Handling of unknown attributes, unsuitable arguments and unknown public names.

An installed package may supply or correct them. Otherwise the error suggests the nearest known
names.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable, Iterable
from importlib.util import find_spec
from typing import Any

import numpy as np

from hfa_support.entry_points import PARTS, offered, part
from hfa_support.errors import BadInputError, advice, numbers_in, shown


def attribute_of(value: Any, name: str, *more: str) -> Any:
    """Return an attribute that an installed package adds to a result.

    value: the result
    name: name of the attribute
    more: further attribute names that the message may suggest

    Raises AttributeError with the nearest attributes if no package supplies the attribute.
    """
    if "notebook.attribute" in offered(PARTS):
        return part(PARTS, "notebook.attribute", "")(value, name, *more)
    raise no_attribute(value, name, *more)


def no_attribute(value: object, name: str, *more: str) -> AttributeError:
    """Return the AttributeError for an unknown attribute of a result, with the nearest attributes.

    value: the result
    name: name of the attribute
    more: further attribute names that the message may suggest

    If the class has a property of this name, the error that the property raises is raised here.
    """
    if hasattr(type(value), name):
        object.__getattribute__(value, name)
    known = [each for each in (*dir(value), *more) if each[0] != "_"]
    return AttributeError(f"{type(value).__name__} has no attribute {name!r}{advice(name, known)}")


def misfit(name: str, parameter: str, value: Any, wanted: str) -> BadInputError:
    """Return the BadInputError for an argument that does not match its annotation.

    name: name of the function, for the message
    parameter: name of the argument
    value: the given value
    wanted: description of a valid argument

    Raises a BadInputError that names the faulty row if the argument must be an array of numbers and
    the value has such a row.
    """
    if wanted.endswith("an array of numbers") and type(value) in (list, tuple, np.ndarray):
        numbers_in(f"{name}: {parameter}", value)
    saved = ", or the file in which the policy is saved" if hasattr(value, "predict") else ""
    return BadInputError(f"{name}: {parameter} is {_description(value)}; give {wanted}{saved}")


def _description(value: Any) -> str:
    """Return a description of a value for messages.

    Numbers, texts and None are shown. An array is described by its shape, another object by its
    type.
    """
    if value is None or isinstance(value, (bool, int, float, complex, str, bytes)):
        return shown(value)
    if isinstance(value, np.ndarray):
        return f"an array of shape {value.shape}"
    name = type(value).__name__
    return f"{'an' if name[:1].lower() in 'aeiou' else 'a'} {name}"


def mismatch(
    function: Callable[..., Any],
    name: str,
    arguments: tuple[Any, ...],
    named: dict[str, Any],
    error: TypeError,
) -> BadInputError:
    """Return the BadInputError for a call with missing, unknown or too many arguments.

    name: name of the function, for the message
    error: TypeError that the call raised

    Raises `error` itself if the arguments match the signature of the function.
    """
    signature = inspect.signature(function)
    try:
        signature.bind(*arguments, **named)
    except TypeError as wrong:
        known = [each for each in signature.parameters if each != "self"]
        near = next((advice(word, known) for word in named if word not in known), "")
        return BadInputError(f"{name}: {wrong}{near}; the arguments are {', '.join(known)}")
    raise error


def result_as_meant(
    checked: Callable[..., Any],
    arguments: tuple[Any, ...],
    named: dict[str, Any],
    error: BadInputError,
) -> Any:
    """Return the result of a function for corrected arguments, after a call with unsuitable
    arguments.

    An installed package supplies the correction.

    checked: the function
    arguments, named: arguments of the failed call
    error: error to raise if the arguments are not corrected

    Raises `error` if no package corrects the arguments.
    """
    meant = None
    if "notebook.call" in offered(PARTS):
        read = part(PARTS, "notebook.call", "")
        meant = read(inspect.unwrap(checked), arguments, named)
    if meant is None:
        raise error from None
    return checked(*meant[0], **meant[1])


def unknown_name(
    package: str, name: str, get: Callable[[str], Any], known: Iterable[str]
) -> Callable[..., Any]:
    """Return the function that an installed package supplies for an unknown public name.

    package: package in which the name was sought
    name: the unknown name
    get: function that returns the object with a public name
    known: the public names

    Raises AttributeError with the nearest names if no package supplies the function.
    """
    is_module = find_spec(f"{package}.{name}") is not None  # Python imports it after this error
    if not is_module and package == "hfa" and "notebook.function" in offered(PARTS):
        function: Callable[..., Any] | None = part(PARTS, "notebook.function", "")(name, get)
        if function is not None:
            return function
    raise AttributeError(f"module {package!r} has no attribute {name!r}{advice(name, known)}")
