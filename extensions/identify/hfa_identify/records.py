"""Flight records: time, inputs and measured quantities by name, in the model's units."""

from __future__ import annotations

import csv
import io
import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from hfa_aircraft.model import Model
from hfa_aircraft.signals import Signal
from hfa_identify.jsbsim_log import TIME, log_columns
from hfa_support.arrays.read import read_arrays
from hfa_support.errors import BadInputError, refuse_unknown, shortened, shown
from hfa_support.files import regular_file
from hfa_support.units import conversion, si_unit

#: Least number of samples in a record.
FEWEST = 10
#: A sensor that repeats values in less than the fraction _SELDOM of its samples is frozen if it
#: repeats a value more than _FROZEN times in succession.
_SELDOM = 0.01
_FROZEN = 4
#: Least number of samples on an extreme value of a clipped sensor, as a number and as a fraction,
#: and ratio to the number on the next value.
_CLIPPED = 5
_CLIPPED_PART = 0.02
_MORE_OFTEN = 5
#: A value is in a wrong unit if its distance from the middle of the limits exceeds this many
#: half-ranges.
_FAR = 4.0


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

    def windows(self, seconds: float) -> list[Record]:
        """Return consecutive parts of the record that share their end samples.

        seconds: duration of a part, s. A part has at least `FEWEST` samples, and the last may be
            longer.
        """
        step = (self.time[-1] - self.time[0]) / (len(self.time) - 1)
        samples = max(FEWEST, round(seconds / step))
        starts = range(0, max(1, len(self.time) - samples), samples)
        ends = [*list(starts)[1:], len(self.time) - 1]
        return [self.part(first, last + 1) for first, last in zip(starts, ends, strict=True)]

    def thinned(self, together: int) -> Record:
        """Return a record with one sample for each group of `together` samples.

        A sample has the time and inputs at the start of its group, and the first value of each
        sensor in the group.
        """
        if together == 1:
            return self
        starts = np.arange(0, len(self.time), together)
        measured = {}
        for name, values in self.measured.items():
            missing = -len(values) % together
            blocks = np.append(values, np.full(missing, np.nan)).reshape(-1, together)
            first = np.isfinite(blocks).argmax(axis=1)
            measured[name] = blocks[np.arange(len(blocks)), first]
        return replace(self, time=self.time[starts], inputs=self.inputs[starts], measured=measured)

    def part(self, first: int, stop: int) -> Record:
        """Return the record of the samples `first` to `stop` - 1."""
        rows = slice(first, stop)
        measured = {name: values[rows] for name, values in self.measured.items()}
        return replace(self, time=self.time[rows], inputs=self.inputs[rows], measured=measured)


def columns_of(model: Model, record: Record) -> dict[str, np.ndarray]:
    """Return the time, the inputs and the measured quantities of a record by name, (N,) each."""
    inputs = dict(zip(model.inputs, record.inputs.T, strict=True))
    return {"time": record.time, **inputs, **record.measured}


def _stacked(time: np.ndarray, columns: Sequence[np.ndarray]) -> np.ndarray:
    """Return the columns side by side, (N, m). Without columns, the shape is (N, 0)."""
    return np.column_stack([np.empty((len(time), 0)), *columns])


def record_of(
    model: Model, columns: Mapping[str, Any], held: Mapping[str, float], name: str = "record"
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
    missing = [each for each in model.inputs if each not in arrays and each not in held]
    if missing:
        raise BadInputError(
            f"{name} has no column {missing[0]}; add the column, or give a constant (--hold"
            f" {missing[0]}=VALUE, or in Python hold={{{missing[0]!r}: VALUE}})"
        )
    inputs = [arrays.pop(each, np.full(len(time), held.get(each))) for each in model.inputs]
    _check_inputs(name, list(model.inputs), inputs)
    if not arrays:
        raise BadInputError(
            f"{name} has no column of a measured state or output; add a column such as "
            f"{next(iter(model.states))}"
        )
    for each, values in arrays.items():
        others = [column for other, column in arrays.items() if other != each]
        _check_measured(name, each, values, [*inputs, *others])
    for each, values in (*zip(model.inputs, inputs, strict=True), *arrays.items()):
        _check_size(model, name, each, values)
    return Record(name, time, _stacked(time, inputs), arrays)


def read_record(path: str | Path, model: Model, held: Mapping[str, float]) -> Record:
    """Read a record from a CSV, .npz or .mat file.

    The first row of a CSV file contains names with or without units, such as "alpha [deg]". Cells
    are separated by commas, tabs or semicolons; with semicolons, the decimal may be a comma. An
    empty cell is a missing sample. A CSV log of JSBSim begins with the column Time, and its columns
    that the model lacks are left out. Columns without a unit are in the model's units, with angles
    in radians.

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
        separator = next((each for each in "\t;" if each in head), ",")
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
    if rows[0][0].strip() == TIME:
        return _of_log(path, rows, model)
    heads = [_head(path, cell, model) for cell in rows[0]]
    names = [name for name, _ in heads]
    if len(set(names)) < len(names):
        repeated = next(name for name in names if names.count(name) > 1)
        raise BadInputError(
            f"{path}: two columns are named {repeated}; rename or remove one column"
        )
    table = _table(path, rows, names)
    factors = [factor for _, factor in heads]
    return {name: table[:, place] * factors[place] for place, name in enumerate(names)}


def _of_log(path: Path, rows: list[list[str]], model: Model) -> dict[str, np.ndarray]:
    """Return the columns of a CSV log of JSBSim by name, without those that the model lacks."""
    # Without noise, a state that does not move is no frozen sensor, and is left out.
    table = _table(path, rows, rows[0])
    found = {}
    for column, values in zip(log_columns(rows[0], model), table.T, strict=True):
        if column is not None and (column[0] in model.inputs or np.ptp(values) > 0.0):
            name, factor = column
            is_angle = name != "time" and model.unit(name) == "rad"
            found[name] = np.unwrap(factor * values) if is_angle else factor * values
    return found


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
        column, factor = _head(name, cell, model)
        columns[column] = factor * _numbers(name, column, table[cell])
    return columns


def _head(path: str | Path, cell: str, model: Model) -> tuple[str, float]:
    """Return the name of a column and the factor that converts its values to the model's unit."""
    match = re.fullmatch(r"\s*(\w+)\s*(?:[\[(]\s*([^\])]*?)\s*[\])])?\s*", cell)
    if match is None:
        raise BadInputError(
            f"{path}: {shown(cell)} in the first row is not a column name; write names with or"
            ' without units, such as "alpha [deg]"'
        )
    name, stated = match[1], match[2]
    known = ("time", *model.inputs, *model.states, *model.outputs)
    whole, _, unit = name.rpartition("_")
    if name not in known and whole in known and conversion(unit, _unit_of(model, whole)):
        raise BadInputError(f'{path}: unknown column {shown(name)}; write "{whole} [{unit}]"')
    refuse_unknown(f"{path}: unknown column", name, known)
    unit = _unit_of(model, name)
    if not stated:
        return name, 1.0
    factor = conversion(stated, unit)
    if factor is None:
        known_units = " or ".join(dict.fromkeys((unit, si_unit(unit))))
        raise BadInputError(
            f"{path}: {name} is in {shortened(stated)}; give {name} in {known_units}"
        )
    return name, factor


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
    for each, values in zip(names, inputs, strict=True):
        gaps = np.flatnonzero(~np.isfinite(values))
        if len(gaps):
            raise BadInputError(
                f"{name}: the input {each} has no value at sample {gaps[0] + 1}; give a value"
                " at every sample"
            )


def _check_measured(
    name: str, column: str, values: np.ndarray, others: Sequence[np.ndarray]
) -> None:
    """Raise BadInputError if a sensor is infinite, has too few values, is clipped, or is frozen."""
    # A sensor is frozen if all its values are equal, or if it repeats a value many times while
    # another column moves.
    if np.isinf(values).any():
        raise BadInputError(
            f"{name}: {column} contains infinite values; leave the cells of these samples empty"
        )
    seen = values[np.isfinite(values)]
    if len(seen) < FEWEST:
        raise BadInputError(
            f"{name}: {column} has {len(seen)} finite values; give at least {FEWEST}, or remove "
            "the column"
        )
    if np.ptp(seen) == 0.0:
        raise BadInputError(
            f"{name}: {column} is {seen[0]:g} at every sample, as from a frozen sensor; remove "
            "the column"
        )
    _check_clipped(name, column, seen)
    first, last = _longest_repeat(seen)
    places = np.flatnonzero(np.isfinite(values))[[first, last]]
    if not any(np.ptp(_finite(other[places[0] : places[1] + 1])) > 0.0 for other in others):
        return
    longest = last - first + 1
    repeated = int((np.diff(seen) == 0.0).sum())
    # A sensor with coarse resolution repeats many values. One with fine resolution does so only if
    # it is frozen.
    is_fine = repeated - (longest - 1) <= _SELDOM * len(seen)
    if longest > (_FROZEN if is_fine else max(FEWEST, len(seen) // 5)):
        raise BadInputError(
            f"{name}: {column} repeats one value {longest} times, as from a frozen sensor; leave "
            "the cells of these samples empty"
        )


def _check_clipped(name: str, column: str, values: np.ndarray) -> None:
    """Raise BadInputError if many samples of a sensor are on one of its extreme values."""
    # The sensor may rest on a value at both ends of the record. A sensor of coarse resolution is
    # clipped only if many samples are on both extreme values: it may hold one of them.
    edges = np.flatnonzero(np.diff(values) != 0.0)
    inside = values[edges[0] + 1 : edges[-1] + 1]
    if len(inside) == 0:
        return
    levels, counts = np.unique(inside, return_counts=True)
    if len(levels) < 2 * _MORE_OFTEN:
        return
    least = max(_CLIPPED, _CLIPPED_PART * len(values))
    clipped = {
        float(levels[end]): int(counts[end])
        for end, beside in ((0, 1), (-1, -2))
        if counts[end] >= max(least, _MORE_OFTEN * counts[beside])
    }
    is_fine = counts[1:-1].mean() < 1.0 + _SELDOM
    if len(clipped) == 2 or (clipped and is_fine):
        limits = " or ".join(f"{level:.6g}" for level in clipped)
        raise BadInputError(
            f"{name}: {column} is clipped: {sum(clipped.values())} of {len(values)} samples are at "
            f"{limits}; leave the cells of these samples empty"
        )


def _check_size(model: Model, name: str, column: str, values: np.ndarray) -> None:
    """Raise BadInputError if a column is far beyond the limits of the model."""
    signal = model.signals[column]
    far = _far_beyond(signal, values)
    if far.any():
        unit = signal.unit
        advice = (
            ("; if the column is in degrees, add [deg] to the name of the column")
            if unit == "rad"
            else ""
        )
        raise BadInputError(
            f"{name}: {column} reaches {values[far][0]:g} {unit}, far beyond the model's limits "
            f"{signal.min:g} to {signal.max:g}{advice or '; check the unit'}"
        )


def _far_beyond(signal: Signal, values: np.ndarray) -> np.ndarray:
    """Return a mask (N,) of values so far beyond a signal's limits that the unit is wrong."""
    half = 0.5 * (signal.max - signal.min)
    middle = 0.5 * (signal.max + signal.min)
    if not 0.0 < half < math.inf:
        return np.zeros(len(values), dtype=bool)
    return np.asarray(np.abs(values - middle) > _FAR * half)


def _longest_repeat(values: np.ndarray) -> tuple[int, int]:
    """Return the first and last index of the longest sequence of equal values in a column."""
    changes = np.flatnonzero(np.diff(values) != 0.0)
    edges = np.concatenate([[-1], changes, [len(values) - 1]])
    longest = int(np.diff(edges).argmax())
    return int(edges[longest]) + 1, int(edges[longest + 1])


def _finite(values: np.ndarray) -> np.ndarray:
    """Return the finite values of a column, or a single 0 if it has none."""
    seen = values[np.isfinite(values)]
    return seen if len(seen) else np.zeros(1)
