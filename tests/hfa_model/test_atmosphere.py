"""Density, temperature and speed of sound, compared with the package `ambiance`."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import casadi as ca
import numpy as np
import pytest
from ambiance import Atmosphere

from hfa import BadInputError
from hfa_aircraft.rigid.atmosphere import air_at
from hfa_model.atmosphere import HIGHEST_ALTITUDE, density, speed_of_sound, temperature

METRE_PER_FOOT = 0.3048
KG_PER_M3 = 14.593902937206364 / METRE_PER_FOOT**3  # kg/m^3 per slug/ft^3


@pytest.mark.parametrize(
    ("lowest", "highest", "tolerance"),
    [
        # ambiance uses ICAO's molar mass of air, 28.96442; the standard of 1976 has 28.9644 (7e-7
        # less).
        (0.0, 36_000.0, 1e-6),
        # ambiance begins the upper layer at the tabulated 22632.0 Pa instead of 22632.06 Pa (2.8e-6
        # less).
        (36_200.0, HIGHEST_ALTITUDE, 3.5e-6),
    ],
)
def test_the_atmosphere_agrees_with_ambiance(
    lowest: float, highest: float, tolerance: float
) -> None:
    """Density, temperature and speed of sound agree with the package `ambiance`."""
    altitudes = np.linspace(lowest, highest, 400)
    expected = Atmosphere(altitudes * METRE_PER_FOOT)
    thick, kelvin, sound = np.array(
        [(density(h), temperature(h), speed_of_sound(h)) for h in altitudes.tolist()]
    ).T
    np.testing.assert_allclose(thick * KG_PER_M3, expected.density, rtol=tolerance)
    np.testing.assert_allclose(kelvin, expected.temperature, rtol=1e-9)
    np.testing.assert_allclose(
        sound * METRE_PER_FOOT, expected.speed_of_sound, rtol=1e-6
    )  # square root of the molar mass
    rigid = [float(air_at(height).density) for height in altitudes.tolist()]
    np.testing.assert_allclose(thick, rigid, rtol=2e-5)


@pytest.mark.parametrize("quantity", [density, temperature, speed_of_sound])
@pytest.mark.parametrize(
    "altitude", [65_001, np.float64(-1.0), np.array([0.0, 7e4]), ca.DM([1e5]), float("nan")]
)
def test_altitudes_outside_the_layers_are_refused(
    quantity: Callable[[Any], Any], altitude: Any
) -> None:
    """An altitude outside 0 to 65,000 ft raises BadInputError."""
    with pytest.raises(BadInputError, match="give an altitude from 0 to 65000 ft"):
        quantity(altitude)
