"""Tables: columns with names and units, of files and of data frames, and whose columns they are."""

from __future__ import annotations

import itertools
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from hfa_support.arrays.columns import Column, Label, columns_of_text
from hfa_support.arrays.read import read_arrays
from hfa_support.errors import BadInputError, file_faults, shortened
from hfa_support.files import regular_file

#: Suffixes of tables as text, and of files that pandas reads: suffix -> its function.
_TEXTS = (".csv", ".txt", ".tsv", ".dat")
_OF_PANDAS = {".parquet": "read_parquet", ".feather": "read_feather", ".xlsx": "read_excel"}
#: Entries of a file of arrays that name its signals.
_NAMES = ("states", "inputs", "state_units", "input_units")


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
        .feather, .xlsx), mapping of columns, or data frame of pandas or polars. A heading is
        "speed [ft/s]" or "speed (ft/s)". The units in a file of arrays can be the entries states,
        state_units, inputs, input_units. A flight, stored or not, has its history
    name: name of the table in messages, by default the file

    Raises BadInputError, with the row and the column, for a faulty file.
    """
    is_file = isinstance(source, (str, Path))
    name = name or (str(source) if is_file else "the table")
    if is_file and Path(source).suffix.lower() in _TEXTS:
        with file_faults(source):
            return Read(columns_of_text(name, regular_file(source).read_bytes()))
    content = _loaded(Path(source)) if is_file else source
    if hasattr(type(content), "history"):  # a flight, not a frame with this column
        content = content.to_dict() | {"history": content.history()}
    if hasattr(content, "columns"):  # of pandas or polars
        if getattr(getattr(content, "index", None), "name", None):
            content = content.reset_index()
        content = {name: content[name] for name in content.columns}
    if not isinstance(content, Mapping):
        raise BadInputError(
            f"{name} is of type {type(source).__name__}; give a file, a data frame or a dictionary"
        )
    entries = _with_history({str(key): values for key, values in content.items()})
    no_unit = None if isinstance(source, Mapping) else ""
    return Read(_columns_of_arrays(name, entries, no_unit), entries)


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


def _columns_of_arrays(where: str, entries: Mapping[str, Any], no_unit: str | None) -> list[Column]:
    """Return the columns among arrays: those of more than a number.

    no_unit: unit of signals without one in their heading or in the entries `_NAMES`
    """
    states, inputs, *units = (np.ravel(entries.get(key, ())).astype(str) for key in _NAMES)
    labels = zip((*states, *inputs), itertools.chain(*units), strict=False)
    unit_of = {str(signal): str(unit) for signal, unit in labels}
    columns = []
    for text, values in entries.items():
        label = Label.of(text)
        try:
            cells = np.asarray(getattr(values, "values", values))
        except ValueError as error:
            raise BadInputError(
                f"{where}: {text} does not consist of rows of equal length"
            ) from error
        if cells.dtype.kind in "mM":  # dates, or durations
            label, cells = Label(label.name, "s"), (cells - cells[:1]) / np.timedelta64(1, "s")
        if cells.ndim and max(cells.shape) == cells.size and text not in _NAMES:
            unit = label.unit or unit_of.get(label.name) or no_unit
            rows = range(1, cells.size + 1)
            columns.append(Column(where, label.name, unit, np.ravel(cells), rows))
    return columns


def _loaded(path: Path) -> Any:
    """Return the content of a file that is no text: a mapping, or a data frame."""
    suffix = path.suffix.lower()
    if suffix not in _OF_PANDAS:
        return read_arrays(path)
    try:
        with file_faults(path):
            import pandas

            return getattr(pandas, _OF_PANDAS[suffix])(regular_file(path))
    except ImportError as error:
        raise BadInputError(
            f"{path}: {suffix} is read by pandas, where it is installed with what it needs "
            f"({shortened(str(error))}); install it, or save the table as .csv or .npz"
        ) from error
