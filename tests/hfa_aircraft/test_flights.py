"""Flights of linear loops against their exponentials: states, cost, departure, integration error."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.linalg import expm, solve_continuous_lyapunov

import hfa
from hfa import Model, Signal
from hfa_flight import Scenario

A = np.array([[0.0, 1.0], [-4.0, -0.2]])
B = np.array([[0.0], [1.0]])
LOOP = Model(
    "loop",
    {"a": Signal(min=-1.0, max=3.0), "b": Signal()},
    {"u": Signal()},
    lambda x, u, p, w: ({"a": x.b, "b": -4.0 * x.a - 0.2 * x.b + u.u}, {}),
    trim={"a": 0.0, "b": 0.0},
)
START = np.array([0.9, 0.0])
pytestmark = pytest.mark.usefixtures("flights")


@pytest.fixture
def flights() -> None:
    pytest.importorskip("hfa_flight")


def test_a_loop_follows_its_exponential_and_has_its_cost() -> None:
    """u = -K z gives the exact states, also after a tick of the scenario.

    The cost with Q and R is x0'X x0 - x'X x with the Lyapunov equation of the loop.
    """
    K, Q, R = np.array([[1.0, 0.8]]), np.diag([2.0, 0.5]), np.array([[3.0]])
    flight = hfa.fly(LOOP, hfa.trim(LOOP), K, 4.0, initial={"a": 0.9}, weights=(Q, R))
    every = round(flight.scenario["tick"] / flight.step)
    loop = A - B @ K
    states = [expm(loop * t) @ START for t in flight.time[::every]]
    np.testing.assert_allclose(flight.states[::every], states, atol=1e-8)
    X = solve_continuous_lyapunov(loop.T, -(Q + K.T @ R @ K))
    end = flight.states[-1]
    assert flight.cost == pytest.approx(START @ X @ START - end @ X @ end, rel=1e-8)


def test_the_stated_change_is_that_with_half_the_step() -> None:
    """A flight of a large swing with steps of 0.2 s, compared with its flight in half steps."""
    swing = Model(
        "swing",
        {"a": Signal(), "b": Signal()},
        {"u": Signal()},
        lambda x, u, p, w: ({"a": x.b, "b": -4.0 * x.a - x.a * x.a * x.a + u.u}, {}),
        trim={"a": 0.0, "b": 0.0},
    )
    point = hfa.trim(swing)

    def flown(step: float) -> hfa.Flight:
        scenario = Scenario(4.0, step=step, tick=0.2, initial=np.array([1.5, 0.0]))
        return hfa.fly(swing, point, None, scenario=scenario)

    coarse = flown(0.2)
    used = coarse.integration.step
    fine = flown(used / 2.0)
    kept = flown(used)
    changes = []
    for name, after in fine.largest_deviation.items():
        changes.append(abs(after - kept.largest_deviation[name]) / after)
    assert used < 0.2
    assert coarse.integration.change == pytest.approx(max(changes), rel=1e-6)
