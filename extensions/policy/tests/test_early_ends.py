"""Flights that end early, compared with flights of the full duration."""

from dataclasses import replace
from types import SimpleNamespace

import casadi as ca
import numpy as np
import pytest
from policy_cases import ROOT, aircraft, gtm_deployment, stored_deployment, trims

import hfa
from hfa_aircraft.loading import load_model
from hfa_flight.policies.deployment.deployed import Deployed
from hfa_flight.policies.deployment.deployment import Deployment
from hfa_flight.policies.deployment.equilibrium import EquilibriumSearch
from hfa_policy.assessment import Assessor
from hfa_policy.outcomes import (
    _LOST,
    _RETURNED,
    HORIZON,
    SimulatedRows,
    measured_cycle,
    seeded_starts,
)
from hfa_policy.trims import trims_of

STARTS = 100


@pytest.mark.slow
@pytest.mark.parametrize("late", [0, 2])
@pytest.mark.parametrize("name", ["td3_gtm", "ppo_raw"])
def test_flights_that_end_early_are_classified_correctly(name, late):
    """Flights that end early stay within the limits if they are continued to their full duration.

    Of these, exactly the flights that counted as converged end in the ball about the equilibrium.
    """
    dt = stored_deployment(name).dt
    deployment = stored_deployment(name).changed(timing={"dt": dt, "delay": late * dt})
    assessor = Assessor(Deployed(deployment, aircraft(name)), trims(name), STARTS, seed=77)
    flight = assessor.flight()
    places = assessor.places(flight)
    rows = []
    for place in places:
        starts, pushes = seeded_starts(place, STARTS, 77, pushed=True)
        trim = flight.deployed.trim_vector(place.point)
        rows.append(flight.rows(starts, np.tile(trim, (STARTS, 1)), pushes))
    owners = np.repeat(np.arange(len(places)), STARTS)
    flown = SimulatedRows(flight, places, np.vstack(rows), owners)
    window = flight.window(len(owners), HORIZON)
    flown.fly(HORIZON, window)
    is_back, is_lost = flown.status == _RETURNED, flown.status == _LOST
    is_early = ~is_lost & (flown.times < HORIZON - 0.5)
    assert is_early.sum() > 50
    assert late == 0 or (is_early & ~is_back).any()

    after, farthest = _continued(flown, window, is_early)
    assert (farthest[1] >= flown.least[is_early]).all()
    assert (farthest[2] <= flown.most[is_early]).all()
    distance = _distance(flown, after, is_early)
    np.testing.assert_array_equal(distance <= 1.0, is_back[is_early])


@pytest.mark.slow
@pytest.mark.parametrize("stays", [True, False])
def test_a_flight_that_has_converged_stays(stays):
    """A flight that counts as converged stays in the convergence ball.

    Without the wait of half the slowest period, at least one flight leaves the ball. The example is
    the phugoid of a small aircraft with a weak gain.
    """
    model = load_model(f"{ROOT}/examples/uav.toml")
    o = ca.SX.sym("o", 2)
    weak = ca.vertcat(0.002 * o[0], -0.05 * o[1])
    deployment = Deployment(
        policy={"file": ca.Function("gain", [o], [weak])},
        observation={"pitch": {}, "roll": {}},
        action={"elevator": {}, "aileron": {}},
        timing={"dt": 0.1},
    )
    assessor = Assessor(Deployed(deployment, model), trims_of(model, None), 40)
    flight = assessor.flight()
    (place,) = assessor.places(flight)
    assert place.decisive.all()
    if not stays:
        place = replace(place, swing=0.0)
    starts, pushes = seeded_starts(place, 40, 1, pushed=True)
    trim = flight.deployed.trim_vector(place.point)
    rows = flight.rows(starts, np.tile(trim, (40, 1)), pushes)
    flown = SimulatedRows(flight, [place], rows, np.zeros(40, dtype=int))
    window = flight.window(40, place.seconds)
    flown.fly(place.seconds, window)
    is_early = (flown.status == _RETURNED) & (flown.times < place.seconds - 0.5)
    assert is_early.sum() > 20
    _, farthest = _continued(flown, window, is_early, place.seconds)
    assert (farthest[0] <= 1.0).all() == stays


def test_the_equilibrium_follows_the_altitude():
    """The derivative of the equilibrium with respect to altitude equals a finite difference.

    The difference is between equilibria 100 m apart.
    """
    model = load_model(f"{ROOT}/examples/uav.toml")
    deployment = gtm_deployment({"file": ca.Function("none", [ca.SX(4, 1)], [ca.SX(2, 1)])})
    deployment = deployment.changed(action={"elevator": {}, "rudder": {}})
    (point,) = trims_of(model, None)
    search = EquilibriumSearch(Deployed(deployment, model), point)
    states, inputs = np.array(point.states), np.array(point.inputs)
    slopes = search.drift(search.from_point(states, inputs))
    altitude = list(model.states).index("altitude")
    ends = []
    for step in (-50.0, 50.0):
        search.base[altitude] = states[altitude] + step
        ends.append(search.from_point(states, inputs).states[search.rows])
    expected = (ends[1] - ends[0]) / 100.0
    assert abs(expected[0]) > 1e-4
    np.testing.assert_allclose(slopes[:, altitude], expected, rtol=1e-3, atol=1e-9)


def _continued(flown, window, chosen, seconds=HORIZON):
    """Simulate the chosen flights to the end of their full duration, and return their final rows.

    For each flight, the function also returns the largest distance from the equilibrium, in
    half-widths of the convergence ball, and the lowest and highest absolute state X.
    """
    X, _, low, high, *_ = flown.flight.slices
    rows, times = flown.rows.copy(), flown.times.copy()
    farthest = np.zeros(len(rows))
    lowest, highest = rows[:, X].copy(), rows[:, X].copy()
    while (flying := np.flatnonzero(chosen & (times < seconds - 0.5))).size:
        going = rows[flying]
        flown.flight.forget_extremes(going)
        rows[flying] = window(going)
        times[flying] += flown.flight.samples_in_window * flown.flight.dt
        distance = _distance(flown, rows[flying], flying)
        farthest[flying] = np.maximum(farthest[flying], distance)
        lowest[flying] = np.minimum(lowest[flying], rows[flying][:, low])
        highest[flying] = np.maximum(highest[flying], rows[flying][:, high])
    return rows[chosen], (farthest[chosen], lowest[chosen], highest[chosen])


def _distance(flown, rows, chosen):
    """Return the largest distance of flights from the equilibrium in the last window.

    The unit is the half-widths of the convergence ball.
    """
    X, _, low, high, *_ = flown.flight.slices
    moved = rows[:, X] - flown.trims[chosen]
    centres = flown.centres[chosen] + np.einsum("nij,nj->ni", flown.drifts[chosen], moved)
    above = rows[:, high][:, flown.linear] - centres
    below = centres - rows[:, low][:, flown.linear]
    distance = np.maximum(above, below) / flown.balls[chosen]
    return np.where(flown.decisive[chosen], distance, 0.0).max(axis=1)


@pytest.mark.slow
def test_states_lag_behind_a_moving_equilibrium():
    """In a climb, the speed lags behind its changing equilibrium by the predicted amount, to 10
    %.
    """
    model = load_model(f"{ROOT}/examples/uav.toml")
    point = hfa.trim(model, hold={"gamma": np.radians(1.0)})
    o = ca.SX.sym("o", 2)
    deployment = Deployment(
        policy={"file": ca.Function("gain", [o], [ca.vertcat(0.5 * o[0], -0.05 * o[1])])},
        observation={"pitch": {}, "roll": {}},
        action={"elevator": {}, "aileron": {}},
        timing={"dt": 0.1},
    )
    assessor = Assessor(Deployed(deployment, model), (point,), 1)
    flight = assessor.flight()
    (place,) = assessor.places(flight)
    trim = flight.deployed.trim_vector(point)[None]
    states = np.array(point.states)[None]
    row = flight.rows(states, trim, np.zeros((1, len(model.linear))))
    window = flight.window(1, 120.0)
    for _ in range(120):
        row = window(row)
    X = row[0, flight.slices[0]]
    rows = [list(model.states).index(name) for name in model.linear]
    off = (X - place.equilibrium.states)[rows] - place.drift @ (X - states[0])
    assert abs(place.lag[0]) > 1e-3
    assert off[0] == pytest.approx(place.lag[0], rel=0.1)


def test_a_flight_that_departs_again_has_not_converged():
    """A flight that leaves the convergence ball again does not count as converged.

    The flight leaves the ball through a mode that no action affects. For y' = .02 y and x' = -x + u
    + .02 y² with u = -x, the final state is x = .02 y² / 2.04. A flight counts as converged if this
    x is inside the ball.
    """
    signal = hfa.Signal(nominal=1.0, min=-50.0, max=50.0)
    model = hfa.Model(
        "two",
        {"x": signal, "y": signal},
        {"u": signal},
        lambda x, u, p, w: ({"x": -x.x + u.u + 0.02 * x.y**2, "y": 0.02 * x.y}, {}),
    )
    point = hfa.trim(model, hold={"y": 0.0, "u": 0.0}, free=("x",))
    o = ca.SX.sym("o")
    deployment = Deployment(
        policy={"file": ca.Function("gain", [o], [-o])},
        observation={"x": {}},
        action={"u": {}},
        timing={"dt": 0.1},
    )
    (found,) = Assessor(
        Deployed(deployment, model), (point,), 20, 0, {"x": 1.0, "y": 1.0}
    ).assessed()
    starts, _ = seeded_starts(found.place, 20, 0, False)
    at_end = 0.02 / 2.04 * (starts[:, 1] * np.exp(0.02 * found.place.seconds)) ** 2
    assert found.flights.returned == (at_end <= 0.05).sum() < 20


def test_a_flight_on_the_moved_equilibrium_is_at_distance_0():
    """The equilibrium moves by drift · (X - trim). The opposite sign would give a distance."""
    flown = SimpleNamespace(
        flight=SimpleNamespace(slices=(slice(0, 2), slice(2, 2), slice(2, 4), slice(4, 6))),
        linear=[0],
        trims=np.array([[1.0, 100.0]]),
        centres=np.array([[1.0]]),
        drifts=np.array([[[0.0, 0.02]]]),
        balls=np.array([[0.1]]),
        decisive=np.array([[True]]),
        turns=np.array([[0.0]]),
    )
    state = np.array([1.0 + 0.02 * 50.0, 150.0])
    rows = np.concatenate([state, state, state])[None]
    distance, moved = SimulatedRows._in_balls(flown, rows, np.array([0]))
    assert distance == pytest.approx(0.0, abs=1e-12)
    assert moved == pytest.approx(0.0)


def test_a_flight_that_overflows_has_no_limit_cycle():
    row = ca.SX.sym("row", 3)
    flight = SimpleNamespace(
        slices=(slice(0, 2), slice(2, 3)),
        dt=0.02,
        sample=lambda: ca.Function("sample", [row], [1e30 * row]),
    )
    model = SimpleNamespace(inputs=("elevator",), states=("speed", "alpha"))
    place = SimpleNamespace(point=SimpleNamespace(model=model, states=[0.0, 0.0], inputs=[0.0]))
    assert measured_cycle(flight, np.ones(3), place, seconds=2.0) is None
