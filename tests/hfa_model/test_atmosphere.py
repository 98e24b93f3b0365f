"""Density and speed of sound in models, compared with the package `ambiance`."""

import numpy as np
import pytest
from ambiance import Atmosphere
from project import ROOT
from standard_air import density

import hfa
from hfa import BadInputError

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
        (36_200.0, 65_000.0, 3.5e-6),
    ],
)
def test_the_air_of_aircraft_agrees_with_ambiance(lowest, highest, tolerance):
    """Dynamic pressure and Mach number of the flexible aircraft, and of an aircraft from a table, are those
    of the air of `ambiance`. So is the density that tests compute.

    The constants of tables are JSBSim's, which differ by 2e-5.
    """
    altitudes = np.linspace(lowest, highest, 40)
    expected = Atmosphere(altitudes * METRE_PER_FOOT)
    flexible, table = hfa.aircraft(), hfa.load_model(str(ROOT / "examples/cessna182.toml"))
    for model, largest_error in ((flexible, tolerance), (table, 2e-5 + tolerance)):
        states = {name: signal.start for name, signal in model.states.items()} | {"speed": 100.0}
        found = [
            model.outputs_at(
                [*(states | {"altitude": altitude}).values()],
                [signal.start for signal in model.inputs.values()],
                ("dynamic_pressure", "mach"),
            )
            for altitude in altitudes.tolist()
        ]
        densities = np.array([each["dynamic_pressure"] for each in found]) / (0.5 * 100.0**2)
        speeds_of_sound = 100.0 * METRE_PER_FOOT / np.array([each["mach"] for each in found])
        np.testing.assert_allclose(densities * KG_PER_M3, expected.density, rtol=largest_error)
        np.testing.assert_allclose(speeds_of_sound, expected.speed_of_sound, rtol=largest_error)
    own = [float(density(altitude)) * KG_PER_M3 for altitude in altitudes.tolist()]
    np.testing.assert_allclose(own, expected.density, rtol=tolerance)


@pytest.mark.parametrize("altitude", [65_001.0, -1.0, float("nan")])
def test_altitudes_outside_the_layers_are_refused(altitude):
    """An altitude outside 0 to 65,000 ft, or nan, raises BadInputError."""
    model = hfa.aircraft()
    point = hfa.trim(model)
    x = point.states._replace(altitude=altitude)
    with pytest.raises(BadInputError, match="from 0 to 65000 ft"):
        model.outputs_at(x, point.inputs)
