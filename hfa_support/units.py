"""Conversion of units: from English units to SI, and of usual spellings of units in files.

ft = 0.3048 m and lb = 0.45359237 kg are exact, as is standard gravity, 9.80665 m/s² (National
Institute of Standards and Technology, Special Publication 811). Other factors are derived from
these.
"""

from __future__ import annotations

import math
import re
from collections import Counter
from collections.abc import Collection, Iterator, Mapping
from functools import lru_cache
from typing import NamedTuple

SYSTEMS = ("english", "si")
#: Foot, m; knot, m/s; standard gravity, m/s²; radius of the Earth in the standard atmosphere, m.
FOOT = 0.3048
KNOT = 1852.0 / 3600.0
STANDARD_GRAVITY = 9.80665
EARTH_RADIUS = 6356766.0
_POUND = 0.45359237
_SLUG = _POUND * STANDARD_GRAVITY / FOOT
#: Units of force, length and mass.
ENGLISH_BASES, SI_BASES = ("lbf", "ft", "slug"), ("N", "m", "kg")


class _Unit(NamedTuple):
    """Size of a unit in SI units, and its powers of m, kg, s, rad, K and words that are unknown."""

    size: float
    powers: Mapping[str, int]


_MILE, _NAUTICAL_MILE = 1609.344, 1852.0
_POUND_FORCE = _POUND * STANDARD_GRAVITY
_PSF = _POUND_FORCE / FOOT**2
_DEGREE = math.pi / 180.0
#: Spelling -> unit, for all units that are converted: powers, and the sizes of their units.
_UNITS = {
    spelling: _Unit(size, powers)
    for powers, sizes in (
        ({}, {"1": 1.0}),
        (
            {"m": 1},
            {"m": 1.0, "km": 1000.0, "cm": 0.01, "mm": 0.001}
            | {"ft": FOOT, "feet": FOOT, "foot": FOOT, "in": FOOT / 12.0, "nmi": _NAUTICAL_MILE},
        ),
        ({"kg": 1}, {"kg": 1.0, "lbm": _POUND, "slug": _SLUG}),
        (
            {"s": 1},
            {"us": 1e-6, "µs": 1e-6, "μs": 1e-6, "ms": 1e-3}
            | {"s": 1.0, "min": 60.0, "h": 3600.0, "day": 24.0 * 3600.0},
        ),
        ({"rad": 1}, {"rad": 1.0} | dict.fromkeys(("deg", "°", "degree", "degrees"), _DEGREE)),
        ({"m": 1, "kg": 1, "s": -2}, {"N": 1.0, "kN": 1000.0, "lbf": _POUND_FORCE}),
        (
            {"m": 1, "s": -1},
            dict.fromkeys(("kt", "kts", "kn", "knot", "knots"), KNOT) | {"mph": _MILE / 3600.0},
        ),
        (
            {"m": -1, "kg": 1, "s": -2},
            {"Pa": 1.0, "hPa": 100.0, "mbar": 100.0, "kPa": 1000.0, "bar": 1e5}
            | {"psf": _PSF, "psi": 144.0 * _PSF, "inHg": 3386.389},
        ),
        ({"m": 2, "kg": 1, "s": -3}, {"W": 1.0, "kW": 1000.0, "hp": 550.0 * FOOT * _POUND_FORCE}),
        ({"K": 1}, {"K": 1.0, "degR": 5.0 / 9.0}),
    )
    for spelling, size in sizes.items()
}


def si_unit(unit: str) -> str:
    """Return the SI unit of a quantity, for example m/s for ft/s and kt, and rad for deg.

    Words that are no unit of a fixed size (%, rpm, °C) remain.
    """
    coherent = coherent_unit(unit, SI_BASES)
    return "W" if coherent == "N m/s" else coherent


def si_factor(unit: str) -> float:
    """Return the conversion factor from a unit to that of `si_unit`, for example 0.3048 for ft/s.

    All units after "/" divide, up to the end of the bracket.
    """
    return conversion_factor(unit, si_unit(unit)) or 1.0


def system_of(units: Collection[str]) -> str:
    """Return the system of some units: "english" (ft, slug, lbf, rad), "si", or "mixed" if they
    are of neither. Units of both, such as rad/s, are "si" if there are no others.
    """
    bases = {"si": SI_BASES, "english": ENGLISH_BASES}
    fitting = (
        name
        for name, of_system in bases.items()
        if all(coherent_unit(unit, of_system) == unit for unit in units)
    )
    return next(fitting, "mixed")


def coherent_unit(unit: str, bases: tuple[str, str, str]) -> str:
    """Return the unit of the same quantity that consists of the force, length and mass of one
    system, rad and s: ft/s for kt. A unit that has this size already is unchanged, and so are
    unknown words in a unit.

    bases: units of force, length and mass: ("lbf", "ft", "slug")
    """
    measured = _measured(unit)
    if measured is None:
        return unit
    others = {**measured.powers}  # powers of K and of unknown words, after the next line
    m, kg, s, rad = (others.pop(base, 0) for base in ("m", "kg", "s", "rad"))
    has_force = kg == 1 and s <= -2  # N = kg m/s²: a pressure is N/m², not kg/(m s²)
    if has_force:
        kg, m, s = kg - 1, m - 1, s + 2

    force_unit, length_unit, mass_unit = bases
    powers = {
        force_unit: int(has_force),
        mass_unit: kg,
        length_unit: m,
        **others,
        "rad": rad,
        "s": s,
    }
    words = {name: f"{name}^{abs(power)}".removesuffix("^1") for name, power in powers.items()}
    above = " ".join(words[name] for name, power in powers.items() if power > 0) or "1"
    below = " ".join(words[name] for name, power in powers.items() if power < 0)
    coherent = f"{above}/{below}" if below else above

    # Equal units differ by roundings of at most a dozen factors, others by 1e-4 and more.
    factor = conversion_factor(unit, coherent) or 1.0
    return unit if math.isclose(factor, 1.0, rel_tol=1e-12) else coherent


def conversion_factor(stated: str, unit: str) -> float | None:
    """Return the factor that converts numbers in unit `stated` to numbers in `unit`.

    The result is None for units of different quantities; an unknown word is a quantity of its own.
    Spellings are those of tables and records: km/h, kt, ft/min, deg, °, 1/deg, ms.

    >>> conversion_factor("ft/min", "m/s")
    0.00508
    """
    if stated == unit:
        return 1.0
    before, after = _measured(stated), _measured(unit)
    if before is None or after is None or before.powers != after.powers:
        return None
    return before.size / after.size


def stated_factor(stated: str, unit: str) -> float | None:
    """Return the factor of `conversion_factor` for a unit as people write it.

    "%" is a share of 1 or of the chord, "lb" a mass or a force, whichever the unit is, and capitals
    do not matter where the unit has no other meaning: KT.
    """
    if stated == "%" and unit in ("1", "chord"):
        return 0.01
    pounds = (re.sub(r"\blbs?\b", pound, stated) for pound in ("lbm", "lbf"))
    factors = (conversion_factor(each, unit) for each in (stated, stated.lower(), *pounds))
    return next((factor for factor in factors if factor is not None), None)


def units_like(unit: str) -> list[str]:
    """Return the other units of the same quantity, one spelling of each.

    >>> units_like("kg")
    ['lbm', 'slug']
    """
    measured = _measured(unit)
    if measured is None:
        return []
    spelling_of = {measured.size: unit}
    for name, known in _UNITS.items():
        if known.powers == measured.powers:
            spelling_of.setdefault(known.size, name)
    _, *others = spelling_of.values()
    return others


def split_unit(text: str) -> tuple[str, str]:
    """Return the number and the unit in a text such as "100 kt", with "" for a missing one.

    A flight level, "FL200", is a pressure altitude in hundreds of feet, which is the geopotential
    altitude H of the standard atmosphere: the number is the geometric altitude R H / (R - H). A
    unit that does not begin with a letter, as in "5.8 1/rad", follows a blank.
    """
    if level := re.fullmatch(r"\s*FL\s*(\d+)\s*", text, re.IGNORECASE):
        pressure_altitude = 100.0 * float(level[1])
        radius = EARTH_RADIUS / FOOT
        geometric = radius * pressure_altitude / (radius - pressure_altitude)
        return repr(geometric), "ft"
    digits = r"[-+]?[\d.]+(?:[eE][-+]?\d+)?"
    unit = r"(?![eE][-+]?\d)[a-zA-Z°µμ%].*"  # a text that begins with a letter, but is no exponent
    gap = rf"(?:\s*(?={unit})|\s+)"  # before another unit, at least one blank
    parts = re.fullmatch(rf"({digits}){gap}(\S.*)", text.strip())
    return (parts[1], parts[2]) if parts else (text, "")


@lru_cache(maxsize=256)
def _measured(unit: str) -> _Unit | None:
    """Return size and powers of a product of units such as "slug ft^2", or None for ""."""
    # A word that is unknown is a base of its own, of size 1.
    plain = unit.replace("²", "^2").replace("³", "^3")
    bracket_slash_exponent_or_name = r"\(|\)|/|\^-?\d+|[^\s()/^*·]+"
    factors = _product(iter(re.findall(bracket_slash_exponent_or_name, plain)))
    if not factors:
        return None
    size, powers = 1.0, Counter[str]()
    for word, power in factors.items():
        known = _UNITS.get(word, _Unit(1.0, {word: 1}))
        size *= known.size**power
        for base, exponent in known.powers.items():
            powers[base] += exponent * power
    return _Unit(size, {base: power for base, power in powers.items() if power})


def _product(words: Iterator[str]) -> Counter[str]:
    """Return name -> exponent of the units in a product, up to its closing bracket."""
    product: Counter[str] = Counter()
    factors: list[tuple[Counter[str], int]] = []
    sign = 1
    for word in words:
        if word == ")":
            break
        if word == "/":
            sign = -1  # all later factors divide
        elif word.startswith("^"):
            factor, power = factors.pop()
            factors.append((factor, power * int(word[1:])))
        else:
            factors.append((_product(words) if word == "(" else Counter([word]), sign))
    for factor, power in factors:
        for name, exponent in factor.items():
            product[name] += power * exponent
    return product
