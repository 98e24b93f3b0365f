"""Equilibria of a policy on a linear aircraft, compared with their closed forms."""

import casadi as ca
import numpy as np
import pytest

import hfa
from hfa_aircraft.march.ending import BALL
from hfa_aircraft.march.march import History
from hfa_flight.envelope import Departure
from hfa_flight.policies.deployment.deployed import Deployed
from hfa_flight.policies.deployment.equilibrium import EquilibriumSearch, whole_turns
from hfa_policy.flight_costs import Ratios
from hfa_policy.flights import SampledFlight
from hfa_policy.outcomes import PUSHED, Place, PlacedFlights, departure_text, seeded_starts
from hfa_policy.reach import HORIZON, LONGEST, seconds_to_converge

A = np.array([[-2.0, 0.1], [-10.0, -0.5]])
B = np.array([[3.0, 0.0], [0.0, 20.0]])
K = np.array([[0.4, 0.01], [-0.2, 0.05]])
OFFSET = np.array([0.01, -0.03])
#: Effects of the altitude on the rates of alpha and speed, 1/ft.
ALTITUDE = np.array([1e-3, -2e-2])
START = {"alpha": 0.1, "speed": 100.0, "altitude": 1000.0}


def glide(x, u, p, w):
    z = [x.alpha - 0.1, x.speed - 100.0]
    v = [u.elevator - 0.05, u.throttle - 0.5]
    h = x.altitude - 1000.0
    rates = [
        sum(a * each for a, each in zip(A[row], z, strict=True))
        + sum(b * each for b, each in zip(B[row], v, strict=True))
        + ALTITUDE[row] * h
        for row in range(2)
    ]
    return {"alpha": rates[0], "speed": rates[1], "altitude": 50.0 * z[0]}, {}


GLIDER = hfa.Model(
    "glider",
    {
        "alpha": hfa.Signal("rad", nominal=0.2, min=-0.5, max=0.7),
        "speed": hfa.Signal("ft/s", nominal=100.0, min=10.0, max=300.0),
        "altitude": hfa.Signal("ft", nominal=1000.0),
    },
    {
        "elevator": hfa.Signal("rad", nominal=0.1, min=-0.2, max=0.3),
        "throttle": hfa.Signal("1", nominal=0.5, min=0.0, max=1.0),
    },
    glide,
    trim=START,
    linear=("alpha", "speed"),
)
POINT = hfa.trim(GLIDER)


def search_of(policy, observed=("alpha", "speed"), action=None, **settings):
    """Return the search with a policy of the observed deviations from the trim."""
    o = ca.SX.sym("o", len(observed))
    deployment = hfa.Deployment(
        policy={"file": ca.Function("policy", [o], [policy(o)]), **settings},
        observation={name: {} for name in observed},
        action=action or {"elevator": {}, "throttle": {}},
        timing={"dt": 0.02},
    )
    return EquilibriumSearch(Deployed(deployment, GLIDER), POINT)


def found_from_trim(search):
    return search.from_point(np.array(POINT.states), np.array(POINT.inputs))


def offset_gain(o):
    return ca.DM(OFFSET) - ca.DM(K) @ o[:2]


def test_the_equilibrium_balances_the_offset_of_the_policy():
    """x = -(A - B K)^-1 B c, u = c - K x, with the slopes of aircraft and policy."""
    found = found_from_trim(search_of(offset_gain))
    x = -np.linalg.solve(A - B @ K, B @ OFFSET)
    np.testing.assert_allclose(found.states - POINT.states, [*x, 0.0], atol=1e-9)
    np.testing.assert_allclose(found.inputs - POINT.inputs, OFFSET - K @ x, atol=1e-9)
    for name, value in (("A", A), ("B", B), ("K", K), ("C", np.eye(2)), ("gain", K)):
        np.testing.assert_allclose(getattr(found, name), value, atol=1e-9, err_msg=name)
    assert not found.K_inputs.any()
    assert (found.clips, found.kinks, found.frames, found.clipped_observations) == ((),) * 2 + (
        None,
        (),
    )
    at_trim = search_of(offset_gain).at_trim()
    np.testing.assert_array_equal(at_trim.states, POINT.states)
    basis = np.array([[2.0, 1.0], [0.0, 4.0]])
    inverse = np.linalg.inv(basis)
    turned = found.in_basis(basis, inverse)
    np.testing.assert_allclose(turned.A, inverse @ A @ basis, atol=1e-9)
    np.testing.assert_allclose(turned.B, inverse @ B, atol=1e-9)
    np.testing.assert_allclose(turned.K, K @ basis, atol=1e-9)
    np.testing.assert_allclose(turned.C, basis, atol=1e-9)


def test_the_equilibrium_drifts_with_the_altitude_and_lags_behind():
    """0 = (A - B K) dx/dh + a; in a climb h', (A - B K) lag = dx/dh h'."""
    search = search_of(offset_gain)
    found = found_from_trim(search)
    closed = A - B @ K
    by_altitude = -np.linalg.solve(closed, ALTITUDE)
    drift = search.drift(found)
    np.testing.assert_allclose(drift[:, 2], by_altitude, rtol=1e-9)
    assert not drift[:, :2].any()
    climb = 50.0 * (found.states[0] - 0.1)
    lag = search.lag(found, drift)
    np.testing.assert_allclose(lag, np.linalg.solve(closed, by_altitude * climb), rtol=1e-6)


def test_motion_is_measured_from_the_moving_equilibrium():
    """In balls about x + lag + dx/dh h: the farther end of a window, and half its range.

    A state that does not decide is not counted, and a flight of numbers that are none is far.
    """
    search = search_of(offset_gain)
    found = found_from_trim(search)
    box = np.array([0.2, 10.0])
    drift = search.drift(found)
    lag = np.array([0.01, -0.5])
    place = Place(POINT, box, found, stable=True, drift=drift, lag=lag)
    flight = SampledFlight(search.deployed, 0.02, 0.0, 1)
    starts = np.tile(np.array(POINT.states), (3, 1))
    flown = PlacedFlights(flight, [place], np.zeros(3, dtype=int), starts, np.zeros((3, 2)))
    assert flown._centres == pytest.approx(np.tile(found.states[:2] + lag, (3, 1)))
    states = np.tile(flown.first[:, None], (1, 4, 1))
    states[:, -1, 2] += 30.0
    centre = found.states[:2] + lag + 30.0 * drift[:, 2]
    states[0, :, :2] = centre + np.outer([0.03, -0.01, 0.0, 0.02], [1.0, 10.0])
    states[1, :, :2] = centre + np.outer([-0.04, 0.01, 0.0, 0.02], [1.0, 100.0])
    states[2, :, 0] = np.nan
    motion = flown.motion(History(0.02, 0, states, states[:, :, :0], np.arange(3)))
    ball = BALL * box
    assert motion.distance[:2] == pytest.approx([0.03 / ball[0], 4.0 / ball[1]])
    assert np.isinf(motion.distance[2])
    np.testing.assert_allclose(motion.swings[0], [0.02, 0.2] / ball)
    np.testing.assert_allclose(motion.swings[1], [0.03, 3.0] / ball)
    np.testing.assert_allclose(flown.swings[1], [0.03, 3.0])


def test_initial_conditions_and_pulses_fill_the_box():
    """A pulse of 1 s would move a state by half a box; the altitude stays."""
    place = Place(POINT, np.array([0.2, 10.0]), None, stable=False)
    starts, pushes = seeded_starts(place, 500, 1, pushed=True)
    off = starts - POINT.states
    assert not off[:, 2].any()
    for values, most in ((off[:, :2], place.box), (pushes, 0.5 * place.box / PUSHED)):
        assert (np.abs(values).max(axis=0) <= most).all()
        assert (values.max(axis=0) > 0.95 * most).all()
        assert (values.min(axis=0) < -0.95 * most).all()
    again, none = seeded_starts(place, 500, 1, pushed=False)
    np.testing.assert_array_equal(again, starts)
    assert not none.any()


def test_flights_last_four_time_constants():
    """Within the usual and the longest duration; of a loop that is not stable, the usual one."""
    for constant in (20.0, 40.0):
        seconds = seconds_to_converge(np.exp(-0.02 / constant), 0.02)
        assert seconds == pytest.approx(4.0 * constant)
    assert seconds_to_converge(np.exp(-0.02 / 1.0), 0.02) == HORIZON
    assert seconds_to_converge(1.0, 0.02) == HORIZON
    assert seconds_to_converge(1.0 - 1e-9, 0.02) == LONGEST


@pytest.mark.parametrize(
    ("left", "text"),
    [
        (("altitude", 0.02, -1.0, 0.0, "ft", True), "altitude below 0 ft (assumed) at 0.02 s"),
        (("alpha", 1.5, 0.6, 0.5, "rad"), "alpha above 28.65 deg at 1.5 s"),
        (("throttle", 1.5, 1.2, 1.0, "1"), "throttle above 1 at 1.5 s"),
        (("alpha", 1.5, np.nan, 0.5, "rad"), "alpha is not a number at 1.5 s"),
    ],
)
def test_departures_are_written_with_their_side(left, text):
    assert departure_text(Departure(*left)) == text


def test_ratios_are_statistics_of_costs():
    assert Ratios.of([3.0, 1.0, 2.0, 7.0]) == (1.0, 2.5, 7.0)
    assert Ratios.of([]) is None


def test_inputs_that_follow_themselves_have_a_larger_gain():
    """u = -K x + .5 of the elevator before: the settled gain is twice K; an integrator has none."""
    names = ("alpha", "speed", "elevator")
    for share, gain in ((0.5, K * [[2.0], [1.0]]), (1.0, None)):
        follows = lambda o, s=share: -ca.DM(K) @ o[:2] + ca.DM([s, 0.0]) * o[2]  # noqa: E731
        search = search_of(follows, names)
        found = search.at_trim()
        np.testing.assert_allclose(found.K_inputs, [[share, 0.0], [0.0, 0.0]], atol=1e-9)
        np.testing.assert_allclose(found.C, [[1.0, 0.0], [0.0, 1.0], [0.0, 0.0]])
        if gain is None:
            assert found.gain is None
        else:
            np.testing.assert_allclose(found.gain, gain, atol=1e-9)


def test_a_kink_of_the_policy_has_the_mean_slope():
    """u = .3 |alpha| - .1 alpha: slopes -.4 below and .2 above, in the units of the states."""
    found = search_of(lambda o: ca.vertcat(0.3 * ca.fabs(o[0]) - 0.1 * o[0], 0.0)).at_trim()
    np.testing.assert_allclose(found.K, [[0.1, 0.0], [0.0, 0.0]], atol=1e-6)
    (note,) = found.kinks
    assert "d elevator / d alpha is -0.1, the mean" in note
    assert "-0.4 and 0.2" in note


@pytest.mark.parametrize(
    ("raw", "clips"),
    [
        ([0.0, 0.0], ()),
        ([0.9, 0.0], ("the action of elevator at the end of its box", "elevator at its limit")),
        ([-0.9, 0.0], ("the action of elevator at the end of its box", "elevator at its limit")),
        ([0.0, 0.6], ("throttle at its limit",)),
        ([0.0, -0.6], ("throttle at its limit",)),
        ([0.0, 0.49], ()),
    ],
)
def test_saturated_actions_and_inputs_are_named(raw, clips):
    """The elevator moves by at most .25 from .05, within -.2 to .3; the throttle has no box."""
    action = {"elevator": {"box": [-0.8, 0.8], "map": "trim + 0.3125 * a"}, "throttle": {}}
    search = search_of(lambda o: ca.DM(raw) + 0.0 * o[:2], action=action)
    assert search.at_trim().clips == clips


def test_clipped_observations_are_named():
    normalizer = {"mean": [0.3, 0.0], "variance": [0.01, 1.0], "clip": 2.9}
    found = search_of(offset_gain, normalizer=normalizer).at_trim()
    assert found.clipped_observations == ("alpha",)
    wide = search_of(offset_gain, normalizer=normalizer | {"clip": 3.1}).at_trim()
    assert wide.clipped_observations == ()


def test_whole_turns_are_taken_from_angles_alone():
    turns = np.array([2.0 * np.pi, 0.0, 360.0])
    deviations = np.array([[3.2, 3.2, 190.0], [-9.5, 9.5, -170.0]])
    expected = [[2.0 * np.pi, 0.0, 360.0], [-4.0 * np.pi, 0.0, 0.0]]
    np.testing.assert_allclose(whole_turns(deviations, turns), expected)


def test_an_angle_that_the_loop_does_not_distinguish_has_a_turn():
    """x'' = -sin x + u with u of sin x; u of x itself, or a rate of x, distinguishes a turn."""
    for rate, observed, turn in (
        (ca.sin, {"swing": {"formula": "sin(angle)"}}, 2.0 * np.pi),
        (ca.sin, {"angle": {}}, 0.0),
        (lambda x: x, {"swing": {"formula": "sin(angle)"}}, 0.0),
    ):
        pendulum = hfa.Model(
            "pendulum",
            {"angle": hfa.Signal("rad"), "rate": hfa.Signal("rad/s")},
            {"torque": hfa.Signal()},
            lambda x, u, p, w, f=rate: ({"angle": x.rate, "rate": u.torque - f(x.angle)}, {}),
            trim={"angle": 0.0, "rate": 0.0},
        )
        o = ca.SX.sym("o")
        deployment = hfa.Deployment(
            policy={"file": ca.Function("policy", [o], [-0.5 * o])},
            observation=observed,
            action={"torque": {}},
            timing={"dt": 0.02},
        )
        search = EquilibriumSearch(Deployed(deployment, pendulum), hfa.trim(pendulum))
        assert search.turns().tolist() == [turn, 0.0]
