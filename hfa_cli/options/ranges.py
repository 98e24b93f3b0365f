"""What a sweep visits, from the words `start:stop:step`, `a,b,c` or one number."""

from __future__ import annotations

import csv
import math
from argparse import ArgumentTypeError
from pathlib import Path

import numpy as np

from hfa_cli.options.argument_types import number, quantity
from hfa_support.errors import BadInputError, shortened
from trim.point.condition import TrimCondition
from trim.sweeps.sweep_plan import MOST_POINTS, Steps

#: Listed values or evenly spaced ones; internal units.
Range = tuple[float, ...] | Steps


def value_range(name: str, text: str) -> Range:
    """The range of a named variable; evenly spaced values end with the last one at or before stop."""
    parts = text.split(":")
    if len(parts) == 1:
        return tuple(quantity(name, word) for word in text.split(","))
    if len(parts) != 3:
        raise ArgumentTypeError(f"is {shortened(text)!r}; give start:stop:step, a list a,b,c or one number")
    start, stop, step = (_part(word, what) for word, what in zip(parts, ("start", "stop", "step"), strict=True))
    if step <= 0:
        raise ArgumentTypeError(f"step is {step:g}; it must be positive")
    if stop < start:
        raise ArgumentTypeError(f"runs backwards from {start:g} to {stop:g}; give the lower end first")
    intervals = (stop - start) / step
    if intervals >= MOST_POINTS:
        said = f"{np.floor(intervals) + 1.0:,.15g}"
        raise ArgumentTypeError(f"is a range of {said} points; at most {MOST_POINTS:,} are allowed, take a larger step")
    unit, count = quantity(name, "1"), math.floor(intervals + 1e-9) + 1
    spacing = min(step * unit, (stop - start) * unit / (count - 1)) if count > 1 else step * unit
    while start * unit + spacing * (count - 1) > stop * unit:  # by rounding: stop may be a limit
        spacing = np.nextafter(spacing, 0.0)
    return Steps(start * unit, float(spacing), count)


def listed_conditions(path: Path, condition: TrimCondition) -> dict[str, np.ndarray]:
    """The columns of a CSV file of conditions: a header of names, then a row a point, typed as in --hold (degrees).

    BadInputError names the row, the header being row 1, and the column.
    """
    try:
        with path.open(encoding="utf-8-sig", newline="") as file:
            header, *rows = [row for row in csv.reader(file) if any(map(str.strip, row))] or [[]]
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise BadInputError(
            f"{path}: cannot be read ({getattr(error, 'strerror', None) or error}); give a CSV file of conditions"
        ) from error
    names, model = [name.strip() for name in header], condition.model
    for name in names:
        model.refuse_unheld(f"{path}: the column of row 1 is unknown:", name, tuple(model.parameters))
        if names.count(name) > 1:
            raise BadInputError(f"{path}: column {name} comes twice; leave one out")
    if not rows:
        raise BadInputError(f"{path}: has no conditions; give a row of names and a row for each condition")

    def cell(place: int, name: str, text: str) -> float:
        try:
            value = quantity(name, text)
        except ArgumentTypeError as error:
            raise BadInputError(f"{path}: row {place}, column {name} {error}") from error
        lowest, highest = condition.limits_of(name) if name in model.limits else (-math.inf, math.inf)
        if not lowest <= value <= highest:
            between = f"{model.describe(name, lowest)} and {model.describe(name, highest)}"
            said = model.describe(name, value)
            raise BadInputError(f"{path}: row {place}, column {name} is {said}; it must lie between {between}")
        return value

    table = []
    for place, row in enumerate(rows, start=2):
        if len(row) != len(names):
            raise BadInputError(f"{path}: row {place} has {len(row)} cells for {len(names)} columns; correct it")
        table.append([cell(place, name, text) for name, text in zip(names, row, strict=True)])
    return dict(zip(names, np.array(table).T, strict=True))


def array_of(name: str, values: Range, most: int) -> np.ndarray:
    """A range as one array, (N,); BadInputError when there are more than `most`."""
    if not isinstance(values, Steps):
        return np.array(values)
    if values.count > most:
        raise BadInputError(f"{name} has {values.count:,} points; at most {most:,} are allowed, take a larger step")
    return np.asarray(values[np.arange(values.count)])


def _part(text: str, what: str) -> float:
    try:
        return number(text)
    except ArgumentTypeError as error:
        raise ArgumentTypeError(f"{what} {error}") from error
