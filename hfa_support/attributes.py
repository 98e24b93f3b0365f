"""Base class of values whose AttributeError says what to write instead."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import suppress
from dataclasses import fields, is_dataclass
from typing import TYPE_CHECKING, Any, ClassVar, TypeVar

from hfa_support.errors import advice
from hfa_support.other_words import MEANINGS

Tuple = TypeVar("Tuple", bound=tuple[Any, ...])


class Advised:
    """Base class of public values, whose AttributeError says where the attribute is.

    The error names what `_instead` says, the entry or the field with this attribute, or the nearest
    attributes.

    _instead: name of an attribute that the class lacks -> what to write
    """

    _instead: ClassVar[Mapping[str, str]] = {}

    if not TYPE_CHECKING:

        def __getattr__(self, name: str) -> Any:
            """Raise AttributeError that says what to write instead."""
            if name[0] == "_":
                raise AttributeError(name)
            if hasattr(type(self), name):  # a property that raises AttributeError
                object.__getattribute__(self, name)
            kind = type(self).__name__
            raise AttributeError(f"{kind} has no attribute {name!r}{_remedy(self, name)}")


def advised(kind: type[Tuple]) -> type[Tuple]:
    """Return a class of named tuples with the errors of `Advised`, as a decorator of the class."""
    setattr(kind, "__getattr__", vars(Advised)["__getattr__"])  # noqa: B010  # unknown to mypy
    return kind


def _remedy(value: Any, name: str) -> str:
    """Return what to write in place of an attribute that a value lacks."""
    instead = getattr(type(value), "_instead", {}).get(name)
    if instead is not None:
        return f"; write {instead}"
    with suppress(Exception):
        value[name]  # an error if the class has no values by name
        return f"; write its [{name!r}]"
    known = [each for each in dir(value) if each[0] != "_"]
    named = fields(value) if is_dataclass(value) else ()
    for field in named:
        inner = vars(value).get(field.name)
        if isinstance(inner, Mapping) and name in inner:
            return f"; write its {field.name}[{name!r}]"
    if {*MEANINGS.get(name.lower(), ())} & {each.lower() for each in known}:
        return advice(name, known)
    for field in named:
        inner = vars(value).get(field.name)
        if field.name not in known or not isinstance(inner, Advised):
            continue
        if name in dir(inner):
            return f"; write its {field.name}.{name}"
        if name in inner._instead:
            return f"; write {inner._instead[name]}"
    return advice(name, known)
