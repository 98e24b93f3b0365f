"""The U.S. Standard Atmosphere 1976 up to 47 km, in ft, slug, lbf and degrees Rankine.

The constants are those of JSBSim (`FGStandardAtmosphere`). Results agree with JSBSim within
rounding, and within 2e-5 with `hfa_model.atmosphere`, whose constants are the standard's.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import casadi as ca

from hfa_support.units import si_factor

FT_TO_M = 0.3048
HEAT_RATIO = 1.4
_STANDARD_GRAVITY = 9.80665 / FT_TO_M
_EARTH_RADIUS = 6356766.0 / FT_TO_M
_KG_TO_SLUG = 0.06852168
_GAS_CONSTANT = (8.31432 * _KG_TO_SLUG / (FT_TO_M * FT_TO_M * 1.8)) / (
    28.9645 * _KG_TO_SLUG / 1000.0
)
SEA_LEVEL_PRESSURE = 2116.228
#: Lowest and highest altitude of aircraft, ft.
ALTITUDES = (-1000.0, 150000.0)
#: Lower ends of the layers: geopotential altitude, ft, and temperature, degrees Rankine.
_LAYERS = (
    (0.0, 518.67),
    (36089.2388, 389.97),
    (65616.7979, 389.97),
    (104986.8766, 411.57),
    (154199.4751, 487.17),
)


@dataclass(frozen=True)
class Air:
    """State of the air, in ft, slug, lbf and degrees Rankine, or in SI units.

    temperature: degrees Rankine or K.
    pressure: static pressure.
    density: density.
    sound: speed of sound.
    """

    temperature: Any
    pressure: Any
    density: Any
    sound: Any


def air_at(altitude: Any, system: str = "english") -> Air:
    """Return standard air at a geometric altitude, in ft or m, of at most 154,000 ft.

    system: system of units, english or si
    """
    if system == "si":
        english = air_at(altitude / FT_TO_M)
        return Air(
            english.temperature / 1.8,
            english.pressure * si_factor("lbf/ft^2"),
            english.density * si_factor("slug/ft^3"),
            english.sound * FT_TO_M,
        )
    if isinstance(altitude, int | float):
        altitude = ca.DM(altitude)  # a layer below may have no real pressure
    height = altitude * _EARTH_RADIUS / (_EARTH_RADIUS + altitude)
    base_pressure = SEA_LEVEL_PRESSURE
    temperature: Any = 0.0
    pressure: Any = 0.0
    for (bottom, warmth), (top, next_warmth) in pairwise(_LAYERS):
        lapse = (next_warmth - warmth) / (top - bottom)
        layer_temperature = warmth + lapse * (height - bottom)
        layer_pressure = base_pressure * _pressure_ratio(warmth, lapse, height - bottom)
        if bottom:
            temperature = ca.if_else(height < bottom, temperature, layer_temperature)
            pressure = ca.if_else(height < bottom, pressure, layer_pressure)
        else:
            temperature = layer_temperature
            pressure = layer_pressure
        base_pressure = float(base_pressure * _pressure_ratio(warmth, lapse, top - bottom))
    sound = ca.sqrt(HEAT_RATIO * _GAS_CONSTANT * temperature)
    return Air(temperature, pressure, pressure / (_GAS_CONSTANT * temperature), sound)


def _pressure_ratio(warmth: float, lapse: float, climb: Any) -> Any:
    """Return the pressure in a layer of the atmosphere, relative to the pressure at its bottom."""
    if lapse == 0.0:
        return ca.exp(-_STANDARD_GRAVITY * climb / (_GAS_CONSTANT * warmth))
    return (warmth / (warmth + lapse * climb)) ** (_STANDARD_GRAVITY / (_GAS_CONSTANT * lapse))


SEA_LEVEL = Air(*(float(value) for value in vars(air_at(ca.DM(0.0))).values()))
