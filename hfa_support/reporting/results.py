"""Base class of results whose data files, schema and documentation are derived from the class.

The entries of a `Result` are its fields and the properties marked by `stored`. Annotations declare
the types of the entries. A line "name: meaning" in the docstring of the class describes a field,
and the docstring of a property describes the property. JSON, data files, the JSON Schema and the
page of formats are derived from these declarations.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import fields
from enum import Enum
from functools import cached_property, reduce
from typing import Annotated, Any, ClassVar, NamedTuple, TypeVar

import numpy as np

from hfa_support.reporting.data_files import jsonable

#: Arrays with one, two and three axes.
Vector = Annotated[np.ndarray, 1]
Matrix = Annotated[np.ndarray, 2]
Stack = Annotated[np.ndarray, 3]
#: Complex numbers, stored as (re, im) each.
Roots = Annotated[np.ndarray, 2]
RootTable = Annotated[np.ndarray, 3]
#: A named tuple of numbers.
Record = Annotated[Any, Mapping[str, float]]


Getter = TypeVar("Getter", bound=Callable[..., Any])


class Entry(NamedTuple):
    """Entry in the data of a result.

    name: key of the entry
    path: names of nested attributes that lead to the value. The value is None if one of the
      attributes is None.
    is_optional: whether the entry is omitted if its value is None or empty
    """

    name: str
    path: tuple[str, ...]
    is_optional: bool


#: Metadata of a field that files do not contain.
UNSTORED: Mapping[str, Any] = {"stored": False}


def stored_as(key: str = "", *, optional: bool | None = None) -> dict[str, Any]:
    """Return the metadata of a field of a `Result`, as in `field(metadata=stored_as("A_exact"))`.

    key: key of the entry, by default the name of the field, as for a field without metadata
    optional: whether the entry is omitted if it is None or empty, by default whether the field has
      the default None
    """
    return {"stored": True, "key": key, "optional": optional}


def stored_parts(*, optional: bool = False, **paths: str) -> dict[str, Any]:
    """Return the metadata of a field of which files contain parts only.

    optional: whether the entries are omitted if they are None or empty
    paths: key of an entry -> the attribute of the field's value, as in "game.delta"
    """
    return {"stored": False, "parts": paths, "optional": optional}


def stored(key: str = "", *, optional: bool = False) -> Callable[[Getter], Getter]:
    """Return a decorator, below `@property` or `@cached_property`, for a property that is an entry.

    key: key of the entry, by default the name of the property
    optional: whether the entry is omitted if it is None or empty
    """

    def mark(getter: Getter) -> Getter:
        name = getter.__name__
        getter.__dict__["entry"] = Entry(key or name, (name,), optional)
        return getter

    return mark


class Result:
    """Base class of dataclasses that are stored as files or as parts of other results.

    schema: name and version of the file format, or "" for a part of other results
    made_by: command that writes the file

    The entries are the fields, and the properties marked by `stored`, also those of base classes. A
    field replaces a property with the same key.
    """

    schema: ClassVar[str] = ""
    made_by: ClassVar[str] = ""

    def as_data(self) -> dict[str, Any]:
        """Return the entries of the result, key -> value. Arrays are kept as arrays.

        Optional entries without a value are omitted.
        """
        data: dict[str, Any] = {"schema": self.schema} if self.schema else {}
        for entry in declared_entries(type(self)):
            value = reduce(_attribute, entry.path, self)
            if not (entry.is_optional and _is_empty(value)):
                data[entry.name] = plain(value)
        return data

    def to_dict(self) -> dict[str, Any]:
        """Return the entries of the result, key -> value, with values that JSON can contain."""
        data: dict[str, Any] = jsonable(self.as_data())
        return data


def _attribute(value: Any, name: str) -> Any:
    """Return an attribute of an object, or None if the object is None."""
    return None if value is None else getattr(value, name)


def plain(value: Any) -> Any:
    """Return a value in the form that is stored in files. The items of lists and mappings are
    converted.

    - results, named tuples, mappings: dictionaries
    - lists and tuples: lists
    - members of an Enum: their values
    - complex numbers: [re, im]
    - complex arrays: real arrays with a last axis (re, im)
    - real arrays and other values: unchanged, also inf and nan, which JSON files store as null
    """
    if isinstance(value, Result):
        return value.as_data()
    if hasattr(type(value), "_asdict"):
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
    return value


def _is_empty(value: Any) -> bool:
    """Return whether a value is None, an empty list or tuple, or an array without elements."""
    if isinstance(value, np.ndarray):
        return value.size == 0
    return value is None or value in ([], ())


def getter_of(value: Any) -> Callable[[Any], Any] | None:
    """Return the function of a property or cached property, or None for other class attributes."""
    if isinstance(value, cached_property):
        return value.func
    return value.fget if isinstance(value, property) else None


def declared_entries(kind: type[Result]) -> tuple[Entry, ...]:
    """Return the entries that a class of results declares, in the order of its data."""
    of_fields = {entry.name: entry for entry in _stored_fields(kind)}
    of_properties = {entry.name: entry for entry in _stored_properties(kind)}
    return tuple((of_fields | of_properties | of_fields).values())


def _stored_properties(kind: type[Result]) -> Iterator[Entry]:
    for ancestor in reversed(kind.__mro__):
        for value in vars(ancestor).values():
            marked = getattr(getter_of(value), "entry", None)
            if marked:
                yield marked


def _stored_fields(kind: type[Result]) -> Iterator[Entry]:
    for field in fields(kind):  # type: ignore[arg-type]  # a dataclass
        declared = field.metadata
        is_optional = declared.get("optional")
        if is_optional is None:
            is_optional = field.default is None
        if declared.get("stored", True):
            yield Entry(declared.get("key") or field.name, (field.name,), is_optional)
        for key, path in declared.get("parts", {}).items():
            yield Entry(key, (field.name, *path.split(".")), is_optional)


class ByValue:
    """Base class of dataclasses (`eq=False`) that are compared by the values of their fields.

    Arrays are compared entry by entry, and nan equals nan. The comparison generated by `dataclass`
    would raise an error for arrays.
    """

    def __eq__(self, other: object) -> bool:
        if type(other) is not type(self):
            return NotImplemented
        return all(
            _same(getattr(self, field.name), getattr(other, field.name))
            for field in fields(self)  # type: ignore[arg-type]  # a dataclass
            if field.compare
        )


def _same(one: Any, other: Any) -> bool:
    if isinstance(one, np.ndarray) and isinstance(other, np.ndarray):
        return np.array_equal(
            one, other, equal_nan=one.dtype.kind in "fc" and other.dtype.kind in "fc"
        )
    return bool(one == other)
