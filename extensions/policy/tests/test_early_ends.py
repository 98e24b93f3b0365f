"""Flights that end early, compared with flights of the full duration."""

from dataclasses import replace

import casadi as ca
import numpy as np
import pytest
from policy_cases import ROOT, aircraft, flown_samples, stored_deployment, trims

import hfa
from hfa_aircraft.loading import load_model
from hfa_aircraft.march.ending import BALL, Outcome, is_within
from hfa_aircraft.march.march import History, Rows, march
from hfa_flight.envelope import flight_envelope
from hfa_flight.policies.deployment.deployed import Deployed
from hfa_flight.policies.deployment.deployment import Deployment
from hfa_policy.assessor import Assessor
from hfa_policy.flights import SampledRows
from hfa_policy.outcomes import (
    HORIZON,
    PUSHED,
    PlacedFlights,
    measured_cycle,
    placed_flights,
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
    flown = placed_flights(flight, places, STARTS, 77)
    samples = flight.compiled(len(flown.owners), HORIZON)
    flown.fly(HORIZON, samples)
    ends = flown.endings.outcomes
    is_back, is_lost = ends == Outcome.CONVERGED, ends == Outcome.LEFT
    is_early = ~is_lost & (flown.times < HORIZON - 0.5)
    assert is_early.sum() > 50
    assert late == 0 or (is_early & ~is_back).any()
    final, _, stayed = _to_the_end(flown, samples)
    assert stayed[is_early].all()
    np.testing.assert_array_equal(final[is_early] <= 1.0, is_back[is_early])


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
    flown = PlacedFlights(flight, [place], np.zeros(40, dtype=int), starts, pushes)
    samples = flight.compiled(40, place.seconds)
    flown.fly(place.seconds, samples)
    returned = flown.endings.outcomes == Outcome.CONVERGED
    is_early = returned & (flown.times < place.seconds - 0.5)
    assert is_early.sum() > 20
    _, farthest, _ = _to_the_end(flown, samples)
    assert (farthest[is_early] <= 1.0).all() == stays


def _to_the_end(flown, samples):
    """Simulate all flights for their full duration. Each result is (N,).

    The function returns the distance from the equilibrium in the last window, the largest distance
    after the flight ended early, and whether the flight then stayed within the limits.
    """
    flight = flown.flight
    window = flight.samples_in_window
    count = len(flown.owners)
    final, farthest, stayed = np.zeros(count), np.zeros(count), np.ones(count, dtype=bool)
    envelopes = [flight_envelope(place.point.model, place.point) for place in flown.places]
    least, most = (np.array([getattr(e, end) for e in envelopes]) for end in ("least", "most"))

    def watched(history):
        final[:] = flown.motion(history).distance
        after = (history.first + window) * flight.dt > flown.times + 0.5
        farthest[after] = np.maximum(farthest, final)[after]
        states = history.states[:, :, flight.slices[0]]
        inside = is_within(states, least[flown.owners, None], most[flown.owners, None])
        stayed[after] &= inside.all(axis=1)[after]
        return np.zeros(history.states.shape[:2], dtype=bool)

    ticks = window * round(flown.seconds / (window * flight.dt))
    loop = SampledRows(samples, flown.first, flown.trims, flown.pushes, PUSHED)
    with np.errstate(all="ignore"):
        march(loop, ticks, over=watched, window=window, keep=False)
    return final, farthest, stayed


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
    trim = flight.deployed.trim_vector(point)
    states = np.array(point.states)
    X = flown_samples(flight, states, trim, 1200)[-1, flight.slices[0]]
    rows = [list(model.states).index(name) for name in model.linear]
    off = (X - place.equilibrium.states)[rows] - place.drift @ (X - states)
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
    deployed = Deployed(stored_deployment("ppo_gtm"), aircraft("ppo_gtm"))
    assessor = Assessor(deployed, trims("ppo_gtm")[:1], samples=0)
    flight = assessor.flight()
    (place,) = assessor.places(flight)
    n = len(place.point.states)
    drift = np.zeros((len(place.box), n))
    drift[0, 1] = 3.0
    place = replace(place, drift=drift, lag=None)
    equilibrium = place.equilibrium.states
    start = equilibrium.copy()
    start[1] += 1e-3 * place.box[1]
    start[0] += 3.0 * (start[1] - place.point.states[1])
    pushes = np.zeros((1, len(place.box)))
    flown = PlacedFlights(flight, [place], np.zeros(1, dtype=int), start[None], pushes)
    still = np.tile(flown.first, (2, 1))[None]
    history = History(flight.dt, 0, still, np.zeros((1, 1, 0)), np.zeros(1, dtype=int))
    distance, swings = flown.motion(history)
    assert distance[0] == pytest.approx(1e-3 / BALL, rel=1e-6)
    np.testing.assert_array_equal(swings, 0.0)


def test_a_flight_that_overflows_has_no_limit_cycle():
    deployed = Deployed(stored_deployment("ppo_gtm"), aircraft("ppo_gtm"))
    (point,) = trims("ppo_gtm")[:1]
    flight = Assessor(deployed, (point,), samples=0).flight()
    overflows = Rows(lambda x, _: 1e5 * x, np.full((1, 6), 1e300), 0.02)
    assert measured_cycle(flight, overflows, point) is None
