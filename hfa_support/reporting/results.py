"""Results as dictionaries, and the files that hold them."""

from __future__ import annotations

import csv
import io
import json
import math
import re
from collections.abc import Iterator, Mapping
from dataclasses import fields
from enum import Enum
from functools import cached_property
from pathlib import Path
from typing import IO, Any, ClassVar

import numpy as np

from hfa_support.errors import BadInputError
from hfa_support.files import write_text, written_whole
from hfa_support.reporting.text import Table


def jsonable(value: Any) -> Any:
    """Return a value as objects that `json` can write.

    Mappings, lists, tuples, arrays, texts and numbers are converted. Numbers that are not finite
    become None, because JSON has none.
    """
    if isinstance(value, (float, np.floating)):  # tested first, because most values are floats
        return float(value) if math.isfinite(value) else None
    if isinstance(value, (list, tuple)):
        return [jsonable(item) for item in value]
    if isinstance(value, Mapping):
        return {str(key): jsonable(item) for key, item in value.items()}
    if isinstance(value, np.ndarray):
        values = value.tolist()
        return values if value.dtype == float and np.isfinite(value).all() else jsonable(values)
    return value.item() if isinstance(value, np.generic) else value


def json_text(value: Any) -> str:
    """Return a value as indented JSON text, with each innermost list and object on one line."""
    text = json.dumps(jsonable(value), indent=1, allow_nan=False)
    brackets_without_others = r"[\[{][^][{}]*[]}]"
    on_lines = re.sub(brackets_without_others, lambda part: re.sub(r"\n *", " ", part[0]), text)
    return on_lines + "\n"


_TEXT_END = 116  # bytes of free text at the beginning of a .mat file


def save_data(target: Path, data: Mapping[str, Any], records: Table) -> None:
    """Write one data file, completely or not at all, with numbers in full precision.

    - .json: `data`
    - .npz: one array for each leaf of `data`, whose name is its keys joined by dots
    - .mat: `data` as nested structs, with N matrices as one array (rows, columns, N)
    - .csv: `records`, with a last column that contains schema and provenance as JSON in its first
      row

    Raises BadInputError for any other suffix, and for a .csv of a result without records.
    """
    suffix = target.suffix.lower()
    if suffix == ".json":
        write_text(target, json_text(data))
    elif suffix == ".npz":
        with written_whole(target) as stream:
            np.savez(stream, allow_pickle=False, **_leaves(data))
    elif suffix == ".mat":
        with written_whole(target) as stream:
            stream.write(_mat(data))
    elif suffix == ".csv":
        if not records.header:
            raise BadInputError(
                f"{target}: this result is not a table; use .json, .npz, .mat, .html or .md"
            )
        origin = {name: data[name] for name in ("schema", "provenance") if name in data}
        with written_whole(target) as stream:
            _write_csv(stream, records, json.dumps(jsonable(origin)))
    else:
        raise BadInputError(
            f"{target}: the suffix {suffix!r} is unknown; use .json, .npz, .mat, .csv, .html, "
            ".pdf, .md or .tex"
        )


def _leaves(data: Any, name: str = "") -> dict[str, np.ndarray]:
    """Return name -> array for the leaves of nested mappings and lists of mappings: "modes.0.zeta".

    name: name of `data`, before those of its leaves
    """
    if isinstance(data, list) and data and isinstance(data[0], Mapping):
        data = {str(index): item for index, item in enumerate(data)}
    if not isinstance(data, Mapping):
        return {name: np.asarray(_numbers(data))}
    leaves: dict[str, np.ndarray] = {}
    for key, value in data.items():
        leaves |= _leaves(value, f"{name}.{key}" if name else key)
    return leaves


def _mat(data: Mapping[str, Any]) -> bytes:
    """Return the content of a .mat file."""
    from scipy.io import savemat

    stream = io.BytesIO()
    savemat(stream, _for_matlab(data), long_field_names=True)
    # SciPy would write the time into the free text at the beginning. Equal results must give equal
    # files.
    return b"MATLAB 5.0 MAT-file, written by hfa".ljust(_TEXT_END) + stream.getvalue()[_TEXT_END:]


def _for_matlab(data: Any) -> Any:
    """Return data as SciPy writes them. A mapping becomes a struct, a list of mappings with equal
    keys an array of structs, another list of mappings or texts a cell array, and other lists
    arrays.
    """
    if isinstance(data, Mapping):
        return {_field_name(key): _for_matlab(value) for key, value in data.items()}
    if isinstance(data, list) and data and isinstance(data[0], Mapping):
        names = [*data[0]]
        if names and all([*item] == names for item in data):  # an array of structs
            structs = np.empty(len(data), dtype=[(_field_name(name), object) for name in names])
            structs[:] = [tuple(_for_matlab(value) for value in item.values()) for item in data]
            return structs
    if isinstance(data, list) and data and isinstance(data[0], (Mapping, str)):
        cells = np.empty(len(data), dtype=object)
        cells[:] = [_for_matlab(item) for item in data]
        return cells
    if not isinstance(data, list | np.ndarray):
        return _numbers(data)
    array = np.asarray(_numbers(data))
    # N matrices become an array (rows, columns, N), as MATLAB stores systems.
    return np.moveaxis(array, 0, -1) if array.ndim == 3 else array


def _numbers(data: Any) -> Any:
    """Return nested lists, or a single value, with None replaced by nan."""
    if isinstance(data, list):
        return [_numbers(item) for item in data]
    return np.nan if data is None else data


def _field_name(key: str) -> str:
    """Return the name of a MATLAB struct field for a key, for example "x15_0" for "15.0"."""
    name = re.sub(r"\W", "_", key)
    return name if name[:1].isalpha() else f"x{name}"


def _write_csv(stream: IO[bytes], records: Table, about: str) -> None:
    """Write a table as CSV in UTF-8, row by row.

    about: text in the last column of the first row
    """
    text = io.TextIOWrapper(stream, "utf-8", newline="")
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow((*records.header, "about"))
    for number, row in enumerate(records.rows):
        writer.writerow([*map(_cell, row), about if number == 0 else ""])
    text.detach()


def _cell(cell: Any) -> Any:
    """Return the content of a CSV cell, in which numbers have all digits."""
    if isinstance(cell, (float, np.floating)):
        # The library polars does not parse "nan" as a number.
        return float(cell) if cell == cell else "NaN"
    return _without_formula(cell) if isinstance(cell, str) else cell


def _without_formula(text: str) -> str:
    """Return a text with an apostrophe before it if spreadsheets would read it as a formula."""
    # After a plus or a minus, a digit follows if the text is no formula, such as "-1.5 ± 2i", and
    # after a plus it also ends with one, such as the telephone number "+49 30". A text with a digit
    # calls a function or another program by a bracket, | or !.
    formula = r"[=@\t\r]|\+[^\d.]|\+.*[^\d.]$|-[^\d.]|[-+].*[(|!]"
    return f"'{text}" if re.match(formula, text) else text


#: Arrays with one, two and three axes.
Vector = np.ndarray
Matrix = np.ndarray
Stack = np.ndarray
#: Complex numbers, and complex numbers by rows, stored as (re, im) each.
Roots = np.ndarray
RootTable = np.ndarray
#: A named tuple of numbers, or None.
Record = Any

_SCALARS = {float, int, bool, str, type(None)}


class Result:
    """Base class of dataclasses that are stored as files or as parts of other results.

    schema: name and version of the file format, or "" for a part of other results
    """

    schema: ClassVar[str] = ""

    def _entries(self) -> dict[str, Any]:
        """Return the entries of the file without its schema, name -> value: the fields."""
        # A field whose default is None is left out if it has no value.
        entries: dict[str, Any] = {}
        for field in fields(self):  # type: ignore[arg-type]  # a dataclass
            value = getattr(self, field.name)
            if field.default is None:
                entries |= without_empty(**{field.name: value})
            else:
                entries[field.name] = value
        return entries

    def to_dict(self) -> dict[str, Any]:
        """Return the schema and the contents, with values that JSON can contain."""
        data: dict[str, Any] = jsonable(storable(self))
        return data


class Entries(Mapping[str, Any]):
    """Entries of a file, name -> value in the form that files store (`storable`), computed at the
    first access.

    sources: results, mappings, and functions that return one; the last one with a name counts
    """

    def __init__(self, *sources: Any) -> None:
        self._sources = sources

    @cached_property
    def _stored(self) -> dict[str, Any]:
        """All entries."""
        entries: dict[str, Any] = {}
        for source in self._sources:
            entries |= storable(source() if callable(source) else source)
        return entries

    def __getitem__(self, name: str) -> Any:
        return self._stored[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._stored)

    def __len__(self) -> int:
        return len(self._stored)

    def __repr__(self) -> str:
        return repr(self._stored)


def without_empty(**entries: Any) -> dict[str, Any]:
    """Return the entries that have a value: neither None nor an empty list, tuple or array."""
    return {name: value for name, value in entries.items() if not _is_empty(value)}


def storable(value: Any) -> Any:
    """Return a value in the form that files store. The items of lists and mappings are
    converted.

    - results: dictionaries with their schema
    - named tuples, mappings: dictionaries
    - lists and tuples: lists
    - members of an Enum: their values
    - complex numbers: [re, im]
    - complex arrays: real arrays with a last axis (re, im)
    - real arrays and other values: unchanged, also inf and nan, which JSON files store as null
    """
    if type(value) in _SCALARS:  # tested first: most values are numbers
        return value
    if isinstance(value, Entries):
        return value._stored
    if isinstance(value, Result):
        schema = {"schema": value.schema} if value.schema else {}
        return schema | storable(value._entries())
    if hasattr(type(value), "_asdict"):
        return storable(value._asdict())
    if isinstance(value, Mapping):
        return {name: storable(entry) for name, entry in value.items()}
    if isinstance(value, (list, tuple)):
        return [storable(entry) for entry in value]
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
    return value is None or (isinstance(value, list | tuple) and not value)


class ByValue:
    """Base class of dataclasses (`eq=False`) that are compared by the values of their fields.

    Arrays are compared entry by entry, and nan equals nan. The comparison generated by `dataclass`
    would raise an error for arrays.
    """

    def __eq__(self, other: object) -> bool:
        """Return whether the other object has the same type and equal fields that are compared."""
        if type(other) is not type(self):
            return NotImplemented
        return all(
            _same(getattr(self, field.name), getattr(other, field.name))
            for field in fields(self)  # type: ignore[arg-type]  # a dataclass
            if field.compare
        )


def _same(one: Any, other: Any) -> bool:
    """Return whether two values are equal, arrays entry by entry with nan equal to nan."""
    if not (isinstance(one, np.ndarray) and isinstance(other, np.ndarray)):
        return bool(one == other)
    have_nan = one.dtype.kind in "fc" and other.dtype.kind in "fc"
    return np.array_equal(one, other, equal_nan=have_nan)
