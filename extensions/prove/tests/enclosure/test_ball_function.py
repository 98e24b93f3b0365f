"""Balls contain the values of functions, and what they do not decide is not decided."""

import casadi as ca
import numpy as np
import pytest
from flint import arb

from hfa import BadInputError
from hfa_prove.enclosure.ball_function import BallFunction, Undecided, exact


def _smooth():
    """Return a function of two numbers with every smooth operation of balls."""
    y = ca.SX.sym("y", 2)
    a, b = 2.0 + 0.3 * y[0], 0.4 * y[0] - 0.3 * y[1]
    expressions = [
        *(a * b, b / a, 1 / a, a**-3, a**1.5, ca.sqrt(a), ca.exp(b), ca.log(a), ca.expm1(b)),
        *(ca.log1p(b), ca.sin(a), ca.cos(b), ca.tan(b), ca.asin(b), ca.acos(b), ca.atan(b)),
        *(b + b, a**b, ca.atan2(b, a), ca.tanh(b), b**2 - a, ca.fabs(-a)),
        *(ca.fmax(a, b), ca.fmin(a, b)),
    ]
    return ca.Function("smooth", [y], [ca.vertcat(*expressions)])


def test_balls_enclose_every_operation():
    """Balls of every operation on a box are finite, and contain the values at its corners and at
    random points. At an exact point they are CasADi's values.
    """
    function = _smooth()
    centre, half = np.array([0.3, -0.4]), 0.5
    (found,) = BallFunction(function)([arb(value, half) for value in centre.tolist()])
    assert all(ball.is_finite() for ball in found)
    points = np.random.default_rng(2).uniform(-1.0, 1.0, (200, 2))
    points[:100] = np.sign(points[:100])
    for place in centre + half * points:
        for ball, value in zip(found, np.array(function(place)).ravel().tolist(), strict=True):
            assert ball.overlaps(arb(value, 1e-14))
    (at_centre,) = BallFunction(function)([exact(value) for value in centre.tolist()])
    expected = np.array(function(centre)).ravel().tolist()
    assert [float(ball) for ball in at_centre] == pytest.approx(expected, rel=1e-12)


def test_functions_that_are_not_inlined_are_read():
    """A function that CasADi calls without inlining it is read like its operations."""
    y = ca.SX.sym("y", 2)
    z = ca.SX.sym("z", 2)
    outputs = [z[0] * ca.sin(z[1]), ca.vertcat(z[1] ** 2, z[0])]
    called = ca.Function("g", [z], outputs, {"never_inline": True})
    first, second = called(2 * y)
    function = ca.Function("f", [y], [first - second[0] + second[1]])
    (found,) = BallFunction(function)([exact(0.3), exact(-0.7)])[0]
    assert float(found) == pytest.approx(float(function([0.3, -0.7])), rel=1e-14)


@pytest.mark.parametrize(
    ("expression", "named"),
    [
        (lambda y: y * np.inf, "f: the function contains inf; use finite numbers"),
        (lambda y: ca.erf(y), "f: the equations use erf, which a proof does not support"),
        (
            lambda y: ca.vertcat(*(ca.sin(k * y) for k in range(1, 12))),
            "42 operations, but at most 20 are",
        ),
    ],
)
def test_unsupported_functions_are_refused(expression, named, monkeypatch):
    """A function that cannot be enclosed, or that is too large, is refused in one line."""
    monkeypatch.setattr("hfa_prove.enclosure.ball_function.LARGEST", 20)
    y = ca.SX.sym("y")
    with pytest.raises(BadInputError, match=named):
        BallFunction(ca.Function("f", [y], [expression(y)]))


ABOUT_0 = arb(0, 0.1)


@pytest.mark.parametrize(
    ("expression", "at"),
    [
        (lambda x: ca.fmin(x, 0.0), ABOUT_0),
        *((lambda x: ca.atan2(1.0, x), each) for each in (ABOUT_0, arb(0), arb(-1))),
        *((lambda x: x**0.3, each) for each in (ABOUT_0, arb(0))),
    ],
)
def test_an_undecided_branch_raises_undecided(expression, at):
    """A function with an undecided branch at the argument raises Undecided.

    An argument of exactly 0 does not count as positive, and atan2(y, x) is undecided for x < 0.
    """
    x = ca.SX.sym("x")
    with pytest.raises(Undecided):
        BallFunction(ca.Function("f", [x], [expression(x)]))([at])


@pytest.mark.parametrize("at", [0.75, 1.0, 1.25])
def test_comparisons_at_equal_values_are_those_of_casadi(at):
    """Comparisons, extremes and signs of exact values are those of CasADi, also of equal values."""
    x = ca.SX.sym("x")
    one = ca.SX(1.0)
    expressions = [x < one, x <= one, x > one, x >= one, ca.sign(x - 1), ca.fmax(x, 1), -x < -one]
    function = ca.Function("f", [x], [ca.vertcat(*expressions)])
    expected = np.array(function(at)).ravel().tolist()
    assert [float(each) for each in BallFunction(function)([exact(at)])[0]] == expected
