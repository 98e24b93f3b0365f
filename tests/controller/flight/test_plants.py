"""The linearized aircraft is what the nonlinear one is to first order."""

from __future__ import annotations

import casadi as ca
import numpy as np
from flight_cases import FlownCase

from controller.flight.plants import LinearizedAircraft, NonlinearPlant
from hfa_model import LINEAR_STATES
from trim import linearize

N = len(LINEAR_STATES)


def test_the_linearized_aircraft_is_the_derivative_of_the_nonlinear_one(at_15: FlownCase) -> None:
    full = linearize(at_15.aircraft, at_15.point, full=True)
    model = LinearizedAircraft.at(at_15.aircraft, at_15.point)
    np.testing.assert_allclose(model.A, full.A, rtol=1e-13, atol=1e-13)
    np.testing.assert_allclose(model.B, full.B, rtol=1e-13, atol=1e-13)
    plant = NonlinearPlant(at_15.aircraft, at_15.point)
    rise = 1e-3
    up, down = (np.array(plant.rate(np.zeros(7), np.zeros(5), np.zeros(N), w)).ravel() for w in (rise, -rise))
    np.testing.assert_allclose((up - down) / (2 * rise), model.gust, rtol=1e-6, atol=1e-9)


def test_the_air_at_the_outer_panels_enters_by_its_own_column(at_15: FlownCase) -> None:
    """b w + b_o (w_o - w) is the derivative of the nonlinear rate in both winds."""
    model, plant = LinearizedAircraft.at(at_15.aircraft, at_15.point), NonlinearPlant(at_15.aircraft, at_15.point)
    nothing = (np.zeros(7), np.zeros(5), np.zeros(N))
    for winds in (np.array([1e-3, 0.0]), np.array([0.0, 1e-3]), np.array([1e-3, -2e-3])):
        up, down = (np.array(ca.DM(plant.rate(*nothing, ca.SX(ca.DM(w))))).ravel() for w in (winds, -winds))
        linear = np.array(ca.DM(model.rate(*nothing, winds))).ravel()
        np.testing.assert_allclose((up - down) / 2, linear, rtol=1e-6, atol=1e-11)
        assert np.abs(linear).max() > 1e-7
