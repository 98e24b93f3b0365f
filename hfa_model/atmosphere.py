"""Air density of the US Standard Atmosphere 1976 as a CasADi expression."""

from __future__ import annotations

import casadi as ca

from hfa_model.vectors import Quantity

#: The highest altitude that the two layers below cover, ft (the 20 km geopotential limit lies at 65,824 ft).
HIGHEST_ALTITUDE = 65_000.0

# U.S. Standard Atmosphere, 1976, Tables 2-4 (SI, as defined there).
_EARTH_RADIUS = 6_356_766.0  # m
_GRAVITY = 9.80665  # m/s^2
_GAS_CONSTANT = 8314.32 / 28.9644  # J/(kg K)
_SEA_LEVEL_TEMPERATURE = 288.15  # K
_SEA_LEVEL_PRESSURE = 101_325.0  # Pa
_LAPSE_RATE = 0.0065  # K/m, below the tropopause
_TROPOPAUSE = 11_000.0  # m, geopotential

_METRE_PER_FOOT = 0.3048
_KILOGRAM_PER_SLUG = 14.593902937206364


def density(altitude: Quantity) -> Quantity:
    """ρ(h) = p(H) / (R T(H)) with the geopotential altitude H = r h / (r + h).

    altitude: geometric, ft, 0 to `HIGHEST_ALTITUDE`; a number or a CasADi expression.
    Returns the density in slug/ft^3. Source: U.S. Standard Atmosphere, 1976, Eqs. 18, 23, 33a, 33b, 42.
    """
    height = altitude * _METRE_PER_FOOT
    geopotential = _EARTH_RADIUS * height / (_EARTH_RADIUS + height)
    below = ca.fmin(geopotential, _TROPOPAUSE)
    above = ca.fmax(geopotential - _TROPOPAUSE, 0.0)
    temperature = _SEA_LEVEL_TEMPERATURE - _LAPSE_RATE * below
    exponent = _GRAVITY / (_GAS_CONSTANT * _LAPSE_RATE)
    pressure = (
        _SEA_LEVEL_PRESSURE
        * (temperature / _SEA_LEVEL_TEMPERATURE) ** exponent
        * ca.exp(-_GRAVITY * above / (_GAS_CONSTANT * temperature))
    )
    return pressure / (_GAS_CONSTANT * temperature) * _METRE_PER_FOOT**3 / _KILOGRAM_PER_SLUG
