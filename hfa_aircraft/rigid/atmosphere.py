"""The U.S. Standard Atmosphere 1976 up to 47 km, in ft, slug, lbf and degrees Rankine.

The constants are those of JSBSim (`FGStandardAtmosphere`). Results agree with JSBSim within
rounding, and within 2e-5 with `hfa_model.atmosphere`, whose constants are the standard's.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import casadi as ca

from hfa_support.units import EARTH_RADIUS, FOOT, KNOT, STANDARD_GRAVITY, si_factor

#: Ratio of specific heats of air.
HEAT_RATIO = 1.4
_GRAVITY = STANDARD_GRAVITY / FOOT
_EARTH_RADIUS = EARTH_RADIUS / FOOT
#: Gas constant of air, J/(kg K), and in ft lbf/(slug °R).
GAS_CONSTANT = 8.31432 / 28.9645e-3
_GAS_CONSTANT = GAS_CONSTANT / FOOT / FOOT / 1.8
#: lbf/ft².
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


def air_at(altitude: Any, system: str, warmer: Any = 0.0) -> Air:
    """Return standard air at a geometric altitude, in ft or m, of at most 154,000 ft.

    system: system of units, english or si
    warmer: deviation of the temperature, K. The pressure is that of the standard at the altitude,
        which then is a pressure altitude.
    """
    if system == "si":
        english = air_at(altitude / FOOT, "english", warmer)
        return Air(
            english.temperature / 1.8,
            english.pressure * si_factor("lbf/ft^2"),
            english.density * si_factor("slug/ft^3"),
            english.sound * FOOT,
        )
    if isinstance(altitude, int | float):
        # the formula of a layer gives a complex Python number outside it, in CasADi nan
        altitude = ca.DM(altitude)
    height = altitude * _EARTH_RADIUS / (_EARTH_RADIUS + altitude)
    base_pressure = SEA_LEVEL_PRESSURE
    temperature: Any = 0.0
    pressure: Any = 0.0
    for (bottom, base_temperature), (top, top_temperature) in pairwise(_LAYERS):
        lapse = (top_temperature - base_temperature) / (top - bottom)
        layer_temperature = base_temperature + lapse * (height - bottom)
        layer_pressure = base_pressure * _pressure_ratio(base_temperature, lapse, height - bottom)
        if bottom:
            temperature = ca.if_else(height < bottom, temperature, layer_temperature)
            pressure = ca.if_else(height < bottom, pressure, layer_pressure)
        else:
            temperature = layer_temperature
            pressure = layer_pressure
        base_pressure = float(
            base_pressure * _pressure_ratio(base_temperature, lapse, top - bottom)
        )
    temperature = temperature + 1.8 * warmer
    sound = ca.sqrt(HEAT_RATIO * _GAS_CONSTANT * temperature)
    return Air(temperature, pressure, pressure / (_GAS_CONSTANT * temperature), sound)


def density_altitude(density: Any) -> Any:
    """Return the geometric altitude, ft, at which standard air has a density, slug/ft³.

    In a layer with lapse rate L, ρ/ρ_bottom = (T_bottom / T)^(1 + g/(R L)).
    """
    height: Any = 0.0
    base_pressure = SEA_LEVEL_PRESSURE
    for (bottom, base_temperature), (top, top_temperature) in pairwise(_LAYERS):
        lapse = (top_temperature - base_temperature) / (top - bottom)
        base_density = base_pressure / (_GAS_CONSTANT * base_temperature)
        if lapse:
            exponent = 1.0 / (1.0 + _GRAVITY / (_GAS_CONSTANT * lapse))
            climb = base_temperature / lapse * ((base_density / density) ** exponent - 1.0)
        else:
            climb = _GAS_CONSTANT * base_temperature / _GRAVITY * ca.log(base_density / density)
        height = ca.if_else(density < base_density, bottom + climb, height) if bottom else climb
        base_pressure = float(
            base_pressure * _pressure_ratio(base_temperature, lapse, top - bottom)
        )
    return height * _EARTH_RADIUS / (_EARTH_RADIUS - height)


def equivalent_airspeed(dynamic_pressure: float) -> float:
    """Return the equivalent airspeed sqrt(2 q / ρ0), kt.

    dynamic_pressure: q = ρ V²/2, Pa
    """
    return math.sqrt(2.0 * dynamic_pressure / float(air_at(0.0, "si").density)) / KNOT


def pitot_pressure(mach: Any, pressure: Any) -> Any:
    """Return the total pressure in a pitot tube, in the unit of `pressure`.

    The flow is isentropic below Mach 1. Rayleigh's formula applies from Mach 1 on.

    pressure: static pressure
    """
    coefficient = 1.2**3.5 * 6.0**2.5
    fast = ca.fmax(mach, 1.0)
    supersonic = coefficient * fast**7.0 / (7.0 * fast * fast - 1.0) ** 2.5
    return pressure * ca.if_else(mach < 1.0, (1.0 + 0.2 * mach * mach) ** 3.5, supersonic)


def mach_of_pitot(impact_pressure: Any, pressure: Any) -> Any:
    """Return the Mach number from pitot pressure: the inverse of `pitot_pressure`.

    impact_pressure: total minus static pressure
    pressure: static pressure
    """
    ratio = impact_pressure / pressure + 1.0
    subsonic = ca.sqrt(5.0 * (ratio ** (2.0 / 7.0) - 1.0))  # isentropic flow
    coefficient = 1.2 ** (-0.25 * 7.0) * (1.2 / 1.4) ** (-0.5 * 2.5)
    supersonic = ca.fmax(subsonic, 1.0)
    for _ in range(10):  # as many fixed-point iterations as JSBSim's
        supersonic = coefficient * ca.sqrt(ratio * (1.0 - 1.0 / (7.0 * supersonic**2)) ** 2.5)
    return ca.if_else(subsonic > 1.0, supersonic, subsonic)


def calibrated_speed(mach: Any, pressure: Any) -> Any:
    """Return the calibrated airspeed at a Mach number, ft/s.

    pressure: static pressure, lb/ft²
    """
    impact = pitot_pressure(mach, pressure) - pressure
    return SEA_LEVEL.sound * mach_of_pitot(impact, SEA_LEVEL_PRESSURE)


def calibrated_airspeed(dynamic_pressure: float, mach: float) -> float:
    """Return the calibrated airspeed, kt, at the static pressure 2 q / (1.4 M²).

    At sea level, this airspeed has the same impact pressure.

    dynamic_pressure: q = ρ V²/2, Pa
    mach: Mach number M
    """
    pressure = 2.0 * dynamic_pressure / (HEAT_RATIO * mach**2) / si_factor("lbf/ft^2")
    return float(calibrated_speed(ca.DM(mach), pressure)) * FOOT / KNOT


def _pressure_ratio(base_temperature: float, lapse: float, climb: Any) -> Any:
    """Return the pressure in a layer of the atmosphere, relative to the pressure at its bottom."""
    if lapse == 0.0:
        return ca.exp(-_GRAVITY * climb / (_GAS_CONSTANT * base_temperature))
    return (base_temperature / (base_temperature + lapse * climb)) ** (
        _GRAVITY / (_GAS_CONSTANT * lapse)
    )


SEA_LEVEL = Air(*(float(value) for value in vars(air_at(ca.DM(0.0), "english")).values()))
