"""Flights of linear loops against their exponentials: states, cost, departure, integration error."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.linalg import expm, solve_continuous_lyapunov
from scipy.optimize import brentq

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


@pytest.mark.parametrize("K", [np.zeros((1, 2)), np.array([[1.0, 0.8]])], ids=["free", "closed"])
def test_a_loop_follows_its_exponential_and_has_its_cost(K: np.ndarray) -> None:
    """u = -K z gives the exact states, also after a tick of the scenario.

    The cost with Q and R is x0'X x0 - x'X x with the Lyapunov equation of the loop.
    """
    Q, R = np.diag([2.0, 0.5]), np.array([[3.0]])
    policy = K if K.any() else None
    flight = hfa.fly(LOOP, hfa.trim(LOOP), policy, 4.0, initial={"a": 0.9}, weights=(Q, R))
    every = round(flight.scenario["tick"] / flight.step)
    loop = A - B @ K
    states = [expm(loop * t) @ START for t in flight.time[::every]]
    np.testing.assert_allclose(flight.states[::every], states, atol=1e-8)
    X = solve_continuous_lyapunov(loop.T, -(Q + K.T @ R @ K))
    end = flight.states[-1]
    assert flight.cost == pytest.approx(START @ X @ START - end @ X @ end, rel=1e-8)


@pytest.mark.parametrize(("start", "limit"), [(2.9, -1.0), (0.9, -0.5)])
def test_a_flight_ends_below_a_lower_limit(start: float, limit: float) -> None:
    """The departure is dated to the step in which the exponential passes the limit."""
    flight = hfa.fly(
        LOOP, hfa.trim(LOOP), None, 4.0, initial={"a": start}, envelope={"a": (limit, 3.0)}
    )
    passed = brentq(lambda t: (expm(A * t) @ [start, 0.0])[0] - limit, 0.1, 1.4)
    assert flight.departure.state == "a"
    assert flight.departure.limit == limit
    assert passed <= flight.departure.time + 1e-9
    assert flight.departure.time <= passed + flight.step + 1e-9
    assert not flight.ok


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


@pytest.mark.slow
def test_an_assessment_finds_departures_below_a_lower_limit(folder: Path) -> None:
    """x' = x / 2 without control leaves its narrow lower limit first, at 2 ln(1 / |x0|)."""
    growing = Model(
        "growing",
        {"a": Signal(min=-1.0, max=50.0), "b": Signal(min=-50.0, max=50.0)},
        {"u": Signal(min=-9.0, max=9.0)},
        lambda x, u, p, w: ({"a": 0.5 * x.a + u.u, "b": -x.b}, {}),
        trim={"a": 0.0, "b": 0.0},
    )
    np.savez("policy.npz", **{"0.weight": np.zeros((1, 2)), "0.bias": np.zeros(1)})
    Path("policy.toml").write_text(
        '[policy]\nfile = "policy.npz"\n[observation]\na = {}\nb = {}\n[timing]\ndt = 0.1\n'
        '[action]\nu = {box = [-9.0, 9.0], map = "trim + a"}\n'
    )
    found = hfa.assess(growing, "policy.toml", samples=6, box={"a": 0.5, "b": 0.1})
    flights = found.to_dict()["points"][0]["flights"]
    assert flights["left_envelope"] == 6
    assert (flights["departure"]["state"], flights["departure"]["limit"]) == ("a", -1.0)
    passed = 2.0 * np.log(1.0 / abs(flights["worst_initial"]["a"]))
    assert passed <= flights["departure"]["time"] <= passed + 0.1
