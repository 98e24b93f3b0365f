"""Sweeps keep each mode in its column through crossings, along lines and over grids."""

import casadi as ca
import numpy as np
import pytest

from hfa import Model, Signal, sweep

#: Three mode shapes that are far from parallel, and three of which two are two degrees apart.
SHAPES = np.array([[1.0, 0.2, 0.3], [0.1, 1.0, -0.4], [0.3, -0.2, 1.0]])
NEARLY_PARALLEL = np.array(
    [[1.0, np.cos(np.radians(2)), 0.0], [0.0, np.sin(np.radians(2)), 0.0], [0.0, 0.0, 1.0]]
)
STATES = ("a", "b", "c")


def plant(shapes):
    """Return x' = V diag(λ) V⁻¹ x with λ = -3 + s, -1 - s + t and -.1, over parameters s and t."""
    inverse = np.linalg.inv(shapes)

    def equations(x, u, p, w):
        eigenvalues = ca.vertcat(-3.0 + p.s, -1.0 - p.s + p.t, -0.1)
        rates = ca.DM(shapes) @ (eigenvalues * (ca.DM(inverse) @ ca.vertcat(*x)))
        return dict(zip(STATES, ca.vertsplit(rates + u.force), strict=True)), {}

    parameters = {"s": Signal(), "t": Signal()}
    signals = dict.fromkeys(STATES, Signal())
    return Model("plant", signals, {"force": Signal()}, equations, parameters=parameters)


@pytest.mark.parametrize("shapes", [SHAPES, NEARLY_PARALLEL], ids=["apart", "2 degrees apart"])
def test_eigenvalues_that_cross_keep_their_columns(shapes):
    """Modes keep their columns through a crossing, although another eigenvalue is nearer."""
    s = np.linspace(0.0, 2.0, 8)
    expected = np.stack([-3.0 + s, -1.0 - s, np.full_like(s, -0.1)], axis=1)
    nearest = np.abs(expected[3, 0] - expected[4, 1]) < np.abs(expected[3, 0] - expected[4, 0])
    assert nearest
    swept = sweep(plant(shapes), s=s)
    np.testing.assert_allclose(swept.eigenvalues, expected, atol=1e-11)


def test_modes_keep_their_columns_over_a_grid():
    """On a grid of two variables, crossings along both keep the columns."""
    s, t = np.linspace(0.0, 2.0, 8), np.array([0.0, 0.15, 0.3])
    swept = sweep(plant(SHAPES), s=s, t=t)
    at = swept.values
    expected = np.stack([-3.0 + at[:, 0], -1.0 - at[:, 0] + at[:, 1], np.full(24, -0.1)], axis=1)
    np.testing.assert_allclose(swept.eigenvalues, expected, atol=1e-11)


def varied_plant(seed):
    """Return x' = V D V⁻¹ x with the constant eigenvalues 1, -1, i, -i, and with shapes V that are
    others at each point of a grid over s and t.
    """
    phase, by_s, by_t = (ca.DM(each) for each in np.random.default_rng(seed).normal(size=(3, 4, 4)))
    constant = ca.DM([[1, 0, 0, 0], [0, -1, 0, 0], [0, 0, 0, 1], [0, 0, -1, 0]])
    names = "abcd"

    def equations(x, u, p, w):
        shapes = ca.sin(10.0 * (phase + by_s * p.s + by_t * p.t))
        rates = shapes @ (constant @ ca.solve(shapes, ca.vertcat(*x)))
        return dict(zip(names, ca.vertsplit(rates + u.force), strict=True)), {}

    signals = dict.fromkeys(names, Signal())
    parameters = {"s": Signal(), "t": Signal()}
    return Model("varied", signals, {"force": Signal()}, equations, parameters=parameters)


@pytest.mark.parametrize("seed", range(4))
def test_eigenvalues_far_apart_keep_their_columns_whatever_their_shapes_do(seed):
    """On a grid, also where the path to a point leads back along an axis."""
    swept = sweep(varied_plant(seed), s=[0.0, 1.0, 2.0, 3.0], t=[0.0, 1.0, 2.0, 3.0])
    first = swept.eigenvalues[0]
    for eigenvalue in (1.0, -1.0, 1j, -1j):
        assert np.abs(first - eigenvalue).min() < 1e-6
    np.testing.assert_allclose(swept.eigenvalues, np.tile(first, (16, 1)), atol=1e-6)


def test_modes_that_exchange_their_shapes_keep_their_eigenvalues():
    """Two modes with shapes 2 degrees apart turn into each other: -3 and -0.3 keep their columns."""

    def equations(x, u, p, w):
        first, second = (ca.vertcat(ca.cos(angle), ca.sin(angle)) for angle in (p.s, 0.035 - p.s))
        shapes = ca.horzcat(first, second)
        rates = shapes @ (ca.DM([-3.0, -0.3]) * ca.solve(shapes, ca.vertcat(*x)))
        return dict(zip("ab", ca.vertsplit(rates + u.force), strict=True)), {}

    signals = dict.fromkeys("ab", Signal())
    model = Model("turned", signals, {"force": Signal()}, equations, parameters={"s": Signal()})
    swept = sweep(model, s=[0.0, 0.035])
    np.testing.assert_allclose(swept.eigenvalues, [[-3.0, -0.3], [-3.0, -0.3]], atol=1e-9)


def test_a_pair_that_becomes_real_keeps_its_columns():
    """x'' = -k x at k = 1, -1 and 1: the lower real eigenvalue comes first."""
    oscillator = Model(
        "oscillator",
        {"x": Signal(), "v": Signal()},
        {"u": Signal()},
        lambda x, u, p, w: ({"x": x.v, "v": u.u - p.k * x.x}, {}),
        parameters={"k": Signal()},
    )
    found = sweep(oscillator, k=[1.0, -1.0, 1.0]).eigenvalues
    np.testing.assert_allclose(found, [[1j, -1j], [-1.0, 1.0], [1j, -1j]], atol=1e-12)
