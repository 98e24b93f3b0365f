"""Feet, slugs and pounds inside; metres, kilograms and newtons where a user asks: here alone does a
unit change.

Exact but for rounding: ft = 0.3048 m, lb = 0.45359237 kg, standard gravity 9.80665 m/s² (National
Institute of Standards and Technology, Special Publication 811). Seconds, radians and numbers
without a unit stay."""

from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from typing import Any

import numpy as np

from hfa_support.errors import BadInputError, shortened

SYSTEMS = ("english", "si")
_FOOT, _POUND, _GRAVITY = 0.3048, 0.45359237, 9.80665
_SI = {
    "ft": ("m", _FOOT),
    "lbf": ("N", _POUND * _GRAVITY),
    "slug": ("kg", _POUND * _GRAVITY / _FOOT),
}
_SYSTEM: ContextVar[str] = ContextVar("units", default=SYSTEMS[0])


@contextmanager
def shown_in(system: str) -> Iterator[None]:
    """Reports made in the block are in these units, one of `SYSTEMS`."""
    if system not in SYSTEMS:
        raise ValueError(f"units are {system!r}; use one of {', '.join(SYSTEMS)}")
    token = _SYSTEM.set(system)
    try:
        yield
    finally:
        _SYSTEM.reset(token)


def system_in_force() -> str:
    """One of `SYSTEMS`."""
    return _SYSTEM.get()


def unit_in_force(unit: str) -> str:
    """The unit in which values of an English unit are shown: m/s for ft/s, N m for ft lbf."""
    return si_unit(unit) if _SYSTEM.get() == "si" else unit


def in_force(value: Any, unit: str) -> Any:
    """A value, or an array, of an English unit, in `unit_in_force`."""
    return value * si_factor(unit) if _SYSTEM.get() == "si" else value


def typed(value: float, unit: str) -> float:
    """A number that was typed in `unit_in_force`, in the English unit."""
    return value / si_factor(unit) if _SYSTEM.get() == "si" else value


def entries_in_force(matrix: np.ndarray, *axes: tuple[tuple[str, ...], int]) -> np.ndarray:
    """An array whose last axes have units, each a (unit of every entry, power): (m/s)/(rad) of A is
    +1 and -1."""
    if _SYSTEM.get() != "si":
        return matrix
    for place, (units, power) in enumerate(axes):
        factors = np.array([si_factor(unit) ** power for unit in units])
        matrix = matrix * factors.reshape(-1, *(1,) * (len(axes) - 1 - place))
    return matrix


def si_unit(unit: str) -> str:
    """The SI unit of an English one."""
    return re.sub(r"\b(ft|lbf|slug)\b", lambda found: _SI[found[0]][0], unit).replace("m N", "N m")


def si_factor(unit: str) -> float:
    """How many SI units one English unit is: 0.3048 for ft/s. What follows "/" divides, up to the
    end of a bracket."""
    return _product(iter(re.findall(r"\(|\)|/|\^-?\d+|[^\s()/^]+", unit)))


def english(value: float, stated: str, unit: str) -> float:
    """A value in the English unit, stated in it or in its SI unit. BadInputError for any other."""
    if stated == unit:
        return value
    if stated != si_unit(unit):
        raise BadInputError(f"a state is in {shortened(stated)}, not in {unit} or {si_unit(unit)}")
    return value / si_factor(unit)


def _product(words: Iterator[str]) -> float:
    factor, sign, last = 1.0, 1, 1.0
    for word in words:
        if word == ")":
            break
        if word == "/":
            sign = -1
        elif word.startswith("^"):
            factor *= last ** (sign * (int(word[1:]) - 1))
        else:
            last = _product(words) if word == "(" else _SI.get(word, ("", 1.0))[1]
            factor *= last**sign
    return factor
