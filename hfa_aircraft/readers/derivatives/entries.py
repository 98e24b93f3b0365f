"""Entries of a table as a file or a dictionary gives them, and the numbers with units in them."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

from hfa_support.errors import BadInputError, shortened, shown
from hfa_support.units import conversion_factor, si_unit, split_unit


@dataclass(frozen=True)
class Entry:
    """Unchecked entry of a table.

    value: a number, a text with a unit, or a list of two of these
    where: place in the file, for messages
    """

    value: Any
    where: str

    def error(self, message: str) -> BadInputError:
        """Return a BadInputError whose message begins with the place of the entry."""
        return BadInputError(f"{self.where}: {message}")


def number(name: str, entry: Entry, unit: str, factor_without_unit: float = 1.0) -> float:
    """Return the value of an entry, converted to `unit`.

    factor_without_unit: factor on a number without a unit

    Raises BadInputError unless the value is a finite number, with or without a unit.
    """
    value: Any = entry.value
    stated = ""
    if isinstance(value, str):
        text, stated = split_unit(value)
        value = _float(text)
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        raise entry.error(
            f"{name} is {shown(entry.value)}; give a finite number, optionally with a unit"
        )
    return float(value) * (_factor(name, entry, stated, unit) if stated else factor_without_unit)


def _float(text: str) -> float:
    """Return the number that a text represents, or NaN if it represents none."""
    try:
        return float(text)
    except ValueError:
        return math.nan


def _factor(name: str, entry: Entry, stated: str, unit: str) -> float:
    """Return the factor from the stated unit to `unit`."""
    factor = conversion_factor(stated, unit)
    if factor is None:
        if stated == "lb":
            raise entry.error(f"{name} is in lb; write lbf (a weight or force) or lbm (a mass)")
        other = unit.replace("rad", "deg") if "rad" in unit else si_unit(unit)
        known = " or ".join(dict.fromkeys((unit, other)))
        raise entry.error(f"{name} is in {shortened(stated)}; give {name} in {known}")
    return factor
