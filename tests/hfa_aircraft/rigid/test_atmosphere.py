"""Standard air of rigid aircraft in both systems of units, compared with the package `ambiance`."""

from __future__ import annotations

import numpy as np
import pytest
from ambiance import Atmosphere

from hfa_aircraft.rigid.atmosphere import ALTITUDES, air_at

FOOT = 0.3048
#: Unit of temperature, pressure, density and speed of sound in SI units: of english and of si.
UNITS = {"english": (1.0 / 1.8, 47.880259, 515.378818, FOOT), "si": (1.0, 1.0, 1.0, 1.0)}


@pytest.mark.parametrize("system", UNITS)
def test_the_air_agrees_with_ambiance(system: str) -> None:
    """From the lowest to the highest altitude, in all layers, the air agrees within 2e-5."""
    for height in np.linspace(*ALTITUDES, 200):
        expected = Atmosphere(height * FOOT)
        air = air_at(float(height if system == "english" else height * FOOT), system)
        found = np.array([float(value) for value in vars(air).values()]) * UNITS[system]
        names = ("temperature", "pressure", "density", "speed_of_sound")
        exact = np.ravel([getattr(expected, name) for name in names])
        np.testing.assert_allclose(found, exact, rtol=2e-5, err_msg=f"{height} ft")
