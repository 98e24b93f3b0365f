"""The linearized aircraft is what the nonlinear one is to first order."""

from __future__ import annotations

import numpy as np
import pytest
from flight_cases import FlownCase, case_at

from controller.flight.plants import LinearizedAircraft, NonlinearPlant
from hfa_model.parameters import Parameters
from hfa_model.vectors import LINEAR_STATES
from trim.linear.linearize import linearize

N = len(LINEAR_STATES)


@pytest.fixture(scope="module", params=["published", "newton"])
def at_15(request: pytest.FixtureRequest, parameters: Parameters) -> FlownCase:
    return case_at(parameters, request.param, 15.0)


def test_the_linearized_aircraft_is_the_derivative_of_the_nonlinear_one(at_15: FlownCase) -> None:
    full = linearize(at_15.aircraft, at_15.point, full=True)
    model = LinearizedAircraft.at(at_15.aircraft, at_15.point)
    np.testing.assert_allclose(model.A, full.A, rtol=1e-13, atol=1e-13)
    np.testing.assert_allclose(model.B, full.B, rtol=1e-13, atol=1e-13)
    plant = NonlinearPlant(at_15.aircraft, at_15.point)
    rise = 1e-3
    up, down = (np.array(plant.rate(np.zeros(7), np.zeros(5), np.zeros(N), w)).ravel() for w in (rise, -rise))
    np.testing.assert_allclose((up - down) / (2 * rise), model.gust, rtol=1e-6, atol=1e-9)
