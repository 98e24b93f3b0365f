"""Best flights compared with a closed form and another integrator, and planted errors."""

from dataclasses import replace

import casadi as ca
import numpy as np
import pytest
from carts import cart

import hfa

#: Gain of the LQR of the cart with Q = I and R = 1.
LQR_GAIN = np.array([[1.0, np.sqrt(3.0)]])


def test_saturated_double_integrator_cost_equals_closed_form():
    """The best cost of a saturated double integrator agrees with its closed form within 0.1 %.

    The force of the trim is 0.5 N, from which its limits are 1 N away. State and costate λ are
    polynomials in time, backwards from a point at which the LQR saturates, with λ' = -∂H/∂x and
    u = -λ2 / 2, saturated at -1. The problem is convex. Pontryagin's conditions are therefore
    sufficient.
    """
    # P of the LQR with Q = I and R = 1, whose gain is P[1].
    P = np.array([[np.sqrt(3.0), 1.0], [1.0, np.sqrt(3.0)]])
    switch = np.array(
        [3.0, (1.0 - 3.0) / np.sqrt(3.0)]
    )  # P[1] @ switch = 1, the limit of the force
    x2 = np.polynomial.Polynomial([switch[1], -1.0])  # before t = 0, with the force -1 N
    x1 = x2.integ() + switch[0]
    lambda1 = -2.0 * x1.integ() + 2.0 * P[0] @ switch
    lambda2 = -2.0 * x2.integ() - lambda1.integ() + 2.0 * P[1] @ switch
    begin = -1.5  # s
    assert (lambda2(np.linspace(begin, 0.0, 50)) >= 2.0 - 1e-12).all()
    # The cost up to the switch, with u = -1, and x'Px from there on.
    running = x1**2 + x2**2 + 1.0
    cost = -running.integ()(begin) + switch @ P @ switch
    uphill = replace(
        cart(),
        inputs={"force": hfa.Signal("N", min=-0.5, max=1.5)},
        equations=lambda x, u, p, w: ({"position": x.velocity, "velocity": u.force - 0.5}, {}),
    )
    start = {"position": x1(begin), "velocity": x2(begin)}
    best = hfa.optimize(uphill, hfa.trim(uphill), start, np.eye(2), np.eye(1))
    assert best.cost == pytest.approx(cost, rel=1e-3)
    assert best.saturated == ["force"]
    assert best.spread < 0.05
    for name in best.state_names:
        low, high = best.envelope[name]
        assert low <= best[name].min() <= best[name].max() <= high


def test_a_flight_that_leaves_and_comes_back_does_not_converge():
    """A flight that is at the trim at its end, but was faster than permitted before, has neither
    converged nor a cost ratio. `fly` says that it has not returned, and departs at the same time.
    """
    model = cart()
    point = hfa.trim(model)
    limits = {"velocity": (-0.5, 1.0)}
    start = {"position": 2.0, "velocity": 0.0}
    best = hfa.optimize(model, point, start, limits=limits, policies={"gain": LQR_GAIN})
    left = best.policies[-1]
    np.testing.assert_allclose(best.compared[-1].states[-1], point.x, atol=1e-2)
    assert (left.converges, left.over_best, left.departure.state) == (False, None, "velocity")
    saturated = lambda t, X: np.clip(-LQR_GAIN @ list(X), -1.0, 1.0)  # noqa: E731
    flown = hfa.fly(
        model, point, saturated, 9.0, initial=start, envelope=limits, weights=(best.Q, best.R)
    )
    assert flown.departure.time == pytest.approx(left.departure.time, abs=0.02)
    assert flown.returned is False


def test_an_input_not_selected_is_constant():
    """An input that is not selected is constant. With both inputs, the cost is more than 10 %
    lower.
    """
    forces = {name: hfa.Signal("N", min=-1.0, max=1.0) for name in ("front", "rear")}
    model = replace(
        cart(),
        inputs=forces,
        equations=lambda x, u, p, w: (
            {"position": x.velocity, "velocity": u.front + u.rear - 0.1 * x.velocity**3},
            {},
        ),
    )
    point = hfa.trim(model)
    one = hfa.optimize(model, point, {"position": 1.0}, inputs=["front"])
    both = hfa.optimize(model, point, {"position": 1.0})
    assert np.ptp(one.inputs[:, 1]) == 0.0
    assert np.ptp(both.inputs[:, 1]) > 0.1
    assert both.cost < 0.9 * one.cost


def test_a_candidate_through_a_nonsmooth_point_is_confirmed():
    """v' = u - .3 |v|: the flight of the exact equations costs as much as the candidate, for which the
    optimizer smoothed |v|, and at most as much as the linear optimum.
    """
    model = replace(
        cart(),
        equations=lambda x, u, p, w: (
            {"position": x.velocity, "velocity": u.force - 0.3 * ca.fabs(x.velocity)},
            {},
        ),
    )
    best = hfa.optimize(model, hfa.trim(model), {"position": 2.0})
    assert best.reason is None
    assert best.cost == pytest.approx(best.proposed_cost, rel=5e-3)
    assert best.cost <= best.compared[0].cost
