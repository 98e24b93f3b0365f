"""From the words of a command line to numbers: degrees become radians here and nowhere else."""

from __future__ import annotations

import math

import numpy as np

from hfa_model.support.errors import BadInputError
from hfa_model.vectors import UNITS
from trim.sweeps.sweep_plan import Steps


def number(text: str, what: str) -> float:
    """A finite number; BadInputError names what it was for."""
    try:
        value = float(text)
    except ValueError:
        raise BadInputError(f"{what} is {text!r}; give a number") from None
    if not math.isfinite(value):
        raise BadInputError(f"{what} is {text}; give a finite number")
    return value


def quantity(name: str, text: str) -> float:
    """The value of a named variable in internal units: angles are given in degrees."""
    value = number(text, name)
    return math.radians(value) if _is_angle(name) else value


def grid(name: str, text: str, most: int) -> np.ndarray:
    """The values of `axis` as one array."""
    values = axis(name, text, most)
    return values.at(np.arange(values.count)) if isinstance(values, Steps) else np.array(values)


def axis(name: str, text: str, most: int) -> tuple[float, ...] | Steps:
    """`start:stop:step`, `a,b,c` or one number, in internal units; a range ends with the last value at or before stop.

    BadInputError when the range runs backwards, its step is not positive or it has more than `most` points.
    """
    parts = text.split(":")
    if len(parts) == 1:
        return tuple(quantity(name, word) for word in text.split(","))
    if len(parts) != 3:
        raise BadInputError(f"{name} is {text!r}; give start:stop:step, a list a,b,c or one number")
    start, stop, step = (
        number(word, f"{name} {what}") for word, what in zip(parts, ("start", "stop", "step"), strict=True)
    )
    if step <= 0:
        raise BadInputError(f"{name} step is {step:g}; it must be positive")
    if stop < start:
        raise BadInputError(f"{name} runs backwards from {start:g} to {stop:g}; give the lower end first")
    intervals = (stop - start) / step
    if intervals >= most:
        raise BadInputError(
            f"{name} range has {intervals + 1:.3g} points; at most {most} are allowed, take a larger step"
        )
    unit = math.radians(1.0) if _is_angle(name) else 1.0
    return Steps(start * unit, step * unit, math.floor(intervals + 1e-9) + 1)


def span(name: str, text: str) -> tuple[float, float]:
    """`LOW:HIGH` in internal units; BadInputError unless low < high."""
    low, colon, high = text.partition(":")
    if not colon or ":" in high:
        raise BadInputError(f"{name} is {text!r}; give LOW:HIGH")
    lowest, highest = quantity(name, low), quantity(name, high)
    if not lowest < highest:
        raise BadInputError(f"{name} is {text!r}; the first limit must be the lower one")
    return lowest, highest


def whole(option: str, text: str | None, default: int, *, lowest: int) -> int:
    """The whole number given to an option, or the default."""
    if text is None:
        return default
    value = number(text, option)
    # From the digits where there are only digits: a float would round the large ones.
    result = int(text) if text.strip().isdigit() else int(value)
    if value != int(value) or result < lowest:
        raise BadInputError(f"{option} is {text}; give a whole number from {lowest}")
    return result


def split_assignments(words: list[str] | None) -> dict[str, str]:
    """`NAME=TEXT` words, unconverted; BadInputError when a name comes twice."""
    result: dict[str, str] = {}
    for word in words or []:
        name, separator, text = word.partition("=")
        if not separator:
            raise BadInputError(f"{word!r} is not NAME=VALUE")
        if name in result:
            raise BadInputError(f"{name} is given twice, as {result[name]!r} and as {text!r}; give it once")
        result[name] = text
    return result


def _is_angle(name: str) -> bool:
    # A parameter of the aircraft is given in its own unit, whatever that is.
    return UNITS.get(name, "").startswith("rad")
