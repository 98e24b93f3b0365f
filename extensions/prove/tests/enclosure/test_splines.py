"""Tables of `casadi.interpolant` are read exactly, and others are refused."""

from fractions import Fraction
from itertools import pairwise

import casadi as ca
import numpy as np
import pytest

from hfa_prove.enclosure import splines
from hfa_prove.enclosure.ball_function import BallFunction, Undecided, about_zero, exact
from hfa_prove.enclosure.splines import tables_of
from hfa_support.errors import BadInputError

GRIDS = ([-1.0, 0.0, 0.5, 2.0, 3.0], [0.0, 1.0, 2.5, 4.0], [-2.0, 0.0, 1.0, 3.0])


def table(method, arguments, outputs=1, degree=None):
    """Return a table with random values."""
    grid = list(GRIDS[:arguments])
    count = outputs * int(np.prod([len(each) for each in grid]))
    values = np.random.default_rng(4).normal(size=count).tolist()
    options = {} if degree is None else {"degree": [degree] * arguments}
    return ca.interpolant("table", method, grid, values, options)


CASES = {
    "linear": table("linear", 1),
    "linear in 3, two outputs": table("linear", 3, 2),
    "cubic": table("bspline", 1),
    "quadratic": table("bspline", 1, degree=2),
    "cubic in 2, two outputs": table("bspline", 2, 2),
}


def _points(function, count):
    """Return random points within and beyond the grid."""
    generator = np.random.default_rng(1)
    return generator.uniform(-2.5, 4.5, (count, function.numel_in(0)))


def _values(function, points):
    return np.array([function(point).full().ravel() for point in points])


@pytest.mark.parametrize("name", CASES)
def test_tables_have_the_values_of_casadi(name):
    """Tables have the values of CasADi within and beyond the grid, in doubles and in balls."""
    function = CASES[name]
    points = _points(function, 60)
    expected = _values(function, points)
    found = np.array([[each.at(point) for each in tables_of(function)] for point in points])
    assert found == pytest.approx(expected, abs=1e-12)
    y = ca.SX.sym("y", function.numel_in(0))
    balls = BallFunction(ca.Function("f", [y], [function(y)]))
    (at_last,) = balls([exact(value) for value in points[-1].tolist()])
    assert [float(ball) for ball in at_last] == pytest.approx(expected[-1].tolist(), abs=1e-12)


@pytest.mark.parametrize("name", ["linear", "cubic"])
def test_balls_of_tables_are_decided_between_breakpoints(name):
    """Midway between two breakpoints, a ball is the exact value of the polynomial there. Of an argument
    across a breakpoint it is undecided which polynomial applies.
    """
    (read,) = tables_of(CASES[name])
    spline = read.spline()
    y = ca.SX.sym("y")
    function = BallFunction(ca.Function("f", [y], [CASES[name](y)]))
    for (low, high), piece in zip(pairwise(spline.knots), spline.pieces[1:-1], strict=True):
        at = (Fraction(low) + Fraction(high)) / 2
        value = sum(c * (at - Fraction(low)) ** k for k, c in enumerate(piece))
        assert abs(function([exact(float(at))])[0][0] - exact(float(value))) < 1e-15
    across = exact(spline.knots[1]) + about_zero(1e-9)
    undecided = [across, exact(spline.knots[0])] if name == "cubic" else [across]
    for place in undecided:  # a cubic table jumps to another value at its ends
        with pytest.raises(Undecided):
            function([place])
    assert float(function([exact(spline.knots[1])])[0][0]) == pytest.approx(
        float(CASES[name](spline.knots[1])), abs=1e-12
    )


@pytest.mark.parametrize("planted", ["Interpolant::values", "BSpline::coeffs"])
def test_a_table_that_is_misread_is_refused(planted, monkeypatch):
    """A table whose stored numbers are misread is refused, because its values differ."""
    read = splines._Entries.numbers

    def shifted(self, key):
        values = read(self, key)
        return [values[0] + 1e-6, *values[1:]] if key == planted else values

    monkeypatch.setattr(splines._Entries, "numbers", shifted)  # the planted error
    splines._tables_of.cache_clear()
    function = table("linear" if planted.startswith("Inter") else "bspline", 2)
    with pytest.raises(BadInputError, match="other values of the table"):
        tables_of(function)
    splines._tables_of.cache_clear()
