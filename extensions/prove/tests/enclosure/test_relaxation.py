"""Enclosures of networks over boxes, and the branch and bound on them."""

from __future__ import annotations

from collections.abc import Callable
from fractions import Fraction

import casadi as ca
import numpy as np
import pytest

from hfa_prove.enclosure.relaxation import Relaxation
from hfa_prove.network import Proof, _halves, prove

ACTIVATIONS: dict[str, Callable[[ca.SX], ca.SX]] = {
    "tanh": ca.tanh,
    "relu": lambda t: ca.fmax(t, 0.0),
    "cube": lambda t: t**3,
    "clip": lambda t: ca.fmin(ca.fmax(t, -0.7), 0.4),
}


def random_network(activation: str, seed: int, of_gradient: bool = False) -> ca.Function:
    """Return a random function of four inputs: a network plus a linear and a quadratic part.

    The network has two hidden layers of 8 units.

    of_gradient: whether the network is replaced by the gradient of its first output
    """
    rng = np.random.default_rng(seed)
    y = ca.SX.sym("y", 4)
    h = y
    for _ in range(2):
        weights = rng.normal(size=(8, h.numel())) * rng.uniform(0.2, 1.5)
        h = ACTIVATIONS[activation](ca.DM(weights) @ h + ca.DM(rng.normal(size=8)))
    outputs = ca.DM(rng.normal(size=(2, 8))) @ h
    if of_gradient:
        outputs = ca.gradient(outputs[0], y)
    quadratic = ca.bilin(ca.DM(rng.normal(size=(4, 4))), y, y)
    linear = ca.DM(rng.normal(size=(outputs.numel(), 4))) @ y
    return ca.Function("network", [y], [ca.densify(outputs + linear + quadratic)])


def test_bounds_cover_the_rounding_of_sums() -> None:
    """The exact magnitude of an affine function at a point lies between its bounds."""
    rng = np.random.default_rng(3)
    for _ in range(20):
        slopes = rng.normal(size=6) * 10.0 ** rng.uniform(0.0, 8.0, 6)
        point = rng.normal(size=6)
        y = ca.SX.sym("y", 6)
        bounds = Relaxation(ca.Function("f", [y], [ca.DM(slopes).T @ y + 1.0]), "f").over(
            point[None], np.zeros((1, 6))
        )
        terms = [Fraction(a) * Fraction(b) for a, b in zip(slopes, point, strict=True)]
        exact = abs(sum(terms) + 1)
        assert bounds.lowest[0] <= exact <= bounds.highest[0]


@pytest.mark.parametrize(
    ("activation", "of_gradient"),
    [("tanh", True), ("relu", False), ("clip", False), ("cube", True)],
)
def test_no_sample_in_the_box_exceeds_the_bound(activation: str, of_gradient: bool) -> None:
    """No sample of a network in a box exceeds the upper bound over the box.

    The lower bound of the largest value is at most the upper bound. For small boxes, both bounds
    agree to 1 %.
    """
    rng = np.random.default_rng(7)
    for seed in range(3):
        function = random_network(activation, seed, of_gradient)
        half_widths = 10.0 ** rng.uniform(-4.0, 0.0, (8, 1)) * rng.uniform(0.1, 1.0, (8, 4))
        centres = rng.uniform(-1.0, 1.0, (8, 4)) * (1.0 - half_widths)
        bounds = Relaxation(function, "f").over(centres, half_widths)
        assert np.all(bounds.highest < np.inf)
        for index, (centre, half_width) in enumerate(zip(centres, half_widths, strict=True)):
            y = rng.uniform(-1.0, 1.0, (500, 4))
            y[::2] = np.sign(y[::2])
            largest = np.abs(np.array(function((centre + half_width * y).T))).max()
            assert largest <= bounds.highest[index] * (1.0 + 1e-14)
            assert bounds.lowest[index] <= bounds.highest[index]
        assert bounds.highest[half_widths.max(axis=1) < 1e-3] == pytest.approx(
            bounds.lowest[half_widths.max(axis=1) < 1e-3], rel=1e-2, abs=1e-2
        )


def test_the_bound_includes_rounding() -> None:
    """The bound of a function includes rounding errors.

    At single points, the bound is at least the value of Σ max(w'y, 0) - Σ w'y in rational
    arithmetic, for weights w of size 1e8.
    """
    rng = np.random.default_rng(1)
    weights = rng.normal(size=(16, 3)) * 1e8
    y = ca.SX.sym("y", 3)
    units = ca.fmax(ca.DM(weights) @ y, 0.0)
    function = ca.Function("f", [y], [ca.sum1(units) - ca.DM(weights.sum(axis=0)).T @ y])
    centres = np.abs(rng.normal(size=(40, 3))) / 3.0
    bounds = Relaxation(function, "f").over(centres, np.zeros((40, 3)))
    for centre, highest in zip(centres, bounds.highest, strict=True):
        state = list(map(Fraction, centre))
        exact = -sum(map(lambda w, x: Fraction(w) * x, weights.sum(axis=0), state))
        for row in weights:
            exact += max(sum(map(lambda w, x: Fraction(w) * x, row, state)), Fraction(0))
        assert abs(exact) <= Fraction(highest)


def test_a_fraction_ends_before_the_first_error() -> None:
    """The fraction of the box with a proved bound excludes the nearest state with a larger error.

    The printed fraction is rounded down. A bound that is true in the whole box is proved there.
    """
    y = ca.SX.sym("y", 2)
    function = ca.Function("f", [y], [ca.fmax(5.0 * ca.tanh(y[0]) - 3.0, 0.0) + 0.2 * y[1] ** 2])
    largest = float(function([0.6, 0.6]))
    proof = prove("error", function, np.ones(2), largest, 2.0)
    assert proof is not None
    assert proof.beyond is not None
    assert proof.fraction <= 0.6
    assert float(function(proof.beyond)) > largest
    assert Proof("error", 0.1, 0.96875, 1).where == "on 0.96 times the box"
    proof = prove("error", function, np.ones(2), 2.0, 2.0)
    assert proof == Proof("error", 2.0, 1.0, proof.boxes if proof else 0)


def test_no_fraction_is_proved_without_a_bound() -> None:
    """No fraction of the box is proved if the error equals the bound at 0.

    A bound on an error that overflows double precision is not proved in the whole box.
    """
    y = ca.SX.sym("y", 2)
    squares = ca.tanh(y[0]) ** 2 + ca.tanh(y[1]) ** 2
    proof = prove("error", ca.Function("f", [y], [1.0 - 0.1 * squares]), np.ones(2), 1.0, 0.1)
    assert proof is not None
    assert proof.beyond is None
    assert proof.fraction == 0.0
    huge = ca.Function("f", [y], [(1e200 * ca.tanh(y[0])) ** 2 * 1e-200])
    told: list[tuple[float, float, str]] = []
    proof = prove("error", huge, np.ones(2), 1e299, 0.1, lambda *each: told.append(each))
    assert all(0.0 <= done <= total == 0.1 for done, total, _ in told)
    assert told[-1][:2] == (0.1, 0.1)
    assert proof is not None
    assert proof.fraction < 1.0


@pytest.mark.parametrize("kind", ["fabs", "sign", "fmax", "fmin", "slope of fmax", "comparison"])
def test_bounds_of_kinks_are_true_and_narrow(kind: str) -> None:
    """Bounds of functions with kinks are true and narrow, compared with values at random states.

    Some boxes are centered on a kink.
    """
    y = ca.SX.sym("y", 2)
    t = y[0] - 0.3 * y[1]
    expression = {
        "fabs": ca.fabs(t) * y[1],
        "sign": ca.sign(t) + y[0],
        "fmax": ca.fmax(t, y[1]) - y[0],
        "fmin": ca.fmin(t, 0.2) * y[0],
        "slope of fmax": ca.gradient(ca.fmax(t, 0.0) * y[1], y)[0],
        "comparison": ca.if_else(t > 0.1, y[0], y[1]),
    }[kind]
    function = ca.Function("f", [y], [ca.densify(expression)])
    relaxation = Relaxation(function, "f")
    rng = np.random.default_rng(0)
    centres = rng.uniform(-1.0, 1.0, (40, 2))
    centres[:5, 0] = 0.3 * centres[:5, 1]
    halves = 10.0 ** rng.uniform(-3.0, 0.0, (40, 1)) * np.ones((1, 2))
    bounds = relaxation.over(centres, halves)
    states = centres[:, None] + halves[:, None] * rng.uniform(-1.0, 1.0, (40, 200, 2))
    found = np.abs(np.array(function(states.reshape(-1, 2).T))).reshape(40, 200).max(axis=1)
    found = np.maximum(found, np.abs(np.array(function(centres.T))).ravel())
    assert np.all(found <= bounds.highest)
    assert np.all(bounds.highest <= found + 8.0 * halves[:, 0] + 2.1 * (halves[:, 0] > 1e-9))


def test_no_bound_is_proved_if_numbers_underflow() -> None:
    """No bound is proved for 1e300 (1e-320 y_1 - 1e-320 y_2).

    The double closest to 1e-320 has a relative error of 1e-3.
    """
    y = ca.SX.sym("y", 2)
    function = ca.Function("f", [y], [1e300 * (1e-320 * y[0] - 1e-320 * y[1])])
    proof = prove("error", function, np.full(2, 1e300), 1e-6, 0.2)
    assert proof is None or proof.fraction == 0.0


def test_boxes_are_halved_across_the_largest_gap() -> None:
    """Without a known gap, the widest side is halved; both halves cover the box."""
    centres = np.array([[0.0, 1.0], [0.5, 0.5], [0.0, 0.0]])
    widths = np.array([[1.0, 0.5], [0.25, 0.5], [1.0, 0.125]])
    gaps = np.array([[0.1, 0.9], [np.inf, 1.0], [0.0, 0.0]])
    found, halved = _halves(centres, widths, gaps)
    for k, side in enumerate((1, 1, 0)):
        expected = widths[k].copy()
        expected[side] /= 2.0
        for half, sign in ((k, -1.0), (k + 3, 1.0)):
            np.testing.assert_array_equal(halved[half], expected)
            moved = found[half] - centres[k]
            assert moved[side] == sign * expected[side]
            assert moved[1 - side] == 0.0
