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
#: Mode shapes V + s W, which change so much from point to point that the projectors of one of two
#: points do not tell them apart: V and W.
CHANGING = np.array([[0.1, 0.9, 0.6], [0.3, -0.3, -0.2], [-0.1, 0.6, 0.8]])
CHANGE_PER_S = np.array([[-0.3, 0.1, -0.2], [-0.1, -0.2, 0.3], [0.1, -0.1, -0.2]])


def plant(names, modes):
    """Return x' = V D V⁻¹ x + u.

    modes: function of the parameters s and t -> mode shapes V, the columns, and dynamics D in these
    """

    def equations(x, u, p, w):
        shapes, dynamics = modes(p.s, p.t)
        rates = shapes @ (dynamics @ ca.solve(ca.SX(shapes), ca.vertcat(*x)))
        return dict(zip(names, ca.vertsplit(rates + u.force), strict=True)), {}

    signals, parameters = dict.fromkeys(names, Signal()), {"s": Signal(), "t": Signal()}
    return Model("plant", signals, {"force": Signal()}, equations, parameters=parameters)


def crossing(shapes, change_per_s=0.0):
    """Return a plant with λ = -3 + s, -1 - s + t and -0.1, and mode shapes that change with s."""
    return plant(
        "abc",
        lambda s, t: (
            ca.SX(shapes) + s * ca.DM(change_per_s + np.zeros((3, 3))),
            ca.diag(ca.vertcat(-3.0 + s, -1.0 - s + t, -0.1)),
        ),
    )


@pytest.mark.parametrize(
    ("shapes", "change_per_s", "values_of_t"),
    [
        (SHAPES, 0.0, [0.0, 0.15, 0.3]),
        (NEARLY_PARALLEL, 0.0, [0.0]),
        (CHANGING, CHANGE_PER_S, [0.0]),
    ],
    ids=["over a grid", "2 degrees apart", "changing"],
)
def test_eigenvalues_that_cross_keep_their_columns(shapes, change_per_s, values_of_t):
    """The eigenvalues -3 + s and -1 - s + t cross near s = 1. Each keeps its column, as its mode shape
    tells, although beyond the crossing the other eigenvalue is nearer to the previous one.

    Mode shapes are the columns of `shapes` + s `change_per_s`.
    """
    swept = sweep(crossing(shapes, change_per_s), s=np.linspace(0.0, 2.0, 8), t=values_of_t)
    s, t = swept.values.T
    expected = np.stack([-3.0 + s, -1.0 - s + t, np.full_like(s, -0.1)], axis=1)
    np.testing.assert_allclose(swept.eigenvalues, expected, atol=1e-11)


@pytest.mark.parametrize("pair", [1j, -1.0 + 0.3j])
@pytest.mark.parametrize("seed", range(4))
def test_eigenvalues_far_apart_keep_their_columns_whatever_their_shapes_do(seed, pair):
    """The eigenvalues 1, -1 and a pair are constant, and far apart: they keep their columns at all points of
    a grid, although their mode shapes, random functions of s and t, tell nothing.
    """
    phase, by_s, by_t = map(ca.DM, np.random.default_rng(seed).normal(size=(3, 4, 4)))
    real, imaginary = pair.real, pair.imag
    dynamics = ca.diagcat(1.0, -1.0, ca.DM([[real, imaginary], [-imaginary, real]]))
    modes = plant("abcd", lambda s, t: (ca.sin(10.0 * (phase + by_s * s + by_t * t)), dynamics))
    swept = sweep(modes, s=[0.0, 1.0, 2.0, 3.0], t=[0.0, 1.0, 2.0, 3.0])
    first = swept.eigenvalues[0]
    for eigenvalue in (1.0, -1.0, pair, np.conj(pair)):
        assert np.abs(first - eigenvalue).min() < 1e-6
    np.testing.assert_allclose(swept.eigenvalues, np.tile(first, (16, 1)), atol=1e-6)
