"""What a sweep visits, from the words `start:stop:step`, `a,b,c`, `LOW:HIGH` or one number."""

from __future__ import annotations

import math
from argparse import ArgumentTypeError
from typing import NamedTuple

import numpy as np

from hfa_cli.options.argument_types import number, quantity, span
from hfa_support.errors import BadInputError, shortened
from trim.sweeps.sweep_plan import MOST_POINTS, Steps


class Span(NamedTuple):
    """Lowest and highest value of something that is drawn at random; twice the same for a constant."""

    lowest: float
    highest: float


#: Listed values, evenly spaced ones, or the limits of random ones; internal units.
Range = tuple[float, ...] | Steps | Span


def value_range(name: str, text: str) -> Range:
    """The range of a named variable; evenly spaced values end with the last one at or before stop."""
    parts = text.split(":")
    if len(parts) == 1:
        return tuple(quantity(name, word) for word in text.split(","))
    if len(parts) == 2:
        return Span(*span(name, text))
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


def grid_values(name: str, values: Range) -> tuple[float, ...] | Steps:
    """The values of a variable on a grid; BadInputError when there are only the limits of random ones."""
    if isinstance(values, Span):
        raise BadInputError(f"{name} is LOW:HIGH without a step; give start:stop:step, a,b,c or one number")
    return values


def array_of(name: str, values: Range, most: int) -> np.ndarray:
    """`grid_values` as one array, (N,); BadInputError when there are more than `most`."""
    listed = grid_values(name, values)
    if not isinstance(listed, Steps):
        return np.array(listed)
    if listed.count > most:
        raise BadInputError(f"{name} has {listed.count:,} points; at most {most:,} are allowed, take a larger step")
    return listed.at(np.arange(listed.count))


def sample_limits(name: str, values: Range) -> Span:
    """The limits of random values of a variable; BadInputError when it has a grid."""
    if isinstance(values, tuple) and len(values) == 1:
        return Span(values[0], values[0])
    if not isinstance(values, Span):
        raise BadInputError(f"{name} is a grid; with --samples give LOW:HIGH or one number")
    return values


def _part(text: str, what: str) -> float:
    try:
        return number(text)
    except ArgumentTypeError as error:
        raise ArgumentTypeError(f"{what} {error}") from error
