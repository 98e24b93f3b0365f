"""Tables: columns with names and units, of files and of data frames, and whose columns they are."""

from __future__ import annotations

import itertools
import math
import re
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from hfa_support.arrays.read import Label, read_arrays
from hfa_support.arrays.text import rows_of_text
from hfa_support.errors import (
    BadInputError,
    file_faults,
    numbers_in,
    prefix_errors,
    shortened,
    shown,
)
from hfa_support.files import regular_file
from hfa_support.units import conversion_factor, si_unit

#: Suffixes of tables as text, and of files that pandas reads: suffix -> its function.
_TEXTS = (".csv", ".txt", ".tsv", ".dat")
_OF_PANDAS = {".parquet": "read_parquet", ".feather": "read_feather", ".xlsx": "read_excel"}
#: Last column of a file of this program: its provenance, in the first row alone.
_PROVENANCE = "about"
#: Entries of a file of arrays that name its signals.
_NAMES = ("states", "inputs", "state_units", "input_units")


class Column(NamedTuple):
    """Column of a table.

    where: the table, for messages
    name: of its heading
    unit: of its heading, "" if it has none. None without one in a dictionary of Python, whose
        numbers are in the unit of the model, with angles in radians
    cells: texts of a file, or numbers
    rows: number of the row of each cell, for messages
    head: number of the row of headings in a file of text, or 0
    """

    where: str
    name: str
    unit: str | None
    cells: Sequence[Any] | np.ndarray
    rows: Sequence[int]
    head: int = 0

    @property
    def heading(self) -> str:
        """The table and the row of the headings, for messages."""
        return f"{self.where}: row {self.head}" if self.head else self.where

    def numbers(self, unit: str = "") -> np.ndarray:
        """Return the cells as numbers (N,) in a unit; nan for an empty cell.

        unit: the unit, or "" if it is unknown: the numbers are in that of the heading, if any

        Raises BadInputError for a text, for a heading whose unit cannot be converted, and for an
        angle without a unit, which could be in degrees or radians.
        """
        if unit.startswith("rad") and self.unit == "":
            degrees = unit.replace("rad", "deg", 1)
            raise BadInputError(
                f"{self.heading}: {self.name} has no unit; write {self.name} [{degrees}] or "
                f"{self.name} [{unit}]"
            )
        factor = conversion_factor(self.unit, unit) if self.unit and unit else 1.0
        if factor is None:
            known = " or ".join(dict.fromkeys((unit, si_unit(unit))))
            raise BadInputError(
                f"{self.heading}: {self.name} is in {shortened(str(self.unit))}; give it in {known}"
            )
        if isinstance(self.cells, np.ndarray):
            with prefix_errors(self.where):
                return factor * np.asarray(numbers_in(self.name, self.cells), dtype=float)
        return factor * np.array([*map(self._number, self.cells, self.rows)], dtype=float)

    def refuse(self, is_wrong: np.ndarray, fault: str) -> None:
        """Raise BadInputError for the first cell that is wrong.

        is_wrong: (N,)
        fault: words that follow the name of the column
        """
        for place in np.flatnonzero(is_wrong).tolist():
            raise BadInputError(f"{self.where}, row {self.rows[place]}: {self.name} {fault}")

    def _number(self, cell: str, row: int) -> float:
        """Return the number in a cell, nan for an empty one."""
        try:
            return float(cell) if cell else math.nan
        except ValueError:
            raise BadInputError(
                f"{self.where}, row {row}: {self.name} is {shown(cell)}; give a number, with a "
                "decimal point, or leave the cell empty"
            ) from None


class Read(NamedTuple):
    """What a source contains: its columns, and the entries of a file of arrays or a mapping."""

    columns: list[Column]
    entries: Mapping[str, Any] = {}


def sources(given: Any, noun: str) -> list[tuple[str, Any]]:
    """Return the name and the source of each of one or several tables: a file, or noun and number.

    given: a source of `read_source`, or a list of them
    """
    listed = [*given] if isinstance(given, (list, tuple)) else [given]
    if not listed:
        raise BadInputError(f"there is no {noun}; give at least one")
    return [
        (str(source) if isinstance(source, (str, Path)) else f"{noun} {number}", source)
        for number, source in enumerate(listed, start=1)
    ]


def read_source(source: Any, name: str = "") -> Read:
    """Return the columns of a table, and the entries of a file of arrays.

    source: file (text with commas, semicolons or tabs; .npz, .mat, .json; by pandas .parquet,
        .feather, .xlsx; by h5py .hdf5), mapping of columns, or data frame of pandas, polars or
        xarray. A heading is "speed [ft/s]" or "speed (ft/s)". The units in a file of arrays can be
        the entries states, state_units, inputs, input_units. A flight, stored or not, has its
        history
    name: name of the table in messages, by default the file

    Raises BadInputError, with the row and the column, for a faulty file.
    """
    is_file = isinstance(source, (str, Path))
    name = name or (str(source) if is_file else "the table")
    if is_file and Path(source).suffix.lower() in _TEXTS:
        with file_faults(source):
            return Read(_columns_of_text(name, regular_file(source).read_bytes()))
    content = _loaded(Path(source)) if is_file else source
    if hasattr(type(content), "history"):  # a flight, not a frame with this column
        content = content.to_dict() | {"history": content.history()}
    if hasattr(content, "data_vars"):  # of xarray
        return Read(_columns_of_arrays(name, {n: content[n].values for n in content.variables}))
    if hasattr(content, "columns"):  # of pandas or polars
        if getattr(getattr(content, "index", None), "name", None):
            content = content.reset_index()
        return Read(_columns_of_arrays(name, {n: content[n].to_numpy() for n in content.columns}))
    if not isinstance(content, Mapping):
        raise BadInputError(
            f"{name} is of type {type(source).__name__}; give a file, a data frame or a dictionary"
        )
    entries = _with_history({str(key): values for key, values in content.items()})
    states, inputs, *units = (np.ravel(entries.get(key, ())).astype(str) for key in _NAMES)
    labels = zip((*states, *inputs), itertools.chain(*units), strict=False)
    unit_of = {str(signal): str(unit) for signal, unit in labels}
    return Read(_columns_of_arrays(name, entries, unit_of, "" if is_file else None), entries)


def _with_history(entries: dict[str, Any]) -> dict[str, Any]:
    """Return entries with a column for each state and input of a flight that `hfa fly` stored."""
    start = "history."
    of_npz = {key.removeprefix(start): entries[key] for key in entries if key.startswith(start)}
    history = entries.get("history", of_npz)
    if not isinstance(history, Mapping) or "times" not in history:
        return entries
    columns = {key: entries[key] for key in _NAMES} | {"time [s]": history["times"]}
    for kind in ("states", "inputs"):
        columns |= zip(map(str, entries[kind]), np.transpose(history[kind]), strict=True)
    return columns


def _columns_of_arrays(
    where: str,
    entries: Mapping[str, Any],
    units: Mapping[str, str] = {},
    no_unit: str | None = "",
) -> list[Column]:
    """Return the columns among arrays: those of more than a number.

    units: name -> unit of headings without one
    no_unit: unit of the others
    """
    columns = []
    for text, values in entries.items():
        label, cells = Label.of(str(text)), np.asarray(getattr(values, "values", values))
        if cells.dtype.kind in "mM":  # dates, or durations
            label, cells = Label(label.name, "s"), (cells - cells[:1]) / np.timedelta64(1, "s")
        if cells.ndim and max(cells.shape) == cells.size and text not in _NAMES:
            unit = label.unit or units.get(label.name) or no_unit
            rows = range(1, cells.size + 1)
            columns.append(Column(where, label.name, unit, np.ravel(cells), rows))
    return columns


def _loaded(path: Path) -> Any:
    """Return the content of a file that is no text: a mapping, or a data frame."""
    suffix = path.suffix.lower()
    if suffix not in (*_OF_PANDAS, ".h5", ".hdf5"):
        return read_arrays(path)
    library = "pandas" if suffix in _OF_PANDAS else "h5py"
    try:
        with file_faults(path):
            file = regular_file(path)
            if suffix in _OF_PANDAS:
                import pandas

                return getattr(pandas, _OF_PANDAS[suffix])(file)
            import h5py

            with h5py.File(file) as stored:
                return _entries_of_group(stored)
    except ImportError as error:
        raise BadInputError(
            f"{path}: {suffix} is read by {library}, where it is installed with what it needs "
            f"({shortened(str(error))}); install it, or save the table as .csv or .npz"
        ) from error


def _entries_of_group(group: Any) -> dict[str, Any]:
    """Return the arrays of a group of an HDF5 file, and its groups as nested mappings."""
    import h5py

    entries: dict[str, Any] = {}
    for name, item in group.items():
        if isinstance(item, h5py.Group):
            entries[name] = _entries_of_group(item)
        else:
            entries[name] = (item.asstr() if h5py.check_string_dtype(item.dtype) else item)[()]
    return entries


def _columns_of_text(where: str, content: bytes) -> list[Column]:
    """Return the columns of a table as text, whose first row has the headings."""
    (head, titles), *rows = rows_of_text(where, content)
    for number, row in rows:
        if len(row) < len(titles) or any(row[len(titles) :]):
            raise BadInputError(
                f"{where}: row {number} has {len(row)} cells, but row {head} has {len(titles)}; "
                "correct the row; if decimals have commas, separate the cells by ;"
            )
    numbers, columns = [number for number, _ in rows], []
    for place, title in enumerate(titles):
        cells = [row[place] for _, row in rows]
        is_count = not title and not place and cells == [*map(str, range(len(cells)))]  # of pandas
        if is_count or title == _PROVENANCE or not (title or any(cells)):
            continue
        if not title:
            raise BadInputError(
                f"{where}: row {head} has no name of column {place + 1}; name it, or remove it"
            )
        columns.append(Column(where, *Label.of(title), cells, numbers, head))
    return columns


#: Other names of the time.
_TIMES = ("t", "timestamp", "seconds")


def matched(columns: Iterable[Column], known: Mapping[str, str]) -> dict[str, Column]:
    """Return the columns in their order, by the names that are known, and the others by their own.

    A name is matched by its letters, else in small letters without points and blanks: "C.G." is cg.

    known: name -> unit, or "" for any

    Raises BadInputError for two columns of one name, and for a unit in a name: "time_ms".
    """
    found: dict[str, Column] = {}
    for column in columns:
        plain = re.sub(r"\W+", "_", column.name.replace(".", "")).lower()
        plain = "time" if plain in _TIMES else plain
        name = plain if plain in known and column.name not in known else column.name
        signal, _, unit = column.name.rpartition("_")
        if name not in known and conversion_factor(unit, known.get(signal.lower()) or "?"):
            raise BadInputError(
                f'{column.heading}: unknown column {shown(name)}; write "{signal.lower()} [{unit}]"'
            )
        if name in found:
            raise BadInputError(f"{column.heading} has {name} twice; rename or remove one column")
        found[name] = column
    return found
