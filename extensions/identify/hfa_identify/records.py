"""Flight records: time, inputs and measured quantities by name, in the model's units."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from hfa_aircraft.model import Model
from hfa_support.arrays.tables import matched, read_columns, refuse_others
from hfa_support.errors import BadInputError

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


def read_record(source: Any, model: Model, held: Mapping[str, float], name: str = "") -> Record:
    """Read a record from a table: a file, or a mapping or data frame of columns.

    Its columns are "time" (s), every input, and at least one state or output, with units or
    without, such as "alpha [deg]" (`read_columns`). Columns without a unit are in the model's
    units, with angles in radians. An empty cell is a missing sample.

    held: input without a column -> its constant value
    name: name of the record in messages, by default that of the file

    Raises BadInputError if the table cannot be read or is not a record of this model.
    """
    units = {"time": "s"} | {
        name: model.unit(name) for name in (*model.inputs, *model.states, *model.outputs)
    }
    columns, others = matched(read_columns(source, name), units)
    refuse_others(others, units)
    name = name or Path(source).name
    if "time" not in columns:
        raise BadInputError(f"{name} has no column time; add the time of each sample, in s")
    arrays = {name: column.numbers(units[name]) for name, column in columns.items()}
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
