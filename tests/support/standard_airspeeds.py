"""Airspeeds in the air of the package `ambiance`; a temperature deviation leaves the pressure unchanged."""

import math
from typing import NamedTuple

from ambiance import Atmosphere

_GAS, _SOUND0, _PRESSURE0, _DENSITY0 = 287.05287, 340.294, 101325.0, 1.225
KNOT = 1852.0 / 3600.0


class Air(NamedTuple):
    """Density, kg/m³, speed of sound, m/s, and pressure, Pa."""

    density: float
    sound: float
    pressure: float


def air(altitude, warmer=0.0):
    """Return the air at an altitude, m, warmer by some K than the standard."""
    there = Atmosphere(altitude)
    pressure, warmth = float(there.pressure[0]), float(there.temperature[0]) + warmer
    return Air(pressure / (_GAS * warmth), math.sqrt(1.4 * _GAS * warmth), pressure)


def calibrated(speed, at):
    """Return the calibrated airspeed, kt, of subsonic flow at a true airspeed, m/s."""
    impact = at.pressure * ((1.0 + 0.2 * (speed / at.sound) ** 2) ** 3.5 - 1.0)
    mach = math.sqrt(5.0 * ((impact / _PRESSURE0 + 1.0) ** (2.0 / 7.0) - 1.0))
    return mach * _SOUND0 / KNOT


def equivalent(speed, at):
    """Return the equivalent airspeed, kt."""
    return speed * math.sqrt(at.density / _DENSITY0) / KNOT
