"""Flight records: time, inputs and measured quantities by name, in the model's units."""

from __future__ import annotations

import csv
import io
import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from hfa_aircraft.model import Model
from hfa_support.arrays.read import read_arrays
from hfa_support.errors import BadInputError, refuse_unknown, shortened, shown
from hfa_support.files import regular_file
from hfa_support.units import conversion_factor, si_unit

#: Least number of samples in a record.
FEWEST = 10


@dataclass(frozen=True, eq=False)
class Record:
    """Flight record of one maneuver.

    name: name of the record, such as its file name.
    time: increasing times, not necessarily equidistant, s, (N,).
    inputs: (N, m) in the order and units of the model's inputs.
    measured: state or output -> (N,) in the model's unit, NaN for a missing sample.
    has_steps: whether each input is constant until the next sample, as commands of a flight
        computer are. Otherwise inputs are linear between samples.
    """

    name: str
    time: np.ndarray
    inputs: np.ndarray
    measured: Mapping[str, np.ndarray]
    has_steps: bool = False

    def table(self, names: Sequence[str]) -> np.ndarray:
        """Return the samples of some measured quantities, (N, k), NaN for a missing sample.

        names: the quantities
        """
        none = np.full(len(self.time), np.nan)
        return np.column_stack([self.measured.get(name, none) for name in names])


def _stacked(time: np.ndarray, columns: Sequence[np.ndarray]) -> np.ndarray:
    """Return the columns side by side, (N, m). Without columns, the shape is (N, 0)."""
    return np.column_stack([np.empty((len(time), 0)), *columns])


def record_of(
    model: Model, columns: Mapping[str, Any], held: Mapping[str, float], name: str
) -> Record:
    """Return a record made of arrays in the model's units.

    columns: name -> (N,): "time" (s), every input, and at least one state or output
    held: input without a column -> its constant value
    name: name of the record in messages

    Raises BadInputError for an unknown, missing or faulty column.
    """
    for column in columns:
        known = ("time", *model.inputs, *model.states, *model.outputs)
        refuse_unknown(f"{name}: unknown column", column, known)
    if "time" not in columns:
        raise BadInputError(f"{name} has no column time; add the time of each sample, in s")
    arrays = {column: _numbers(name, column, values) for column, values in columns.items()}
    time = arrays.pop("time")
    _check_time(name, time)
    for column, values in arrays.items():
        if len(values) != len(time):
            raise BadInputError(
                f"{name}: {column} has {len(values)} samples, but time has {len(time)}; "
                "give columns of equal length"
            )
    missing = [
        input_name
        for input_name in model.inputs
        if input_name not in arrays and input_name not in held
    ]
    if missing:
        raise BadInputError(
            f"{name} has no column {missing[0]}; add the column, or give a constant (--hold"
            f" {missing[0]}=VALUE, or in Python hold={{{missing[0]!r}: VALUE}})"
        )
    inputs = [
        arrays.pop(input_name, np.full(len(time), held.get(input_name)))
        for input_name in model.inputs
    ]
    _check_inputs(name, list(model.inputs), inputs)
    if not arrays:
        raise BadInputError(
            f"{name} has no column of a measured state or output; add a column such as "
            f"{next(iter(model.states))}"
        )
    for measured, values in arrays.items():
        _check_measured(name, measured, values)
    return Record(name, time, _stacked(time, inputs), arrays)


def read_record(path: str | Path, model: Model, held: Mapping[str, float]) -> Record:
    """Read a record from a CSV, .npz or .mat file.

    The first row of a CSV file contains names with or without units, such as "alpha [deg]". Cells
    are separated by commas, tabs or semicolons; with semicolons, the decimal may be a comma. An
    empty cell is a missing sample. Columns without a unit are in the model's units, with angles in
    radians.

    held: input without a column -> its constant value

    Raises BadInputError if the file cannot be read or is not a record of this model.
    """
    try:
        file = regular_file(path)
        if file.suffix == ".csv":
            columns = _csv_columns(file, model)
        else:
            arrays = read_arrays(file)
            columns = {name: np.ravel(values) for name, values in arrays.items()}
    except OSError as error:
        raise BadInputError(
            f"{path} cannot be read ({error.strerror}); give a readable file"
        ) from error
    return record_of(model, columns, held, Path(path).name)


def _csv_columns(path: Path, model: Model) -> dict[str, np.ndarray]:
    """Return the columns of a CSV file by name, in the model's units, (N,) each."""
    try:
        text = path.read_text("utf-8-sig")
        head = text.lstrip().partition("\n")[0]
        separator = next((mark for mark in "\t;" if mark in head), ",")
        if separator == ";":
            text = _with_decimal_points(path, text)
        rows = list(csv.reader(io.StringIO(text), delimiter=separator))
    except (UnicodeDecodeError, csv.Error) as error:
        raise BadInputError(
            f"{path} cannot be read as CSV ({error}); save the record as CSV in UTF-8"
        ) from error
    rows = [row for row in rows if any(cell.strip() for cell in row)]
    if not rows:
        raise BadInputError(f"{path} is empty; give a row of names, then rows of samples")
    if rows[0][-1] == "about":  # the provenance in a file of `hfa fly`
        rows = [row[:-1] for row in rows]
    heads = [_head(path, cell, model) for cell in rows[0]]
    names = [head.name for head in heads]
    if len(set(names)) < len(names):
        repeated = next(name for name in names if names.count(name) > 1)
        raise BadInputError(
            f"{path}: two columns are named {repeated}; rename or remove one column"
        )
    table = _table(path, rows, names)
    return {head.name: head.factor * column for head, column in zip(heads, table.T, strict=True)}


def _table(path: Path, rows: list[list[str]], names: Sequence[str]) -> np.ndarray:
    """Return the numbers below the first row of a CSV file, (N, columns)."""
    table = np.empty((len(rows) - 1, len(names)))
    for number, row in enumerate(rows[1:], start=2):
        if len(row) != len(names):
            raise BadInputError(
                f"{path}, row {number} has {len(row)} cells, but the first row has"
                f" {len(names)}; give one cell for each column, and separate cells by ; if the"
                " decimal is a comma"
            )
        table[number - 2] = [
            _cell(path, number, name, cell) for name, cell in zip(names, row, strict=True)
        ]
    return table


def _with_decimal_points(path: Path, text: str) -> str:
    """Return the text of a file with semicolons, with points in place of decimal commas."""
    head, _, samples = text.partition("\n")
    if "," in samples and "." in samples:
        raise BadInputError(
            f"{path} contains decimal commas and points, one of which may separate thousands; give "
            "one of them, as the decimal"
        )
    return f"{head}\n{samples.replace(',', '.')}"


def columns_of_table(table: Any, model: Model, name: str) -> dict[str, np.ndarray]:
    """Return the columns of a pandas table by name, in the model's units, (N,) each.

    Column names may include a unit as in a CSV file.

    name: name of the record in messages

    Raises BadInputError if a name or unit is unknown, or a value is not a number.
    """
    columns = {}
    for cell in map(str, table.columns):
        head = _head(name, cell, model)
        columns[head.name] = head.factor * _numbers(name, head.name, table[cell])
    return columns


class _Head(NamedTuple):
    """Name of a column, and the factor that converts its values to the model's unit."""

    name: str
    factor: float


def _head(path: str | Path, cell: str, model: Model) -> _Head:
    """Return what a cell of the first row states, such as "alpha [deg]"."""
    match = re.fullmatch(r"\s*(\w+)\s*(?:[\[(]\s*([^\])]*?)\s*[\])])?\s*", cell)
    if match is None:
        raise BadInputError(
            f"{path}: {shown(cell)} in the first row is not a column name; write names with or"
            ' without units, such as "alpha [deg]"'
        )
    name, stated_unit = match[1], match[2]
    known = ("time", *model.inputs, *model.states, *model.outputs)
    signal, _, unit = name.rpartition("_")  # alpha_deg
    if name not in known and signal in known and conversion_factor(unit, _unit_of(model, signal)):
        raise BadInputError(f'{path}: unknown column {shown(name)}; write "{signal} [{unit}]"')
    refuse_unknown(f"{path}: unknown column", name, known)
    unit = _unit_of(model, name)
    if not stated_unit:
        return _Head(name, 1.0)
    factor = conversion_factor(stated_unit, unit)
    if factor is None:
        known_units = " or ".join(dict.fromkeys((unit, si_unit(unit))))
        raise BadInputError(
            f"{path}: {name} is in {shortened(stated_unit)}; give {name} in {known_units}"
        )
    return _Head(name, factor)


def _unit_of(model: Model, column: str) -> str:
    """Return the unit of a column in the model."""
    return "s" if column == "time" else model.unit(column)


def _cell(path: Path, number: int, name: str, cell: str) -> float:
    """Return the number in a cell, NaN for an empty cell. Raises BadInputError for other text."""
    if not cell.strip():
        return math.nan
    try:
        return float(cell)
    except ValueError:
        advice = "give a number or leave the cell empty"
        if "," in cell:
            advice = "give a decimal point, or separate cells by ;"
        elif number == 2:
            advice += ' (units follow names, as in "alpha [deg]")'
        raise BadInputError(f"{path}, row {number}: {name} is {shown(cell)}; {advice}") from None


def _numbers(record: str, name: str, values: Any) -> np.ndarray:
    """Return a column as an array (N,). Raises BadInputError if it is not a sequence of numbers."""
    try:
        column = np.asarray(values, dtype=float)
    except (TypeError, ValueError):
        raise BadInputError(f"{record}: {name} is {shown(values)}; give numbers") from None
    if column.ndim != 1:
        raise BadInputError(f"{record}: {name} has {column.ndim} dimensions; give one column")
    return column


def _check_time(name: str, time: np.ndarray) -> None:
    """Raise BadInputError unless there are `FEWEST` times or more, all finite and increasing."""
    if len(time) < FEWEST:
        raise BadInputError(f"{name} has {len(time)} samples; give at least {FEWEST}")
    if not np.isfinite(time).all():
        first = int(np.flatnonzero(~np.isfinite(time))[0])
        raise BadInputError(f"{name}: sample {first + 1} has no time; remove this row")
    late = np.flatnonzero(np.diff(time) <= 0.0)
    if len(late):
        raise BadInputError(
            f"{name}: time does not increase at sample {late[0] + 2} ({time[late[0] + 1]:g} s); "
            "sort the record and remove repeated rows"
        )


def _check_inputs(name: str, names: Sequence[str], inputs: Sequence[np.ndarray]) -> None:
    """Raise BadInputError if a sample of an input is missing."""
    for input_name, values in zip(names, inputs, strict=True):
        gaps = np.flatnonzero(~np.isfinite(values))
        if len(gaps):
            raise BadInputError(
                f"{name}: the input {input_name} has no value at sample {gaps[0] + 1}; give a value"
                " at every sample"
            )


def _check_measured(name: str, column: str, values: np.ndarray) -> None:
    """Raise BadInputError if a measured quantity is infinite or has too few values."""
    if np.isinf(values).any():
        raise BadInputError(
            f"{name}: {column} contains infinite values; leave the cells of these samples empty"
        )
    seen = int(np.isfinite(values).sum())
    if seen < FEWEST:
        raise BadInputError(
            f"{name}: {column} has {seen} finite values; give at least {FEWEST}, or remove "
            "the column"
        )
