"""Comparisons of balls, which are true only if proved, and Taylor models of exact values."""

from __future__ import annotations

import subprocess
import sys

import casadi as ca
import flint
import numpy as np
import pytest

pytest.importorskip("hfa_prove")

from flint import arb
from known_models import model_at
from proof_cases import family
from random_points import rates_function

import hfa_model
from hfa_model import VARIANTS
from hfa_prove.enclosure.ball_function import BallFunction
from hfa_prove.enclosure.balls import (
    doubles,
    exact,
    hull,
    is_positive_definite,
    lowest_sign,
    matrix,
    norm,
    pivots,
    symmetric,
)
from hfa_prove.enclosure.precision import PRECISION
from hfa_prove.enclosure.series import TaylorModel


@pytest.mark.parametrize(("off", "second"), [(1.0, 1.5), (2.0, 0.0), (3.0, -2.5)])
def test_pivots_equal_those_of_gaussian_elimination(off: float, second: float) -> None:
    """Pivots are those of Gaussian elimination, and a matrix is definite if all are positive.

    If a pivot is 0, None is returned.
    """
    found = pivots(matrix([[2.0, off], [off, 2.0]]))
    assert (found is None) == (second == 0.0)
    assert is_positive_definite(matrix([[2.0, off], [off, 2.0]])) == (second > 0.0)
    assert found is None or [float(each) for each in found] == [2.0, second]


def test_norms_and_hulls_contain_every_member() -> None:
    """A norm contains the norms of all matrices of the balls, and no other far from them."""
    found = norm([arb(3, 1), arb(-4, 1), arb(0, 2)])
    assert float(found.lower()) == pytest.approx(np.sqrt(4.0 + 9.0), rel=1e-7)
    assert float(found.upper()) == pytest.approx(np.sqrt(16.0 + 25.0 + 4.0), rel=1e-7)
    assert found.contains(arb(13).sqrt())
    assert found.contains(arb(45).sqrt())
    assert norm([]) == 0
    (ball,) = hull(np.array([[-1.5]]), np.array([[0.25]])).entries()
    assert (float(ball.lower()), float(ball.upper())) == (pytest.approx(-1.5), pytest.approx(0.25))
    assert ball.contains(-1.5)
    assert ball.contains(0.25)
    for value in (arb(-2, 1), -3, 3.0):
        assert symmetric(value).contains(3)
        assert symmetric(value).contains(-3)
        assert not symmetric(value).contains(3.001)
    assert exact(0.1).rad() == 0
    assert doubles(matrix([[1.0, 2.0], [3.0, 4.0]])).tolist() == [[1.0, 2.0], [3.0, 4.0]]


@pytest.mark.parametrize(
    ("rows", "sign"),
    [
        ([[1.0]], 1),
        ([[0.0]], 0),
        ([[-1e-300]], -1),
        ([[2.0, 2.0], [2.0, 2.0]], 0),
        ([[2.0, 2.0], [2.0, 2.0 + 2.0**-51]], 1),
        ([[2.0, 2.0], [2.0, 2.0 - 2.0**-52]], -1),
        ([[0.0, 0.0], [0.0, 1.0]], 0),
        ([[0.0, 1.0], [1.0, 1.0]], -1),
        ([[0.0, 0.0], [0.0, -1.0]], -1),
        ([[1.0, 0.0, 1.0], [0.0, 1.0, 1.0], [1.0, 1.0, 2.0]], 0),
        ([[1.0, 0.0, 1.0], [0.0, 1.0, 1.0], [1.0, 1.0, 1.9]], -1),
        ([[1.0, 0.5, 1.0], [0.5, 1.0, 1.0], [1.0, 1.0, 2.0]], 1),
        ([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, 1.0, 1.0]], -1),
    ],
)
def test_the_lowest_sign_is_exact(rows: list[list[float]], sign: int) -> None:
    """Definite, semidefinite and indefinite matrices of doubles are told apart exactly."""
    assert lowest_sign(np.array(rows)) == sign


@pytest.mark.parametrize("slope", [-1.75, -0.25, 1.25])
def test_corners_bound_the_minimum_of_a_parabola(slope: float) -> None:
    """The lowest corner of the Taylor model slope s + s² is at most the minimum of the parabola.

    The minimum is at s = -slope / 2.
    """
    corners = TaylorModel(arb(0), arb(slope), arb(1)).corners()
    assert min(float(corner.lower()) for corner in corners) <= -(slope**2) / 4.0


@pytest.mark.parametrize("dynamics", VARIANTS)
def test_the_remainder_is_of_third_order(dynamics: str) -> None:
    """If a box is halved, the remainder of the Taylor models decreases by a factor from 6 to 12."""
    function = BallFunction(rates_function(VARIANTS[dynamics]))
    point = model_at(12.0, dynamics).point
    parameters = hfa_model.parameters_of(family(dynamics).model)
    direction = np.random.default_rng(3).uniform(-1.0, 1.0, 7) * [5.0, 0.1, 0.0, 0.1, 0.1, 0.1, 0.1]
    fixed = [[TaylorModel(arb(value)) for value in values] for values in (point.inputs, parameters)]
    rests = []
    for size in (0.2, 0.1):
        steps = (size * direction).tolist()
        along = [TaylorModel(arb(a), arb(b)) for a, b in zip(point.states, steps, strict=True)]
        rests.append(max(float(model.parts[3].rad()) for model in function(along, *fixed)[0]))
    assert 6.0 < rests[0] / rests[1] < 12.0


def escaped(dynamics: str, points: int, seed: int) -> int:
    """Return the number of rates outside their Taylor models.

    The rates are computed with 200 bits at random points of a random line through the trim.
    """
    random = np.random.default_rng(seed)
    function = BallFunction(rates_function(VARIANTS[dynamics]))
    point = model_at(12.0, dynamics).point
    parameters = hfa_model.parameters_of(family(dynamics).model)
    x = [arb(value) for value in point.states]
    direction = random.uniform(-0.1, 0.1, len(point.states)).tolist()
    along = [TaylorModel(a, arb(b)) for a, b in zip(x, direction, strict=True)]
    fixed = [[arb(value) for value in values] for values in (point.inputs, parameters)]
    models = function(along, *([TaylorModel(value) for value in values] for values in fixed))[0]
    missed = 0
    with flint.ctx.workprec(200):
        for s in map(arb, random.uniform(-1.0, 1.0, points).tolist()):
            values = function([a + b * s for a, b in zip(x, direction, strict=True)], *fixed)[0]
            for model, value in zip(models, values, strict=True):
                c0, c1, c2, rest = model.parts
                missed += not (c0 + c1 * s + c2 * s**2 + rest).contains(value)
    return missed


@pytest.mark.parametrize("dynamics", VARIANTS)
def test_taylor_models_contain_random_points(
    dynamics: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Taylor models contain the exact values at random points.

    Without the remainder of products (planted fault) they do not.
    """
    assert escaped(dynamics, 50, seed=0) == 0
    whole = TaylorModel.__mul__

    def without_remainder(self: TaylorModel, other: TaylorModel) -> TaylorModel:
        c0, c1, c2, rest, *errors = whole(self, other).parts
        return TaylorModel(c0, c1, c2, 0 * rest, *errors)

    # The planted fault: a product without its remainder.
    monkeypatch.setattr(TaylorModel, "__mul__", without_remainder)
    assert escaped(dynamics, 50, seed=0) > 0


@pytest.mark.slow
@pytest.mark.parametrize("dynamics", VARIANTS)
def test_taylor_models_contain_a_hundred_thousand_random_points(dynamics: str) -> None:
    """Taylor models contain the exact values for ten seeds of 5,000 random points."""
    for seed in range(10):
        assert escaped(dynamics, 5_000, seed) == 0


def test_parameter_errors_are_propagated_to_first_order() -> None:
    """Parameter errors are propagated to first order, and their products are in the remainder.

    The function is (1 + 0.1 s + 0.2 t_1 - 0.1 t_2)² / (3 - 0.2 s + 0.3 t_2) at random points.
    """
    x = ca.SX.sym("x")
    y = ca.SX.sym("y")
    function = BallFunction(ca.Function("f", [x, y], [x**2 / y]))
    zero = arb(0)
    top = TaylorModel(arb(1), arb(0.1), zero, zero, arb(0.2), arb(-0.1))
    below = TaylorModel(arb(3), arb(-0.2), zero, zero, zero, arb(0.3))
    found = function([top], [below])[0][0]
    c0, c1, c2, rest, *z = found.parts
    for s, *t in np.random.default_rng(5).uniform(-1.0, 1.0, (50, 3)).tolist():
        exact = arb(1 + 0.1 * s + 0.2 * t[0] - 0.1 * t[1]) ** 2 / arb(3 - 0.2 * s + 0.3 * t[1])
        near = (
            c0
            + c1 * s
            + c2 * arb(s) ** 2
            + sum((a * b for a, b in zip(z, t, strict=True)), zero)
            + rest
        )
        assert near.contains(exact.mid())
    np.testing.assert_allclose(
        [float(each.mid()) for each in z], [0.4 / 3, -0.2 / 3 - 0.1 / 3], rtol=1e-12
    )


@pytest.mark.parametrize("module", ["hfa_prove.enclosure.series", "hfa_prove.search.game"])
def test_importing_balls_sets_their_precision(module: str) -> None:
    """Whoever imports balls in a new process computes with the bits of proofs."""
    program = f"import {module}, flint; print(flint.ctx.prec)"
    words = [sys.executable, "-c", program]
    done = subprocess.run(words, capture_output=True, text=True, check=True, timeout=60)
    assert int(done.stdout) == PRECISION
