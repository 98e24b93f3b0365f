"""Results whose data files, schema and documentation follow from their class.

A `Result` is a dataclass. Its entries are its fields and properties. The annotation declares the
type. The line "name: meaning" of the class's docstring, or the docstring of the property, states
the meaning. JSON, files, the JSON Schema and the page of formats follow from these.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields
from enum import Enum
from functools import reduce
from typing import Annotated, Any, ClassVar, NamedTuple

import numpy as np

from hfa_support.jsonable import finite_or_none, jsonable

#: Arrays with one, two and three axes.
Vector = Annotated[np.ndarray, 1]
Matrix = Annotated[np.ndarray, 2]
Stack = Annotated[np.ndarray, 3]
#: Complex numbers, in the data (re, im) each.
Roots = Annotated[np.ndarray, 2]
RootTable = Annotated[np.ndarray, 3]
#: A named tuple of numbers.
Record = Annotated[Any, Mapping[str, float]]


class Entry(NamedTuple):
    """Entry of the data of a result.

    name: its key
    path: names of the field or property and of those that lead to it; the value is None where one
        of them is None
    is_optional: whether it is omitted where it is None or an array without elements
    """

    name: str
    path: tuple[str, ...]
    is_optional: bool


class Result:
    """Dataclass whose entries are written as data, also within other data.

    schema: name and number of the format of a result that is written separately, or "" for a part
    made_by: command that writes it
    json_keys: entries in their order, each the name of a field or property, or KEY=FIELD.PROPERTY.
        A ? after the key omits the entry when it is None or empty. "" selects all fields; those
        with the default None are omitted when None.
    """

    schema: ClassVar[str] = ""
    made_by: ClassVar[str] = ""
    json_keys: ClassVar[str] = ""

    def as_data(self) -> dict[str, Any]:
        """Return key -> value as stored in files, with arrays unchanged."""
        data: dict[str, Any] = {"schema": self.schema} if self.schema else {}
        for entry in declared_entries(type(self)):
            value = reduce(_attribute, entry.path, self)
            if not (entry.is_optional and _is_empty(value)):
                data[entry.name] = plain(value)
        return data

    def to_dict(self) -> dict[str, Any]:
        """Return key -> plain value, for JSON."""
        data: dict[str, Any] = jsonable(self.as_data())
        return data


def _attribute(value: Any, name: str) -> Any:
    """Return the attribute of a value, or None for None."""
    return None if value is None else getattr(value, name)


def plain(value: Any) -> Any:
    """Return a value as stored in files.

    Results and named tuples become objects, complex numbers (re, im), and numbers that are not
    finite None. Arrays are unchanged.
    """
    if isinstance(value, Result):
        return value.as_data()
    if hasattr(value, "_asdict"):
        return plain(value._asdict())
    if isinstance(value, Mapping):
        return {name: plain(entry) for name, entry in value.items()}
    if isinstance(value, (list, tuple)):
        return [plain(entry) for entry in value]
    if isinstance(value, np.ndarray):
        return np.stack([value.real, value.imag], -1) if np.iscomplexobj(value) else value
    if isinstance(value, complex):
        return [value.real, value.imag]
    if isinstance(value, Enum):
        return value.value
    return finite_or_none(value) if isinstance(value, float) else value


def _is_empty(value: Any) -> bool:
    """Return whether a value is None or an array without elements."""
    if isinstance(value, np.ndarray):
        return value.size == 0
    return value is None or value in ([], ())


def declared_entries(kind: type[Result]) -> tuple[Entry, ...]:
    """Return the entries of a class, in order."""
    if kind.json_keys:
        return tuple(map(_entry, kind.json_keys.split()))
    shown = [field for field in fields(kind) if field.repr]  # type: ignore[arg-type]
    return tuple(Entry(field.name, (field.name,), field.default is None) for field in shown)


def _entry(text: str) -> Entry:
    """Return the entry declared by KEY, KEY? or KEY=FIELD.PROPERTY."""
    key, _, path = text.partition("=")
    name = key.removesuffix("?")
    return Entry(name, tuple((path or name).split(".")), key.endswith("?"))
