"""True airspeed from a calibrated airspeed or a Mach number at an altitude."""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache
from typing import Any

import casadi as ca
import numpy as np

from hfa_aircraft.rigid.atmosphere import (
    SEA_LEVEL,
    SEA_LEVEL_PRESSURE,
    air_at,
    mach_of_pitot,
    pitot_pressure,
    subsonic_mach,
)
from hfa_jsbsim.air import KNOT


def speed_and_density(imposed: Mapping[str, Any], altitude: Any) -> tuple[Any, Any]:
    """Return the true airspeed, ft/s, and the air density, slug/ft³.

    The airspeed follows from the first of speed (ft/s), mach and kcas in `imposed`. It is None if
    none of these is imposed.

    imposed: name -> number, or array of a common length
    altitude: ft
    """
    calibrated = imposed.get("kcas", 0.0)
    subsonic, sound, density = _at("subsonic", calibrated, altitude)
    if "speed" in imposed:
        return imposed["speed"], density
    if "mach" in imposed:
        return imposed["mach"] * sound, density
    if "kcas" not in imposed:
        return None, density
    if np.max(subsonic) > 1.0:
        (mach,) = _at("mach", calibrated, altitude)
        return mach * sound, density
    return subsonic * sound, density


@lru_cache
def _functions() -> dict[str, ca.Function]:
    """Return two CasADi functions of (calibrated airspeed in kt, altitude in ft)."""
    # - "subsonic": Mach number if it is below 1, speed of sound, ft/s, and density, slug/ft³
    # - "mach": Mach number, also above 1
    speed = ca.SX.sym("speed")
    altitude = ca.SX.sym("altitude")
    air = air_at(altitude)
    at_sea_level = speed * KNOT / SEA_LEVEL.sound
    ratio = (1.0 + 0.2 * at_sea_level**2) ** 3.5 - 1.0
    subsonic = subsonic_mach(ratio * SEA_LEVEL_PRESSURE / air.pressure + 1.0)
    impact = pitot_pressure(at_sea_level, SEA_LEVEL_PRESSURE) - SEA_LEVEL_PRESSURE
    any_mach = mach_of_pitot(impact, air.pressure)
    return {
        "subsonic": ca.Function("air", [speed, altitude], [subsonic, air.sound, air.density]),
        "mach": ca.Function("mach", [speed, altitude], [any_mach]),
    }


def _at(name: str, speed: Any, altitude: Any) -> list[Any]:
    """Return the values of a function of `_functions`, as numbers or arrays of a common length."""
    speeds, altitudes = np.broadcast_arrays(np.atleast_2d(speed), np.atleast_2d(altitude))
    results = _functions()[name].map(speeds.size).call([speeds, altitudes])
    arrays = [result.full().ravel() for result in results]
    return [float(array[0]) if array.size == 1 else array for array in arrays]
