"""Conversion factors from English units to SI units, and the names of both.

ft = 0.3048 m and lb = 0.45359237 kg are exact, as is standard gravity, 9.80665 m/s² (National
Institute of Standards and Technology, Special Publication 811). Other factors are derived from
these. Seconds, radians and numbers without a unit are unchanged.
"""

from __future__ import annotations

import re
from collections.abc import Iterator

SYSTEMS = ("english", "si")
_FOOT = 0.3048
_POUND = 0.45359237
_GRAVITY = 9.80665
#: English unit -> (SI unit, number of SI units in one English unit).
_SI = {
    "ft": ("m", _FOOT),
    "lbf": ("N", _POUND * _GRAVITY),
    "slug": ("kg", _POUND * _GRAVITY / _FOOT),
}


def si_unit(unit: str) -> str:
    """Return the SI unit that corresponds to an English unit, for example m/s for ft/s."""
    return re.sub(r"\b(ft|lbf|slug)\b", lambda word: _SI[word[0]][0], unit).replace("m N", "N m")


def si_factor(unit: str) -> float:
    """Return the conversion factor from an English unit to SI, for example 0.3048 for ft/s.

    All units after "/" divide, up to the end of the bracket.
    """
    return _product(iter(re.findall(r"\(|\)|/|\^-?\d+|[^\s()/^]+", unit)))


def _product(words: Iterator[str]) -> float:
    """Return the conversion factor from a product of English units to SI.

    words: units, exponents, "/" and brackets, in order, which are read up to the closing bracket
    """
    product = 1.0
    sign = 1
    last = 1.0
    for word in words:
        if word == ")":
            break
        if word == "/":
            sign = -1
        elif word.startswith("^"):
            product *= last ** (sign * (int(word[1:]) - 1))
        else:
            last = _product(words) if word == "(" else _SI.get(word, ("", 1.0))[1]
            product *= last**sign
    return product


def conversion(stated: str, unit: str) -> float | None:
    """Return the factor that converts numbers in unit `stated` to numbers in `unit`, or None.

    The factor is known for equal units, and for an English unit and its SI unit.
    """
    if stated == unit:
        return 1.0
    if stated == si_unit(unit):
        return 1.0 / si_factor(unit)
    if si_unit(stated) == unit:
        return si_factor(stated)
    return None
