"""Density and speed of sound of the US Standard Atmosphere 1976, for CasADi.

The constants are the standard's: the identified parameters depend on them. Those of
`hfa_aircraft.rigid.atmosphere` are JSBSim's, which differ by up to 2e-5.
"""

from __future__ import annotations

from typing import NamedTuple

import casadi as ca

from hfa_aircraft.rigid.atmosphere import HEAT_RATIO
from hfa_model.parameters import HIGHEST_ALTITUDE, Quantity
from hfa_support.errors import BadInputError
from hfa_support.units import EARTH_RADIUS, FOOT, STANDARD_GRAVITY

# U.S. Standard Atmosphere, 1976, Tables 2-4 (SI, as defined there).
_GAS_CONSTANT = 8314.32 / 28.9644  # J/(kg K)
_SEA_LEVEL_TEMPERATURE = 288.15  # K
_SEA_LEVEL_PRESSURE = 101_325.0  # Pa
_LAPSE_RATE = 0.0065  # K/m, below the tropopause
_TROPOPAUSE = 11_000.0  # m, geopotential

#: lb g / ft with the exact pound, foot and standard gravity.
_KILOGRAM_PER_SLUG = 14.593902937206364


class Air(NamedTuple):
    """Air at an altitude.

    density: ρ, slug/ft^3
    sound: speed of sound, ft/s
    """

    density: Quantity
    sound: Quantity


def air_at(altitude: Quantity) -> Air:
    """Return the air at a geometric altitude h.

    ρ = p / (R T) and the speed of sound sqrt(1.4 R T), with the pressure p, the gas constant R of
    air and the temperature T = T_0 - λ min(H, 11 km) at the geopotential altitude H = r h / (r + h)
    over an earth of radius r.

    altitude: h, ft, 0 to `HIGHEST_ALTITUDE`; a number or a CasADi expression

    Raises BadInputError for a number outside this range. Source: U.S. Standard Atmosphere, 1976,
    Eqs. 18, 23, 33a, 33b, 42, 50.
    """
    if not isinstance(altitude, (ca.SX, ca.MX)):
        refuse_beyond_the_atmosphere(altitude)
    height = altitude * FOOT
    geopotential = EARTH_RADIUS * height / (EARTH_RADIUS + height)
    kelvin = _SEA_LEVEL_TEMPERATURE - _LAPSE_RATE * ca.fmin(geopotential, _TROPOPAUSE)
    above = ca.fmax(geopotential - _TROPOPAUSE, 0.0)
    exponent = STANDARD_GRAVITY / (_GAS_CONSTANT * _LAPSE_RATE)
    pressure = (
        _SEA_LEVEL_PRESSURE
        * (kelvin / _SEA_LEVEL_TEMPERATURE) ** exponent
        * ca.exp(-STANDARD_GRAVITY * above / (_GAS_CONSTANT * kelvin))
    )
    return Air(
        density=pressure / (_GAS_CONSTANT * kelvin) * FOOT**3 / _KILOGRAM_PER_SLUG,
        sound=ca.sqrt(HEAT_RATIO * _GAS_CONSTANT * kelvin) / FOOT,
    )


def refuse_beyond_the_atmosphere(altitude: ca.DM | float) -> None:
    """Raise BadInputError if an altitude is not within 0 to `HIGHEST_ALTITUDE`.

    altitude: ft, one number or several
    """
    for height in ca.DM(altitude).full().ravel().tolist():
        if not 0.0 <= height <= HIGHEST_ALTITUDE:
            raise BadInputError(
                f"altitude is {height:g} ft; give an altitude from 0 to {HIGHEST_ALTITUDE:g} ft"
            )
