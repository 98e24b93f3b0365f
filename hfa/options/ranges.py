"""Conversion of `start:stop:step`, `a,b,c` or one number to the values of a named variable."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, TypeAlias

import numpy as np

from hfa.options.argument_types import number_and_factor, quantity
from hfa_aircraft.model import Model
from hfa_support.errors import BadInputError, shortened

if TYPE_CHECKING:
    from trim.sweeps.sweep_plan import Steps

#: Listed or evenly spaced values in internal units.
Range: TypeAlias = "tuple[float, ...] | Steps"


def value_range(model: Model, name: str, text: str) -> Range:
    """Return the values of a named variable, in internal units, from its text.

    text: `start:stop:step`, `a,b,c` or one number, each with or without a unit; the values of a
        range do not exceed `stop`

    Raises BadInputError for text of another form, for different units, for a step that is not
    positive, if stop < start, and for more than `MOST_POINTS` values of a range.
    """
    if re.fullmatch(r"[-+]?\d{1,3}(,\d{3})*,0\d\d(,\d{3})*\s*\D*", text):  # not a list
        raise BadInputError(f"is {shortened(text)!r}; write {text.replace(',', '')}")
    parts = text.split(":")
    if len(parts) == 1:
        return tuple(quantity(model, name, word) for word in text.split(","))
    if len(parts) != 3:
        raise BadInputError(
            f"is {shortened(text)!r}; give start:stop:step, a list a,b,c or one number"
        )
    (start, factor), *others = (number_and_factor(model, name, part) for part in parts)
    if any(other != factor for _, other in others):
        raise BadInputError(f"is {shortened(text)!r}; give all three numbers in the same unit")
    stop, step = (value for value, _ in others)
    from trim.sweeps.sweep_plan import MOST_POINTS, Steps

    if step <= 0:
        raise BadInputError(f"has the step {step:g}; give a positive step")
    if stop < start:
        raise BadInputError(
            f"runs backwards from {start:g} to {stop:g}; give the lower number first"
        )
    count = _count(start, stop, step)
    if count > MOST_POINTS:
        raise BadInputError(
            f"is a range of {float(count):,.15g} points (maximum {MOST_POINTS:,}); choose a larger "
            "step"
        )
    unit = quantity(model, name, "1") if factor is None else factor
    spacing = min(step * unit, (stop - start) * unit / (count - 1)) if count > 1 else step * unit
    while start * unit + spacing * (count - 1) > stop * unit:  # stop may be a limit
        spacing = np.nextafter(spacing, 0.0)
    return Steps(start * unit, float(spacing), count)


def _count(start: float, stop: float, step: float) -> int:
    """Return the number of values start, start + step, ... up to stop, of the typed decimals.

    Doubles would miss the last value of 35:35.3:0.1, because (35.3 - 35) / 0.1 is below 3 in them.
    """
    from fractions import Fraction

    first, last, width = (Fraction(repr(value)) for value in (start, stop, step))
    return (last - first) // width + 1


def single_value(name: str, values: Range) -> float:
    """Return the only value of a variable.

    name: name of the variable, for the message

    Raises BadInputError if there are several values.
    """
    if len(values) > 1:
        raise BadInputError(
            f"{name} has {len(values):,} values; give one (`hfa trim` and `hfa sweep` take several)"
        )
    return float(values[0])


def array_of(name: str, values: Range, most: int) -> np.ndarray:
    """Return the values of a variable as an array, (N,).

    name: name of the variable, for the message
    values: the values, or start, spacing and count of a range

    Raises BadInputError if there are more than `most` values.
    """
    if len(values) > most:
        raise BadInputError(
            f"{name} has {len(values):,} points, but at most {most:,} are allowed; give fewer"
        )
    return np.asarray(values if isinstance(values, tuple) else values[np.arange(values.count)])
