"""Functions of one variable lie within their parabolas, lines and slopes, at random points."""

from __future__ import annotations

from collections.abc import Callable
from fractions import Fraction
from typing import NamedTuple

import casadi as ca
import numpy as np
import pytest
from flint import arb

import hfa_prove.enclosure.precision  # noqa: F401  # sets the precision of balls
from hfa_prove.enclosure.elementary import (
    EXP_ERROR,
    SIN_ERROR,
    TANH_ERROR,
    UNDERFLOW,
    atan,
    exp,
    log,
    sin_cos,
    tanh,
)
from hfa_prove.enclosure.lines import ENCLOSED, Enclosed, enclosed
from hfa_prove.enclosure.splines import Spline, tables_of

Function = Callable[[np.ndarray], np.ndarray]


class Exact(NamedTuple):
    """A function and its derivative with 64 bits.

    low, high: range of the centers of the tested ranges
    widths: half-widths of the tested ranges
    relative: whether the widths are shares of the center
    """

    value: Function
    slope: Function
    low: float = -3.0
    high: float = 3.0
    widths: tuple[float, ...] = (1e-13, 1e-6, 0.1, 2.0, 6.0)
    relative: bool = False


_SHARES = (1e-13, 1e-6, 0.01, 0.3, 0.97)
FUNCTIONS: dict[str, Exact] = {
    "tanh": Exact(np.tanh, lambda t: 1.0 - np.tanh(t) ** 2),
    "relu": Exact(lambda t: np.maximum(t, 0.0), lambda t: np.where(t > 0.0, 1.0, 0.0)),
    "step": Exact(lambda t: np.where(t > 0.0, 1.0, 0.0), np.zeros_like),
    "inverse": Exact(lambda t: 1.0 / t, lambda t: -1.0 / t**2, 0.2, 9.0, _SHARES, True),
    "inverse of negative": Exact(
        lambda t: 1.0 / t, lambda t: -1.0 / t**2, -9.0, -0.2, _SHARES, True
    ),
    "sqrt": Exact(np.sqrt, lambda t: 0.5 / np.sqrt(t), 0.2, 9.0, _SHARES, True),
    "exp": Exact(np.exp, np.exp, -9.0, 9.0),
    "exp far from 0": Exact(np.exp, np.exp, -900.0, 600.0, (1e-6, 1.0, 100.0)),
    "log": Exact(np.log, lambda t: 1.0 / t, 0.2, 9.0, _SHARES, True),
    "log of large": Exact(np.log, lambda t: 1.0 / t, 1e90, 1e100, _SHARES, True),
    "sin": Exact(np.sin, np.cos),
    "sin far from 0": Exact(np.sin, np.cos, -6e4, 6e4),
    "cos": Exact(np.cos, lambda t: -np.sin(t)),
    "atan": Exact(np.arctan, lambda t: 1.0 / (1.0 + t**2)),
}


def _table(method: str, degree: int = 3) -> Spline:
    grid = [[-3.0, -2.9, -1.0, 0.0, 0.7, 1.0, 2.5]]
    values = [1.0, 1.3, -0.5, 0.1, 0.5, -0.6, 0.3]
    options = {"degree": [degree]} if method == "bspline" else {}
    (table,) = tables_of(ca.interpolant("table", method, grid, values, options))
    return table.spline()


TABLES = {"linear": _table("linear"), "cubic": _table("bspline"), "quadratic": _table("bspline", 2)}


def _exact(spline: Spline, order: int) -> Function:
    """Return a piecewise polynomial or its derivative, computed in rational numbers."""

    def at(t: np.longdouble) -> np.longdouble:
        piece = int(np.searchsorted(spline.knots, float(t), side="right"))
        d = Fraction(float(t)) - Fraction(float(spline.origins[piece]))
        c = spline.pieces[piece]
        total = sum(
            (c[k] * (k if order else 1) * d ** (k - order) for k in range(order, len(c))),
            Fraction(0),
        )
        high = float(total)
        return np.longdouble(high) + np.longdouble(float(total - Fraction(high)))

    return np.vectorize(at, otypes=[np.longdouble])


def _check(function: Enclosed, exact: Exact, count: int, points: int) -> None:
    """Fail unless a function lies within all its enclosures at points of random ranges."""
    generator = np.random.default_rng(3)
    centre = generator.uniform(exact.low, exact.high, count)
    width = generator.choice(exact.widths, count)
    width = width * np.abs(centre) if exact.relative else width
    low = centre - width * generator.uniform(0.0, 1.0, count) ** 2
    high = centre + width * generator.uniform(0.0, 1.0, count) ** 2
    if not exact.relative:  # ranges that end at 0, and ranges about 0
        low[::10] = np.where(centre[::10] > 0.0, 0.0, low[::10])
        high[::10] = np.where(centre[::10] < 0.0, 0.0, high[::10])
        centre[::11] = np.clip(0.0, low[::11], high[::11])
    with np.errstate(all="ignore"):
        slopes = function.slopes(low, high)
        enclosures = [
            enclose((centre, low, high)) for enclose in (function.curve, function.line) if enclose
        ]
    for share in np.linspace(0.0, 1.0, points):
        t = np.clip(low + share * (high - low), low, high).astype(np.longdouble)
        d = t - centre
        value = exact.value(t)
        tiny = 1e-18 * (1.0 + np.abs(value))
        for found in enclosures:
            off = np.abs(value - (found.value + d * (found.slope + d * found.bend)))
            assert np.all(off <= found.rest + tiny)
        slope = exact.slope(t)
        tiny = 1e-17 * (1.0 + np.abs(slope))
        assert np.all((slopes.low - tiny <= slope) & (slope <= slopes.high + tiny))


@pytest.mark.parametrize("name", FUNCTIONS)
def test_each_part_of_an_enclosure_contains_the_function(name: str) -> None:
    """Parabolas, lines and slopes enclose functions over narrow, wide and asymmetric ranges."""
    _check(ENCLOSED[name.split()[0]], FUNCTIONS[name], 4000, 21)


@pytest.mark.parametrize(("low", "high"), [(-1.0, 0.0), (0.0, 0.0), (0.0, 1.0)])
def test_slopes_at_the_end_of_a_range_are_those_of_both_sides(low: float, high: float) -> None:
    """A range that ends at a kink has the slopes of both sides, and none at a jump."""
    ends = np.array([low]), np.array([high])
    assert np.array(ENCLOSED["relu"].slopes(*ends)).ravel().tolist() == [0.0, 1.0]
    assert np.array(ENCLOSED["step"].slopes(*ends)).ravel().tolist() == [-np.inf, np.inf]
    at_knot = enclosed(_table("linear")).slopes(*ends)
    sides = sorted(float(piece[1]) for piece in _table("linear").pieces[3:5])
    assert at_knot.low[0] <= sides[0] * (1.0 + 1e-12)
    assert at_knot.high[0] >= sides[1] * (1.0 - 1e-12)
    smooth = enclosed(TABLES["cubic"])
    for jump in (TABLES["cubic"].knots[0], TABLES["cubic"].knots[-1]):
        moved = np.array([jump + low]), np.array([jump + high])
        assert np.array(smooth.slopes(*moved)).ravel().tolist() == [-np.inf, np.inf]
        with np.errstate(invalid="ignore"):
            line = smooth.line((moved[0], *moved))
        for value in (float(TABLES["cubic"].at(np.array(jump + side))) for side in (-1e-12, 1e-12)):
            assert abs(value - line.value[0]) <= line.rest[0] + 1e-9


@pytest.mark.parametrize("kind", ["log", "sqrt", "inverse"])
@pytest.mark.parametrize("low", [-1.0, -1e-12, 0.0])
def test_a_range_beyond_the_domain_has_no_bound(kind: str, low: float) -> None:
    """Nothing bounds a function on a range that contains 0, where it is not defined."""
    function = ENCLOSED[kind]
    ends = np.array([low]), np.array([2.0])
    with np.errstate(all="ignore"):
        assert function.curve is not None
        for enclose in (function.curve, function.line):
            found = enclose((np.array([1.5]), *ends))
            assert not (np.isfinite(found.rest) and np.isfinite(found.value))
        assert not np.all(np.isfinite(function.slopes(*ends)))


@pytest.mark.parametrize("name", TABLES)
def test_each_part_of_an_enclosure_contains_a_table(name: str) -> None:
    """Parabolas, lines and slopes enclose tables, also beyond their ends."""
    spline = TABLES[name]
    exact = Exact(_exact(spline, 0), _exact(spline, 1), widths=(1e-13, 1e-6, 0.1, 1.0, 4.0))
    _check(enclosed(spline), exact, 150, 9)


def test_elementary_functions_satisfy_their_error_bounds() -> None:
    """The errors of the elementary functions remain below their stated bounds."""
    generator = np.random.default_rng(2)
    quarters = np.round(generator.uniform(-4e4, 4e4, 200)) * np.pi / 2.0
    angles = np.concatenate(
        [generator.uniform(-16.0, 16.0, 300), generator.uniform(-6e4, 6e4, 300), quarters]
    )
    positive = 10.0 ** generator.uniform(-300.0, 300.0, 800)
    powers = np.concatenate([generator.uniform(-20.0, 20.0, 400), np.linspace(-700.0, 709.0, 400)])
    sine, cosine = sin_cos(angles)
    logarithm, of_log = log(positive)
    arc, of_arc = atan(angles)
    for index, angle in enumerate(angles.tolist()):
        t = arb(angle)
        power = arb(powers[index])
        assert abs(arb(sine[index]) - t.sin()) < SIN_ERROR
        assert abs(arb(cosine[index]) - t.cos()) < SIN_ERROR
        assert abs(arb(tanh(powers)[index]) - power.tanh()) < TANH_ERROR
        assert abs(arb(exp(powers)[index]) - power.exp()) < EXP_ERROR * power.exp()
        assert abs(arb(arc[index]) - t.atan()) < of_arc[index]
        assert abs(arb(logarithm[index]) - arb(positive[index]).log()) < of_log[index]


def test_exp_underflows_within_its_bound_and_refuses_to_overflow() -> None:
    """e^t is 0 within `UNDERFLOW` far below 0, and nan for t > 709. sin and cos end at 65536."""
    assert np.all(exp(np.array([-700.0, -745.0, -1e9, -np.inf])) <= UNDERFLOW)
    assert np.all(np.isnan(exp(np.array([709.1, 1e9, np.inf, np.nan]))))
    assert np.all(np.isnan(sin_cos(np.array([65537.0, -1e9, np.inf]))))
