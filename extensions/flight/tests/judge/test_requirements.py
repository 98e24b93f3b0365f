"""What a PASS of `hfa.assess` requires: every flight or a share, and an equilibrium within limits."""

import math

import numpy as np
import pytest
from small_plants import deployed, scalar

import hfa
from hfa_flight.judge.outcomes import seeded_starts

#: v' = v + f with |f| <= 0.5: flights from |v| > 0.5 leave the limits.
UNSTABLE = scalar(lambda v, f: v + f, 2.0, 0.5)
#: v' = f - 0.1 v with |v| <= 2 and |f| <= 0.5.
SLOW = scalar(lambda v, f: f - 0.1 * v, 2.0, 0.5)


def deployment(gain, offset=0.0):
    """Return f = -gain v + offset at 20 Hz, without a cost."""
    policy = lambda v: -gain * v + offset  # noqa: E731
    return deployed(policy, 0.05, observation={"v": {"about": 0.0}}, cost=None)


def test_every_flight_or_the_required_share_of_flights_must_converge():
    """With v' = v + f and |f| <= 0.5 only flights from |v| < 0.5 converge, about half, although the
    linear loop is stable. The policy passes if the required share is at most this share, and not if
    every flight must converge.
    """
    found = hfa.assess(UNSTABLE, deployment(4.0), samples=12)
    (point,) = found.points
    assert point.radius < 1.0
    shares = [flown.converged / flown.starts for flown in (point.flights, point.disturbed)]
    assert all(0.2 < share < 0.8 for share in shares)
    assert not found.ok
    least = min(shares)
    for share, passes in ((least, True), (least + 0.02, False)):
        needs = {"share": share}
        again = hfa.assess(UNSTABLE, deployment(4.0), samples=12, needs=needs)
        assert (again.ok, again.points[0].holds) == (passes, passes)


def test_wrong_requirements_are_refused_before_any_flight():
    """A wrong share, an unknown requirement, and a cost without weights are refused at once."""

    def flown(*_):
        raise AssertionError("a flight was flown")

    for asked, said in (
        ({"needs": {"share": 1.2}}, r"share is 1\.2"),
        ({"needs": {"speed": 1.0}}, "choose from delay, margin, cost"),
        ({"needs": {"cost": 5.0}}, "required cost: .* has no table .cost"),
    ):
        with pytest.raises(hfa.BadInputError, match=said):
            hfa.assess(UNSTABLE, deployment(4.0), progress=flown, **asked)


@pytest.mark.parametrize("offset", [0.01, 0.2, -0.2])
def test_flights_to_an_equilibrium_beside_the_trim_converge_with_an_error(offset):
    """Every flight converges to the equilibrium of f = offset - v, whose error has the sign of the
    offset and is reported.
    """
    found = hfa.assess(SLOW, deployment(1.0, offset), samples=6)
    (point,) = found.points
    assert point.flights.converged == point.disturbed.converged == 6
    assert found.ok
    v = offset / 1.1  # of f = offset - v and v' = f - 0.1 v = 0
    assert point.flights.end["v"] == pytest.approx(v, rel=1e-6)
    sign = "+" if offset > 0.0 else "-"
    is_large = abs(offset) > 0.1
    assert (f"steady-state v error {sign}" in " ".join(str(found).split())) is is_large


def test_a_flight_has_returned_if_its_cost_to_go_is_below_5_percent():
    """A flight has returned if its cost-to-go is less than 5 % of the sum of cost and cost-to-go.

    v' = -1.1 v with f = -v costs 2 v² a second; the linear cost-to-go is P v² with P² + .2 P = 1.
    """
    P = -0.1 + math.sqrt(1.01)
    spent = (1.0 + 1.0) / (2.0 * 1.1)
    point = hfa.trim(SLOW)
    for share in (0.049, 0.051):
        # P end^2 is this share of P end^2 + spent (1 - end^2), with end = v / v(0).
        end = math.sqrt(share * spent / (P * (1.0 - share) + share * spent))
        seconds = round(-math.log(end) / 1.1, 2)
        weights = (np.eye(1), np.eye(1))
        flight = hfa.fly(SLOW, point, np.eye(1), seconds, initial={"v": 0.5}, weights=weights)
        assert flight.returned is (share < 0.05)
        assert flight.cost_to_go == pytest.approx(P * flight["v"][-1] ** 2, rel=1e-9)
        assert flight.cost == pytest.approx(spent * (0.25 - flight["v"][-1] ** 2), rel=1e-6)


@pytest.mark.parametrize(("offset", "passes"), [(0.1, True), (0.46, False)])
def test_an_equilibrium_beyond_the_limits_fails_without_flights(offset, passes):
    """The equilibrium v = offset / 0.2 passes at 0.5, and fails at 2.3, beyond the limit of 2, although
    the loop is stable.
    """
    (point,) = (found := hfa.assess(SLOW, deployment(0.1, offset), samples=0)).points
    assert point.equilibrium.states[0] == pytest.approx(offset / 0.2, rel=1e-6)
    assert point.radius < 1.0
    assert (found.ok, point.holds, bool(point.beyond)) == (passes, passes, not passes)


def test_a_policy_without_an_equilibrium_fails():
    """With f = 0.5 - v, v' = v + f is 0.5 everywhere."""
    model, policy = scalar(lambda v, f: v + f, 2.0), deployment(1.0, 0.5)
    found = hfa.assess(model, policy, samples=1)
    assert (found.ok, found.points[0].equilibrium) == (False, None)
    assert "no equilibrium near the trim" in str(found)
    assert hfa.fly(model, hfa.trim(model), policy, 0.1).report().data["departure"] is None


def test_flights_that_slowly_diverge_have_not_converged():
    """v' = .005 v grows by 5 % in the last ten seconds: no flight has converged, also from initial
    conditions near 0. With a gain of .2, every flight converges.
    """
    model = scalar(lambda v, f: 0.005 * v + f, 50.0)
    for gain, converged in ((0.0, 0), (0.2, 100)):
        (found,) = hfa.assess(model, deployment(gain), samples=100, box={"v": 0.1}).points
        assert found.flights.converged == converged
        assert found.flights.left_envelope == 0


def test_flights_begin_in_the_box_and_end_in_the_ball():
    """A plant that does not move ends where it begins: the flights within 5 % of the box have converged.
    Pulses alone would move it by at most half of the half-width.
    """
    still = scalar(lambda v, f: 0.0 * v + f, 50.0)
    found = hfa.assess(still, deployment(0.0), samples=4000, box={"v": 3.0}, seed=7)
    (point,) = found.points
    starts, pulses = seeded_starts(point.case, 4000, 7, with_pulse=True)
    for values, most in ((starts, 3.0), (pulses, 1.5)):
        assert 0.999 * most < np.abs(values).max() <= most
        assert np.abs(values).mean() == pytest.approx(0.5 * most, rel=0.05)
    assert point.flights.converged == (np.abs(starts) <= 0.05 * 3.0).sum()
    assert point.disturbed.converged == (np.abs(starts + pulses) <= 0.05 * 3.0).sum()
    assert point.flights.worst_initial["v"] == starts[np.abs(starts).argmax()]
