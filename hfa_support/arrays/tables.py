"""Tables: columns with names and units, of files and of data frames, and whose columns they are."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping, Sequence
from operator import itemgetter
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from hfa_support.arrays.read import Label, read_arrays
from hfa_support.arrays.text import DECIMAL_COMMA, rows_of_text
from hfa_support.errors import (
    BadInputError,
    choice_of,
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


class Column(NamedTuple):
    """Column of a table.

    where: the table, for messages
    name, unit: of its heading; the unit is "" if the heading has none
    cells: texts of a file, or numbers
    rows: number of the row of each cell, for messages
    head: number of the row of headings in a file of text, or 0
    """

    where: str
    name: str
    unit: str
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

        Raises BadInputError for a text, and for a heading whose unit cannot be converted.
        """
        factor = conversion_factor(self.unit, unit) if self.unit and unit else 1.0
        if factor is None:
            known = " or ".join(dict.fromkeys((unit, si_unit(unit))))
            raise BadInputError(
                f"{self.heading}: {self.name} is in {shortened(self.unit)}; give it in {known}"
            )
        if isinstance(self.cells, np.ndarray):
            with prefix_errors(self.where):
                return factor * np.asarray(numbers_in(self.name, self.cells), dtype=float)
        return factor * np.array([*map(self._number, self.cells, self.rows)], dtype=float)

    @property
    def is_numeric(self) -> bool:
        """Whether the first cell is a number, or empty."""
        try:
            float(next(iter(self.cells), None) or 0.0)
        except ValueError:
            return False
        return True

    def _number(self, cell: str, row: int) -> float:
        """Return the number in a cell, nan for an empty one."""
        try:
            return float(cell) if cell else math.nan
        except ValueError:
            advice = "give a number or leave the cell empty"
            if DECIMAL_COMMA.fullmatch(cell):
                advice = "give a decimal point, or separate cells by ;"
            elif row == self.rows[0]:
                advice += ' (units follow names, as in "alpha [deg]")'
            text = f"{self.where}, row {row}: {self.name} is {shown(cell)}; {advice}"
            raise BadInputError(text) from None


def read_columns(source: Any, name: str = "", until: str = "") -> list[Column]:
    """Return the columns of a table.

    source: file (text with commas, semicolons or tabs, .npz, .mat, .json, and with pandas .parquet,
        .feather, .xlsx, with h5py .hdf5), mapping of columns, or data frame of pandas, polars or
        xarray. A heading is "speed [ft/s]" or "speed (ft/s)"
    name: name of the table in messages, by default the file
    until: heading of the first column that is not read, or ""

    Raises BadInputError, with the row and the column, for a faulty file.
    """
    name = name or (str(source) if isinstance(source, (str, Path)) else "the table")
    if is_text(source):
        with file_faults(source):
            return _columns_of_text(name, regular_file(source).read_bytes(), until)
    return columns_of_entries(entries_of(source, name), name)


def is_text(source: Any) -> bool:
    """Return whether a source of a table is a file of text."""
    return isinstance(source, (str, Path)) and Path(source).suffix.lower() in _TEXTS


def are_true(cells: Iterable[Any]) -> np.ndarray:
    """Return whether each cell is true: a number other than 0, or the word true, (N,)."""
    words = (str(cell).strip().lower() for cell in cells)
    return np.array([word not in ("false", "0", "0.0", "") for word in words])


def columns_of_entries(entries: Mapping[str, Any], name: str) -> list[Column]:
    """Return the columns among the entries of a file or mapping: those of more than a number."""
    columns = []
    for text, values in entries.items():
        label, cells = Label.of(text), np.asarray(getattr(values, "values", values))
        if cells.dtype.kind in "mM":  # dates, or durations
            seconds = (cells - cells[:1]) / np.timedelta64(1, "s")
            label, cells = Label(label.name, "s"), seconds
        if cells.ndim and max(cells.shape) == cells.size:
            flat = np.ravel(cells)
            columns.append(Column(name, *label, flat, range(1, len(flat) + 1)))
    return columns


def entries_of(source: Any, where: str = "the table") -> dict[str, Any]:
    """Return the entries of a file of arrays, a mapping or a data frame, name -> values.

    A stored flight has its history: time, states and inputs.

    where: the table, for messages
    """
    if isinstance(source, (str, Path)):
        source = _loaded(Path(source))
    if hasattr(source, "data_vars"):  # of xarray
        return {str(name): source[name].values for name in source.variables}
    if not isinstance(source, Mapping) and hasattr(source, "columns"):
        if getattr(getattr(source, "index", None), "name", None):  # of pandas
            source = source.reset_index()
        return {str(name): source[name].to_numpy() for name in source.columns}
    if not isinstance(source, Mapping):
        raise BadInputError(
            f"{where} is of type {type(source).__name__}; give a file, a data frame or a dictionary"
        )
    beginning = "history."
    of_history = {key[len(beginning) :]: source[key] for key in source if key.startswith(beginning)}
    history = source.get("history", of_history)
    if not isinstance(history, Mapping) or "times" not in history:
        return {str(name): values for name, values in source.items()}
    entries = {"time [s]": history["times"]}
    for kind in ("state", "input"):
        labels = zip(source[f"{kind}s"], source[f"{kind}_units"], strict=True)
        values = np.asarray(history[f"{kind}s"]).T
        entries |= {f"{n} [{unit}]": row for (n, unit), row in zip(labels, values, strict=True)}
    return entries


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
    return {
        name: item[()] if hasattr(item, "shape") else _entries_of_group(item)
        for name, item in group.items()
    }


def _columns_of_text(where: str, content: bytes, until: str) -> list[Column]:
    """Return the columns of a table as text, whose first row has the headings."""
    (head, titles), *rows = rows_of_text(where, content)
    end = titles.index(until) if until and until in titles else len(titles)
    for number, row in rows:
        if len(row) < end:
            raise BadInputError(
                f"{where}: row {number} has {len(row)} cells, but row {head} has {len(titles)}; "
                "correct the row"
            )
    numbers, columns = [number for number, _ in rows], []
    for place in range(max(map(len, [titles, *(row for _, row in rows)]))):
        if end <= place < len(titles):
            continue  # a column that is not read
        title = titles[place] if place < end else ""
        cells = [row[place] if place < len(row) else "" for _, row in rows]
        is_count = not title and not place and cells == [*map(str, range(len(cells)))]  # of pandas
        if not (title or any(cells)) or is_count or title == _PROVENANCE:
            continue
        if not title:
            number, cell = next(filter(itemgetter(1), zip(numbers, cells, strict=True)))
            raise BadInputError(
                f"{where}: row {number}, column {place + 1} has {shown(cell)}, but row {head} has "
                "no name there; name the column, or clear the cell; if decimals have commas, "
                "separate the cells by ;"
            )
        columns.append(Column(where, *Label.of(title), cells, numbers, head))
    return columns


#: Other names of the time.
_TIMES = ("t", "timestamp", "seconds")


def matched(
    columns: Iterable[Column], known: Mapping[str, str]
) -> tuple[dict[str, Column], list[Column]]:
    """Return name -> column of the known names, and the other columns.

    A name is matched by its letters, else in small letters without points and blanks: "C.G." is cg.

    known: name -> unit, or "" for any

    Raises BadInputError for two columns of one name, and for a unit in a name: "time_ms".
    """
    found: dict[str, Column] = {}
    others = []
    for column in columns:
        plain = re.sub(r"\W+", "_", column.name.replace(".", "")).lower()
        plain = "time" if plain in _TIMES else plain
        name = column.name if column.name in known else plain
        if name not in known:
            signal, _, unit = column.name.rpartition("_")
            signal = signal.lower()
            if known.get(signal) and conversion_factor(unit, known[signal]):
                raise BadInputError(
                    f'{column.heading}: unknown column {shown(column.name)}; write "{signal} '
                    f'[{unit}]"'
                )
            others.append(column)
        elif name in found:
            raise BadInputError(f"{column.heading} has {name} twice; rename or remove one column")
        else:
            found[name] = column
    return found, others


def refuse_others(others: Iterable[Column], known: Iterable[str]) -> None:
    """Raise BadInputError for the first of columns whose names are not known."""
    for column in others:
        advice = choice_of(column.name, known)
        raise BadInputError(f"{column.heading}: unknown column {shown(column.name)}; {advice}")
