"""Enclosures contain every value of a function, including rounding errors."""

from __future__ import annotations

from collections.abc import Callable
from fractions import Fraction

import casadi as ca
import numpy as np
import pytest

from hfa_prove.enclosure.program import Program
from hfa_prove.enclosure.slopes import Intervals, between, jacobian, values_at
from hfa_prove.enclosure.taylor import Models, TaylorProgram, highest, lowest, pairs_of
from hfa_support.errors import BadInputError

TABLE = ca.interpolant("table", "linear", [[-1.0, -0.2, 0.0, 0.3]], [0.3, -0.2, 0.0, 0.1])
SMOOTH = ca.interpolant(
    "smooth", "bspline", [[-3.0, -0.4, -0.1, 0.0, 0.2, 3.0]], [0.3, -0.2, 0.0, 0.1, 0.0, 1.0]
)
SURFACE = ca.interpolant(
    "surface", "linear", [[-1.0, 0.0, 0.4], [1.5, 2.0, 2.1]], np.sin(np.arange(9.0)).tolist()
)
QUADRATIC = ca.interpolant(
    "quadratic",
    "bspline",
    [[-2.0, -0.4, 0.0, 0.1, 2.0]],
    [0.3, -0.2, 0.0, 0.1, 1.0],
    {"degree": [2]},
)
TWO = ca.interpolant(
    "two",
    "bspline",
    [[-2.0, -0.3, 0.0, 2.0], [0.0, 1.9, 2.1, 4.0]],
    np.cos(np.arange(32.0)).tolist(),
)


def every_operation() -> ca.Function:
    y = ca.SX.sym("y", 3)
    a, b = 2 + 0.3 * y[0] + 0.1 * y[1], 0.3 * y[0] - 0.2 * y[1] + 0.5 * y[2]
    expressions = [
        *(ca.sqrt(a) / (a + b**2), ca.sin(b) * ca.cos(a), ca.exp(b) - ca.log(a), ca.tan(b) * a**3),
        *(ca.atan(b) - 1 / a, a**1.5, ca.tanh(3 * b) * b, ca.fmax(b, 0.1 * b) + ca.fmin(b, 0.2)),
        *(ca.atan2(b, a), ca.atan2(a, b), ca.atan2(-a, b - a), ca.asin(0.7 * b)),
        *(ca.fabs(b) * a, ca.expm1(ca.fmin(b, 0)) + ca.log1p(a), y[0] * y[1] * y[2] ** 3),
        *(ca.acos(0.7 * b), a**-3, ca.exp(-(((b - 9) / 0.2) ** 2)), ca.sin(1e3 * b) * 1e-3),
        *(ca.fmax(b, b + 0.1) - ca.fmin(a + 0.1, a), (b + b) * a, a**b),
        *(f(0.5 * (a + b) - 0.5 * a - 0.5 * b) for f in (ca.cos, ca.exp, ca.sin, ca.atan)),
        *(b - ca.fmax(0, ca.fabs(b) - 0.1), TABLE(b) * a, SMOOTH(b) - SURFACE(ca.vertcat(b, a))),
        *(QUADRATIC(b) * a, TWO(ca.vertcat(b, a))),
    ]
    return ca.Function("f", [y], [ca.vertcat(*expressions)])


def every_switch() -> ca.Function:
    """Return functions with jumps."""
    y = ca.SX.sym("y", 3)
    a, b = y[0] + 0.3 * y[1], y[2] - 0.2 * y[0]
    expressions = [
        *(ca.sign(a) + b, ca.if_else(a > b, a**2, b), ca.if_else(a <= 0.1, ca.sin(b), 2.0)),
        ca.if_else(ca.logic_and(a > 0, ca.logic_not(b > 0.1)), a, b),
        ca.if_else(ca.logic_or(a > 0.2, b > 0.1), a * b, b),
        ca.gradient(ca.fmax(a, 0.0) * b, y)[0],
        (a > 0) / (2 + b),
        ca.jacobian(TABLE(a) + SURFACE(ca.vertcat(b, a + 2.0)), y).T,
    ]
    return ca.Function("f", [y], [ca.densify(ca.vertcat(*expressions))])


@pytest.mark.parametrize("make", [every_operation, every_switch])
@pytest.mark.parametrize("half_width", [0.5, 1e-8])
def test_taylor_models_enclose_every_operation(
    half_width: float, make: Callable[[], ca.Function]
) -> None:
    """For each operation, the Taylor models enclose the function at random points of random boxes."""
    generator = np.random.default_rng(0)
    function = make()
    centres = generator.uniform(-0.5, 0.5, (100, 3))
    half_widths = half_width * generator.uniform(0.2, 1.0, centres.shape)
    models = TaylorProgram(Program(function, "f"), 3).over(centres, half_widths)
    low = lowest(models, 3)
    high = highest(models, 3)
    for _ in range(20):
        shares = np.clip(generator.uniform(-1.3, 1.3, centres.shape), -1.0, 1.0)
        values = np.array(function((centres + half_widths * shares).T))
        assert np.all((low <= values) & (values <= high))


@pytest.mark.parametrize("slope", [0.0, 0.5, 1.0, 2.0])
def test_functions_of_squares_contain_the_ends_of_boxes(slope: float) -> None:
    """The enclosure of exp(slope y + y²) contains the values at the ends of a box about y = 0.

    The square of the argument contains the product of both terms.
    """
    y = ca.SX.sym("y", 1)
    for half_width in (0.01, 0.1, 0.5):
        function = ca.Function("f", [y], [ca.exp(slope * y + y**2)])
        models = TaylorProgram(Program(function, "f"), 1).over(
            np.zeros((1, 1)), np.full((1, 1), half_width)
        )
        values = [float(function(end)) for end in (-half_width, half_width)]
        assert lowest(models, 1)[0, 0] <= min(values)
        assert highest(models, 1)[0, 0] >= max(values)


@pytest.mark.parametrize("half_width", [0.5, 1e-8])
def test_sharpened_bounds_are_valid_for_every_operation(half_width: float) -> None:
    """Sharpened lower bounds are valid for every operation and at least as high as `lowest`.

    The third input has an error of 1 % of its half-width.
    """
    generator = np.random.default_rng(0)
    function = every_operation()
    centres = generator.uniform(-0.5, 0.5, (100, 3))
    half_widths = half_width * generator.uniform(0.2, 1.0, centres.shape)
    program = TaylorProgram(Program(function, "f"), 3)
    linear = np.zeros((3, 4, 100))
    linear[:, 0] = centres.T
    linear[np.arange(3), np.arange(1, 4)] = half_widths.T
    radius = np.zeros((3, 100))
    radius[2] = 0.01 * half_widths[:, 2]
    traced = program.traced(linear, radius)
    every = np.arange(100)
    for output in range(function.numel_out(0)):
        found = program.sharpened(traced, np.full(100, output), every)
        assert np.all(found.lowest >= lowest(traced.outputs, 3)[output])
        for _ in range(4):
            shares = np.clip(generator.uniform(-1.3, 1.3, centres.shape), -1.0, 1.0)
            off = radius.T * generator.uniform(-1.0, 1.0, centres.shape)
            values = np.array(function((centres + half_widths * shares + off).T))
            assert np.all(found.lowest <= values[output])


def test_errors_of_two_paths_cancel() -> None:
    """Errors that reach the output on two paths cancel in the sharpened bound.

    max(k + 9, 0) - k is 9 for k >= -9, although the error of k enters twice.
    """
    y = ca.SX.sym("y", 2)
    k = ca.fmax(y[0] + 0.1 * y[1], 0.0)
    program = TaylorProgram(Program(ca.Function("f", [y], [ca.fmax(k + 9.0, 0.0) - k]), "f"), 2)
    box = (np.array([[0.1, 0.0]]), np.ones((1, 2)))
    assert lowest(program.over(*box), 2)[0, 0] < 8.5
    linear = np.zeros((2, 3, 1))
    linear[:, 0], linear[[0, 1], [1, 2]] = box[0].T, box[1].T
    traced = program.traced(linear, np.zeros((2, 1)))
    first = np.zeros(1, dtype=int)
    assert program.sharpened(traced, first, first).lowest == pytest.approx([9.0], abs=1e-9)
    program._row = 1e-3  # a planted rounding error of the weights must be included
    assert program.sharpened(traced, first, first).lowest < 9.0 - 4e-3 * traced.outputs.radius[0, 0]


def _rounded(y: ca.SX) -> dict[str, ca.SX]:
    kink = ca.fmax(y[0] + 0.1 * y[1] + 2.0, 0.0)
    return {
        "outputs": y[0] + 0.1 * y[1] + 2.0,
        "kinks": kink,
        "rows of kinks": 1e6 * ca.fmax(1e-3 * y[0] + 0.1 * y[1] + 2.0, 0.0),
        "products": kink * (0.3 * y[0] + y[1] + 2.0),
        "curves": 1e6 * ca.sqrt(y[0] + 2.0) / (y[1] + 3.0),
    }


@pytest.mark.parametrize("name", _rounded(ca.SX.sym("y", 2)))
def test_sharpened_bounds_include_rounding(name: str) -> None:
    """Sharpened bounds include rounding, also if it is the only error."""
    y = ca.SX.sym("y", 2)
    program = TaylorProgram(Program(ca.Function("f", [y], [_rounded(y)[name]]), "f"), 2)
    linear = np.zeros((2, 3, 1))
    linear[:, 0] = 0.3
    linear[[0, 1], [1, 2]] = 1e-12
    traced = program.traced(linear, np.zeros((2, 1)))
    first = np.zeros(1, dtype=int)
    found = program.sharpened(traced, first, first).lowest[0]
    bound = lowest(traced.outputs, 2)[0, 0]
    assert bound <= found <= bound + 1e-3 * traced.outputs.radius[0, 0]


def test_the_chain_rule_encloses_every_derivative() -> None:
    """The enclosed Jacobian contains the derivatives of CasADi at 100 random points."""
    generator = np.random.default_rng(1)
    function = every_operation()
    y = ca.SX.sym("y", 3)
    slopes = ca.Function("J", [y], [ca.jacobian(function(y), y)])
    centre = np.array([0.1, -0.3, 0.2])
    found = jacobian(Program(function, "f"), Intervals(centre, np.full(3, 0.3)))
    for _ in range(100):
        place = centre + generator.uniform(-0.3, 0.3, 3)
        values = np.array(slopes(place))
        assert np.all(found.slopes.low - 1e-13 <= values)
        assert np.all(values <= found.slopes.high + 1e-13)


def test_the_lowest_value_of_a_model_is_not_rounded_up() -> None:
    """The lower bound of c_0 + Σ c_i s_i + Σ c_ii s_i² ± r is at most the exact minimum.

    With c_ii < 0, the minimum is at a corner.
    """
    rng = np.random.default_rng(11)
    n, boxes = 3, 300
    c = rng.normal(size=(1, 1 + n + n * (n + 1) // 2, boxes)) * 10.0 ** rng.integers(-3, 4, boxes)
    i, j, _ = pairs_of(n)
    c[:, n + 1 :] = np.where((i == j)[:, None], -np.abs(c[:, n + 1 :]), 0.0)
    radius = np.abs(rng.normal(size=(1, boxes)))
    models = Models(c, radius, radius)
    low = lowest(models, n)[0]
    for k in range(boxes):
        value, *slopes = map(Fraction, c[0, : 1 + n, k].tolist())
        bends = sum(map(Fraction, c[0, n + 1 :, k].tolist()))
        exact = value - sum(map(abs, slopes)) + bends - Fraction(float(radius[0, k]))
        size = Fraction(float(np.abs(c[0, :, k]).sum() + radius[0, k]))
        assert exact - size / 10**12 <= Fraction(float(low[k])) <= exact


def test_rounding_of_canceling_arguments_is_covered() -> None:
    """The bounds of max(1e8 w'y, 0) contain its exact value at points where w'y nearly cancels."""
    generator = np.random.default_rng(7)
    w = generator.normal(size=3)
    y = ca.SX.sym("y", 3)
    function = ca.Function("f", [y], [ca.fmax(ca.dot(ca.DM(1e8 * w), y), 0.0)])
    points = generator.normal(size=(100, 3))
    points[:, 2] = -(points[:, :2] @ w[:2]) / w[2] + 1e-9 * generator.uniform(-1.0, 1.0, 100)
    program = Program(function, "f")
    models = TaylorProgram(program, 3).over(points, np.zeros((100, 3)))
    low, high = lowest(models, 3)[0], highest(models, 3)[0]
    for point, least, most in zip(points, low, high, strict=True):
        pairs = zip((1e8 * w).tolist(), point.tolist(), strict=True)
        exact = max(sum(Fraction(a) * Fraction(b) for a, b in pairs), Fraction(0))
        assert Fraction(float(least)) <= exact <= Fraction(float(most))
        assert _inside(jacobian(program, Intervals(point, np.zeros(3))).values, 0, exact)


def test_functions_that_are_not_inlined_are_read() -> None:
    """A function that CasADi calls without inlining it is read like its operations."""
    y = ca.SX.sym("y", 2)
    z = ca.SX.sym("z", 2)
    outputs = [z[0] * ca.sin(z[1]), ca.vertcat(z[1] ** 2, z[0])]
    called = ca.Function("g", [z], outputs, {"never_inline": True})
    first, second = called(2 * y)
    function = ca.Function("f", [y], [first - second[0] + second[1]])
    points = np.random.default_rng(0).uniform(-1.0, 1.0, (20, 2))
    expected = np.array(function(points.T)).T
    assert values_at(Program(function, "f"), points) == pytest.approx(expected, rel=1e-12)


@pytest.mark.parametrize(
    ("expression", "named"),
    [
        (lambda y: y * np.inf, "inf"),
        (lambda y: ca.atan2(0.0, y), "atan2"),
        (lambda y: ca.erf(y), "erf"),
        (lambda y: ca.vertcat(*(ca.sin(k * y) for k in range(1, 7))), "operations"),
        (lambda y: sum((k * y * y for k in range(1, 11)), y), "operations"),
    ],
)
def test_unsupported_functions_are_refused(
    expression: Callable[[ca.SX], ca.SX], named: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A function that cannot be enclosed, or that is too large, is refused in one line."""
    monkeypatch.setattr("hfa_prove.enclosure.program.LARGEST", 20)
    monkeypatch.setattr("hfa_prove.enclosure.program.MOST_NODES", 5)
    y = ca.SX.sym("y")
    with pytest.raises(BadInputError, match=named):
        Program(ca.Function("f", [y], [expression(y)]), "f")


def test_a_function_that_is_solved_for_is_refused() -> None:
    """A function that CasADi computes by iteration has no operations to enclose."""
    y = ca.SX.sym("y")
    z = ca.SX.sym("z")
    root = ca.rootfinder("root", "newton", {"x": z, "p": y, "g": z**3 + z - y})
    x = ca.MX.sym("x")
    function = ca.Function("f", [x], [root(x0=0.0, p=x)["x"]])
    with pytest.raises(BadInputError, match="function root"):
        Program(function, "f")


FRACTIONS = [Fraction(each) for each in (-1.0, -0.25, 0.0, 0.5, 1.0)]


def _inside(found: Intervals, index: int, value: Fraction) -> bool:
    return Fraction(float(found.low[index])) <= value <= Fraction(float(found.high[index]))


def test_intervals_contain_exact_sums_and_products() -> None:
    """Sums, products and hulls contain the exact results of all points of their intervals."""
    rng = np.random.default_rng(8)
    size = 200
    scales = 10.0 ** rng.integers(-12, 12, (4, size))
    m, n = scales[:2] * rng.normal(size=(2, size))
    r, q = np.abs(scales[2:] * rng.normal(size=(2, size))) * rng.choice([0.0, 1.0], size=(2, size))
    a, b = Intervals(m, r), Intervals(n, q)
    both = between(np.minimum(m, n), np.maximum(m, n))
    products, sums = a.times(b), a.plus(b)
    for i in range(size):
        for s in FRACTIONS:
            x = Fraction(float(m[i])) + s * Fraction(float(r[i]))
            assert _inside(a, i, x)
            assert _inside(both, i, (x - x) + Fraction(float((m, n)[s > 0][i])))
            for t in FRACTIONS:
                y = Fraction(float(n[i])) + t * Fraction(float(q[i]))
                assert _inside(products, i, x * y)
                assert _inside(sums, i, x + y)


def test_only_steps_of_opposite_arguments_are_a_slope() -> None:
    """A step divided by the sum of two steps is 1/2 where both are 1, unless they are opposite."""
    y = ca.SX.sym("y", 2)
    share = (y[0] > 0) / ((y[0] > 0) + (y[1] > 0))
    found = values_at(Program(ca.Function("f", [y], [share]), "f"), np.array([[1.0, 1.0], [1, -1]]))
    assert found.ravel().tolist() == [0.5, 1.0]
