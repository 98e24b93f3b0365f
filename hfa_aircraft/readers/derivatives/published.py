"""Usual values of dimensionless numbers of aircraft: those of the aircraft in `published.csv`."""

from __future__ import annotations

import csv
import math
from collections.abc import Callable, Mapping
from functools import cache, partial
from operator import itemgetter
from pathlib import Path

from hfa_support.units import STANDARD_GRAVITY

#: Factor beyond the published values. With it, 1 % of the figures of an aircraft of the table are
#: outside those of the others.
_PERMITTED_FACTOR = 1.5
_DEGREES_PER_RADIAN = math.degrees(1.0)
#: Columns of `published.csv` that are no entries.
_WORDS = ("name", "source")


class Values(dict[str, float]):
    """Entries of a table in consistent units, nan for a missing one."""

    def __missing__(self, name: str) -> float:
        return math.nan


def _ratio(text: str, entry: Values) -> float:
    """Return the ratio of two entries, such as "Cl_beta / Cl_p", nan if the second is 0."""
    one, other = text.split(" / ")
    return entry[one] / (entry[other] or math.nan)


def _radius(moment: str, entry: Values) -> float:
    """Return the radius of gyration of a moment of inertia, in spans, nan for a moment <= 0."""
    # No figure for a moment <= 0: `inertia_warning` reports it.
    return math.sqrt(max(entry[moment], 0.0) / entry["mass"]) / entry["span"] or math.nan


def _drag(entry: Values) -> float:
    """Return the drag coefficient at the condition of the derivatives."""
    return entry["CD_0"] + entry.get("CD_CL2", 0.0) * entry["CL_0"] ** 2


def _inverse_efficiency(entry: Values) -> float:
    """Return 1/e of C_D = C_D0 + C_L² / (pi e aspect ratio), of CD_CL2 or of CD_alpha."""
    slope = entry["CD_CL2"]
    if math.isnan(slope):
        # dC_D/dalpha = 2 CD_CL2 C_L C_L,alpha
        slope = entry["CD_alpha"] / (2.0 * entry["CL_0"] * entry["CL_alpha"] or math.nan)
    return slope * math.pi * entry["span"] ** 2 / entry["wing_area"]


#: Figures that are entries themselves.
_ENTRIES = (
    *("CL_alpha", "CL_elevator", "Cm_q", "Cm_alphadot", "Cm_elevator", "CY_beta", "Cl_beta"),
    *("Cl_p", "Cl_aileron", "Cn_beta", "Cn_r", "Cn_rudder"),
)
_RATIOS = ("Cn_beta / CY_beta", "Cl_beta / Cl_p", "Cn_r / Cn_beta")
_RATIOS_OF_CONTROLS = ("Cl_aileron / Cl_p", "Cn_r / Cn_rudder")
#: Figure -> its value from the entries; nan if it is unknown.
FIGURES: Mapping[str, Callable[[Values], float]] = {
    "span^2 / wing_area (aspect ratio)": lambda entry: entry["span"] ** 2 / entry["wing_area"],
    "chord * span / wing_area": lambda entry: entry["chord"] * entry["span"] / entry["wing_area"],
    **{f"sqrt({name} / mass) / span": partial(_radius, name) for name in ("Ixx", "Iyy", "Izz")},
    "(Izz - Iyy) / Ixx": lambda entry: (entry["Izz"] - entry["Iyy"]) / (entry["Ixx"] or math.nan),
    "thrust / weight": lambda entry: entry["thrust"] / (entry["mass"] * entry["gravity"]),
    "CD_0 + CD_CL2 CL_0^2": _drag,
    **{name: itemgetter(name) for name in _ENTRIES},
    "-Cm_alpha / CL_alpha (static margin)": lambda entry: -_ratio("Cm_alpha / CL_alpha", entry),
    "CD_CL2 or CD_alpha / (2 CL_0 CL_alpha), times pi aspect ratio": _inverse_efficiency,
    "CT_u / (CD_0 + CD_CL2 CL_0^2)": lambda entry: entry["CT_u"] / (_drag(entry) or math.nan),
    **{text: partial(_ratio, text) for text in (*_RATIOS, *_RATIOS_OF_CONTROLS)},
}


@cache
def _published() -> list[Values]:
    """Return the entries of each published aircraft."""
    text = Path(__file__).with_name("published.csv").read_text("utf-8")
    lines = [line for line in text.splitlines() if not line.startswith("#")]
    return [
        Values(
            {name: float(row[name]) for name in row if name not in _WORDS and row[name]},
            gravity=STANDARD_GRAVITY,  # the entries are in SI units
        )
        for row in csv.DictReader(lines)
    ]


def _is_usual(value: float, low: float, high: float) -> bool:
    """Return whether a value is in the published range, low to high, or close to it, or nan.

    The permitted range is wider by `_PERMITTED_FACTOR` at both ends, also where an end is below 0.
    """
    lowest = low * _PERMITTED_FACTOR if low < 0.0 else low / _PERMITTED_FACTOR
    highest = high * _PERMITTED_FACTOR if high > 0.0 else high / _PERMITTED_FACTOR
    return not (value < lowest or value > highest)


def unusual(figure: str, value: float) -> str:
    """Return a sentence if the value of a figure is outside those of published aircraft, or "".

    The sentence has the value, the published ones, and the sign or unit that would be usual.
    """
    values = (FIGURES[figure](entries) for entries in _published())
    known = [published for published in values if math.isfinite(published)]
    low, high = min(known), max(known)
    if _is_usual(value, low, high):
        return ""
    says = f"{figure} is {value:.3g}, of published aircraft {low:.3g} to {high:.3g}"
    is_entry = figure in _ENTRIES
    if _is_usual(-value, low, high):
        return f"{says}; {'its' if is_entry else 'a'} sign may be wrong" + (
            "" if is_entry else ", or entries are exchanged"
        )
    if is_entry:
        for factor, unit in ((_DEGREES_PER_RADIAN, "deg"), (1.0 / _DEGREES_PER_RADIAN, "rad")):
            if _is_usual(factor * value, low, high):
                return f"{says}; it may be given per {unit} (a factor of 57.3)"
    return f"{says}; check it"
