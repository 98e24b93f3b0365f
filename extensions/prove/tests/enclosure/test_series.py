"""Taylor polynomials and balls contain the values of every operation at random points."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest
from flint import arb

from hfa_prove.enclosure.ball_function import BallFunction, Undecided
from hfa_prove.enclosure.polynomial import Polynomial, exponents_of, monomials
from hfa_prove.enclosure.series import TaylorModel, TaylorOnBall

TABLE = ca.interpolant("table", "bspline", [[-9.0, 0.0, 1.0, 9.0]], [1.0, 0.3, -0.2, 1.0])


def every_operation() -> ca.Function:
    """Return a function (2,) of all operations without kinks."""
    y = ca.SX.sym("y", 2)
    a, b = 2 + 0.3 * y[0] + 0.1 * y[1], 0.3 * y[0] - 0.2 * y[1]
    expressions = [
        *(ca.sqrt(a) / (a + b**2), ca.sin(b) * ca.cos(a), ca.exp(b) - ca.log(a), ca.tan(b) * a**3),
        *(ca.atan2(b, a), ca.asin(b) + ca.acos(b), ca.atan(b) - 1 / a, -2 * a + a**1.5),
        *(ca.tanh(b) * a, ca.fmax(b, a) - ca.fabs(b - 2), ca.expm1(b) + ca.log1p(a), TABLE(b + 2)),
        *(ca.if_else(a > 0, b, a), ca.sign(a - 5) * b, 2 / a - (1 - a)),
    ]
    return ca.Function("f", [y], [ca.vertcat(*expressions)])


def test_taylor_polynomials_enclose_every_operation() -> None:
    """For each operation, the Taylor polynomial with its remainder encloses the function at 200
    random points.
    """
    function = every_operation()
    order = 4
    variables = [
        TaylorOnBall(order, Polynomial.linear([arb(i == 0), arb(i == 1)]), arb(0)) for i in range(2)
    ]
    (models,) = BallFunction(function)(variables)
    generator = np.random.default_rng(0)
    points = generator.normal(size=(200, 2))
    points *= (generator.uniform(size=200) / np.linalg.norm(points, axis=1))[:, None]
    values = np.array(function(points.T)).T
    for column, taylor in zip(values.T, models, strict=True):
        lowest = taylor.lowest(2, 4)
        for point, value in zip(points, column, strict=True):
            length = np.linalg.norm(point)
            error = abs(value - _at(taylor.polynomial, point))
            assert error <= float(taylor.remainder) * length ** (order + 1) + 1e-14
            assert taylor.range().overlaps(arb(value))
            assert _at(lowest, point) <= value + 1e-14
        assert float(taylor.remainder) < 1.0


def _at(polynomial: Polynomial, point: np.ndarray) -> float:
    total = 0.0
    for key, _, coefficient in polynomial.terms():
        exponents = exponents_of(key) + [0] * len(point)
        total += float(coefficient) * np.prod(point ** np.array(exponents[: len(point)]))
    return total


def test_a_nonsmooth_function_is_undecided() -> None:
    """A function that is not smooth on the ball raises Undecided."""
    y = ca.SX.sym("y")
    variable = TaylorOnBall(3, Polynomial.linear([arb(1)]), arb(0))
    for expression in (1 / y, ca.sqrt(0.5 + y), ca.log(y + 0.9), ca.fmax(y, 0)):
        with pytest.raises(Undecided):
            BallFunction(ca.Function("f", [y], [expression]))([variable])


def test_taylor_models_enclose_every_operation() -> None:
    """Taylor models on a segment contain each operation, for errors of both arguments."""
    function = every_operation()
    along = [
        TaylorModel(arb(0.1), arb(0.3), arb(0.1), arb(0, 0.01), arb(0.05), arb(0)),
        TaylorModel(arb(-0.2), arb(0.2), arb(-0.1), arb(0), arb(0.02), arb(-0.1)),
    ]
    (models,) = BallFunction(function)(along)
    generator = np.random.default_rng(1)
    for s, t0, t1, rest in generator.uniform(-1.0, 1.0, (300, 4)).tolist():
        square = s * s
        first = 0.1 + 0.3 * s + 0.1 * square + 0.01 * rest + 0.05 * t0
        second = -0.2 + 0.2 * s - 0.1 * square + 0.02 * t0 - 0.1 * t1
        values = np.array(function([first, second])).ravel()
        for model, value in zip(models, values.tolist(), strict=True):
            c0, c1, c2, remainder, *z = model.parts
            errors = sum((a * b for a, b in zip(z, (t0, t1), strict=False)), arb(0))
            near = c0 + arb(s) * c1 + arb(square) * c2 + errors + remainder
            assert (near + arb(0, 1e-13)).contains(arb(value))
            assert (model.range() + arb(0, 1e-13)).contains(arb(value))
            assert any(corner.upper() >= value - 1e-13 for corner in model.corners())
            assert any(corner.lower() <= value + 1e-13 for corner in model.corners())


def test_norms_bound_homogeneous_polynomials() -> None:
    """|h(y)| is at most its norm times |y|^k, and reaches the norm for a power of a linear form."""
    generator = np.random.default_rng(3)
    for degree in range(1, 5):
        keys = monomials(3, degree, degree)
        values = generator.normal(size=len(keys)).tolist()
        part = dict(zip(keys, map(arb, values), strict=True))
        polynomial = Polynomial([*({} for _ in range(degree)), part])
        norm = float(polynomial.norms()[degree])
        points = generator.normal(size=(300, 3))
        points /= np.linalg.norm(points, axis=1)[:, None]
        assert all(abs(_at(polynomial, point)) <= norm * (1.0 + 1e-12) for point in points)
        power = Polynomial.constant(arb(1))
        for _ in range(degree):
            power = power.times(Polynomial.linear([arb(2), arb(-1), arb(2)]))
        assert float(power.norms()[degree]) == pytest.approx(3.0**degree, rel=1e-12)
