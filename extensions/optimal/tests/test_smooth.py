"""Smooth copies of functions with tables and kinks."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest

import hfa
from hfa_flight.initial_box import drawn_starts
from hfa_flight.problem import flight_problem
from hfa_optimal.search import BestFlights
from hfa_optimal.smooth import smooth_rates, smoothed

POINTS = np.linspace(-1.0, 1.0, 401)[:, None]
#: Half-width of the kinks in the tests, for an argument with the values POINTS.
WIDTH = 0.1 * POINTS.std()


def copies(expression: ca.SX, x: ca.SX) -> tuple[np.ndarray, np.ndarray, ca.Function]:
    """Return the values of a function and of its smooth copy at POINTS, and the copy."""
    sharp = ca.Function("f", [x], [expression])
    smooth = smoothed(sharp, POINTS, 0.1)
    return np.array(sharp(POINTS.T))[0], np.array(smooth(POINTS.T))[0], smooth


@pytest.mark.parametrize(
    "kinked",
    [
        ca.fabs,
        lambda x: ca.fmax(x, 0.0),
        lambda x: ca.fmin(2.0 * x, x),
        lambda x: ca.if_else(x < 0.0, -x, 3.0 * x),
        lambda x: ca.if_else(ca.logic_and(x > 0.0, x > -0.5), x, 0.0),
    ],
)
def test_a_smooth_copy_differs_only_near_the_kink(kinked):
    """A smooth copy differs from the function only near the kink, by less than 4 half-widths.

    The slope of the copy is continuous.
    """
    x = ca.SX.sym("x")
    sharp, smooth, copy = copies(kinked(x), x)
    near = np.abs(POINTS[:, 0]) <= 1.01 * WIDTH
    assert np.abs(smooth - sharp)[~near].max() < 1e-12
    assert 0.0 < np.abs(smooth - sharp)[near].max() < 4.0 * WIDTH
    slope = ca.Function("slope", [x], [ca.jacobian(copy(x), x)])
    fine = np.array(slope(np.linspace(-0.5, 0.5, 4001)[None]))[0]
    assert np.abs(np.diff(fine)).max() < 0.05
    assert np.abs(np.diff(np.array(slope(POINTS.T))[0])).max() > 0.05


def test_a_condition_on_a_truth_value_is_smooth():
    """A condition on the result 0 or 1 of a comparison is smoothed, as in JSBSim's ifthen."""
    x = ca.SX.sym("x")
    truth = ca.if_else(x < 0.0, 1.0, 0.0)
    sharp, smooth, _ = copies(ca.if_else(ca.fabs(truth) >= 1e-9, 1.0, 2.0 + x), x)
    inside = np.abs(POINTS[:, 0]) < 0.9 * WIDTH
    assert np.abs(smooth - sharp)[~inside & (np.abs(POINTS[:, 0]) > WIDTH)].max() < 1e-12
    assert np.ptp(np.diff(smooth[inside])) < 0.2


def test_unsuitable_comparisons_are_not_smoothed():
    """Comparisons with infinite branches or constant arguments are not changed.

    If the kink is far from the points, the function itself is returned.
    """
    x = ca.SX.sym("x")
    choice = ca.if_else(x > 0.0, x, ca.inf) + ca.fmax(x - x, 0.0) + ca.fabs(x)
    sharp, smooth, _ = copies(choice, x)
    sharp, smooth = (row[POINTS[:, 0] > WIDTH] for row in (sharp, smooth))
    assert smooth == pytest.approx(sharp, abs=1e-14)
    smooth = ca.Function("f", [x], [ca.sin(x) + ca.fmax(x, -5.0)])
    assert smoothed(smooth, POINTS, 0.1) is smooth


@pytest.mark.slow
def test_exact_equations_confirm_the_cost_with_tables():
    """For an aircraft with tables, the simulation with exact equations confirms the proposed cost.

    The difference is at most 0.5 %. The smoothed rates differ from the exact rates by less than 5
    %.
    """
    pytest.importorskip("jsbsim")
    model = hfa.load_model("jsbsim:737")
    problem = flight_problem(model, hfa.trim(model))
    assert problem.carried == ("altitude",)
    rng = np.random.default_rng(1)
    points = 0.5 * rng.uniform(-1.0, 1.0, (200, smooth_rates(problem).numel_in(0)))
    sharp, smooth = (np.array(f(points.T)) for f in (problem.rates, smooth_rates(problem)))
    assert 0.0 < np.abs(smooth - sharp).max() < 0.05 * np.abs(sharp).max()
    (start,) = drawn_starts(problem, 1, 0)
    found = BestFlights(problem).found(start)
    assert found.flown.cost == pytest.approx(found.proposal.cost, rel=0.005)
    assert found.flown.cost < found.linear.cost
    assert found.spread_of_meshes < 0.005
