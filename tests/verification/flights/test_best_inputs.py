"""The gust that the best inputs stand: flown again by Runge-Kutta it stays inside, and other inputs do not."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest
from known_models import model_at

from controller import OneMinusCosine, flight_envelope
from controller.flight.plants import NonlinearPlant
from hfa_model import INPUTS, STATES, Aircraft
from verification.flights import best_inputs as module
from verification.flights.best_inputs import STEP, best_inputs

NAMES, LENGTH, BANDWIDTH, FINER = ("aileron_outer", "elevator_center"), 400.0, 2.0, 20


def flown_again(plant: NonlinearPlant, peak: float, commands: np.ndarray) -> np.ndarray:
    """States, absolute, by Runge-Kutta steps of 5 ms under the same commands."""
    rows = [INPUTS.index(name) for name in NAMES]
    trim = np.array(plant.point.inputs)[rows]
    gust = OneMinusCosine(LENGTH, peak, plant.point.states.speed)
    x, c, t = ca.SX.sym("x", 9), ca.SX.sym("c", 2), ca.SX.sym("t")
    u = ca.SX.zeros(5)
    u[rows] = x[7:]
    w = gust.updraft(t, None, None)
    f = ca.Function("f", [x, c, t], [ca.vertcat(plant.rate(x[:7], u, ca.SX.zeros(6), w), BANDWIDTH * (c - x[7:]))])
    h, path = STEP / FINER, [np.zeros(9)]
    for k in range(FINER * len(commands)):
        held, now = commands[k // FINER] - trim, path[-1]
        a = f(now, held, k * h)
        b = f(now + h / 2 * a, held, (k + 0.5) * h)
        d = f(now + h / 2 * b, held, (k + 0.5) * h)
        path.append(np.array(now + h / 6 * (a + 2 * b + 2 * d + f(now + h * d, held, (k + 1) * h))).ravel())
    return np.array(path)[:, :7] + np.array(plant.point.states)


@pytest.mark.slow
@pytest.mark.parametrize("dynamics", ["published", "newton"])
@pytest.mark.parametrize("degrees", [5.0, 15.0])
@pytest.mark.parametrize(("sign", "at_least"), [(1.0, 160.0), (-1.0, 110.0)])
def test_gusts_far_beyond_those_of_any_servo_can_be_stood(
    dynamics: str, degrees: float, sign: float, at_least: float
) -> None:
    """Neither stall nor the envelope is what ends a servo in a gust of 400 ft: of 35 up and 20 ft/s down."""
    aircraft = Aircraft(dynamics=dynamics)
    point = model_at(degrees, dynamics).point
    plant, envelope = NonlinearPlant(aircraft, point), flight_envelope(aircraft.parameters, point)
    found = best_inputs(plant, envelope, NAMES, LENGTH, sign, BANDWIDTH)
    assert sign * found.peak > at_least
    again = flown_again(plant, found.peak, found.commands)
    gust = OneMinusCosine(LENGTH, found.peak, point.states.speed)
    w = np.array([gust.updraft(STEP / FINER * k, None, None) for k in range(len(again))], dtype=float)
    assert envelope.inside(again, w).all()
    still = flown_again(plant, found.peak, np.tile(np.array([getattr(point.inputs, name) for name in NAMES]), (50, 1)))
    assert not envelope.inside(still).all()


def test_a_shorter_look_is_the_same_problem(published_aircraft: Aircraft, monkeypatch: pytest.MonkeyPatch) -> None:
    """Back at trim after 10 s, in a coarse grid: the path obeys the equations and the limits of the commands."""
    monkeypatch.setattr(module, "SECONDS", 10.0)
    point = model_at(11.0).point
    plant = NonlinearPlant(published_aircraft, point)
    envelope = flight_envelope(published_aircraft.parameters, point)
    found = best_inputs(plant, envelope, NAMES, LENGTH, -1.0, BANDWIDTH)
    assert found.peak < -20.0
    assert np.abs(np.degrees(found.commands[:, 0])).max() < 20.0
    assert envelope.inside(found.states[[0, -1]]).all()
    again = flown_again(plant, found.peak, found.commands)[::FINER]
    names = ("speed", "pitch", "dihedral")
    columns = [STATES.index(name) for name in names]
    np.testing.assert_allclose(again[:, columns], found.states[:, columns], rtol=0.02, atol=0.05)
