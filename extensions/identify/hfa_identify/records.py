"""Flight records: time, inputs and measured quantities by name, in the model's units."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from hfa_aircraft.model import Model
from hfa_support.arrays.columns import matched
from hfa_support.arrays.tables import read_source
from hfa_support.errors import BadInputError, advice, refuse_unknown, shortened, warn

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
    held: states whose initial value is held.
    """

    name: str
    time: np.ndarray
    inputs: np.ndarray
    measured: Mapping[str, np.ndarray]
    has_steps: bool = False
    held: Collection[str] = ()

    def table(self, names: Sequence[str]) -> np.ndarray:
        """Return the samples of some measured quantities, (N, k), NaN for a missing sample.

        names: the quantities
        """
        none = np.full(len(self.time), np.nan)
        return np.column_stack([self.measured.get(name, none) for name in names])


def read_record(source: Any, model: Model, held: Mapping[str, float], name: str = "") -> Record:
    """Read a record from a table: a file, or a mapping or data frame of columns.

    Its columns are "time" (s), every input, and at least one state or output, such as "alpha [deg]"
    (`read_source`). Numbers without a unit are in that of the model; an angle without one is read
    in a dictionary of Python alone, in radians. An empty cell is a missing sample.

    held: input without a column -> its constant value
    name: name of the record, by default that of the file

    Raises BadInputError if the table cannot be read or is not a record of this model.
    """
    signals = (*model.inputs, *model.states, *model.outputs)
    units = {"time": "s"} | {signal: model.unit(signal) for signal in signals}
    name = Path(name or source).name
    columns = matched(read_source(source, name).columns, units)
    unused = [other for other in columns if other not in units]
    for other in unused:
        if advice(other, units):  # a misspelled name
            refuse_unknown(f"{columns[other].heading}: unknown column", other, units)
    if unused:
        named = shortened(", ".join(unused), 200)
        warn(f"{name}: not used, as no state, input or output of {model.name}: {named}")
    if "time" not in columns:
        raise BadInputError(f"{name} has no column time; add the time of each sample, in s")
    arrays = {
        signal: column.numbers(units[signal])
        for signal, column in columns.items()
        if signal in units
    }
    time = arrays["time"]
    for signal, values in arrays.items():
        if len(values) != len(time):
            raise BadInputError(
                f"{name}: {signal} has {len(values)} samples, but time has {len(time)}; "
                "give columns of equal length"
            )
        seen = int(np.isfinite(values).sum())
        if seen < FEWEST:
            raise BadInputError(
                f"{name}: {signal} has {seen} finite values; give at least {FEWEST}, or remove "
                "the column"
            )
        is_wrong = np.isinf(values)
        if signal == "time" or signal in model.inputs:
            is_wrong |= np.isnan(values)
        columns[signal].refuse(is_wrong, "has no finite number; give one, or remove the row")
    late = np.append(False, np.diff(time) <= 0.0)
    columns["time"].refuse(late, "does not increase; sort the rows, and remove repeated ones")
    for signal in model.inputs:
        if signal not in arrays and signal not in held:
            raise BadInputError(
                f"{name} has no column {signal}; add the column, or give a constant (--hold"
                f" {signal}=VALUE, or in Python hold={{{signal!r}: VALUE}})"
            )
    inputs = [arrays.get(signal, np.full(len(time), held.get(signal))) for signal in model.inputs]
    measured = {signal: arrays[signal] for signal in arrays.keys() - {"time", *model.inputs}}
    if not measured:
        raise BadInputError(
            f"{name} has no column of a measured state or output; add a column such as "
            f"{next(iter(model.states))}"
        )
    in_order = {signal: measured[signal] for signal in signals if signal in measured}
    states = [signal for signal in held if signal in model.states]
    for signal in states:
        if signal in measured:
            raise BadInputError(
                f"{name} has a column {signal}, whose initial value is fitted; remove the column, "
                "or the held value"
            )
    return Record(name, time, np.reshape(inputs, (-1, len(time))).T, in_order, held=states)
