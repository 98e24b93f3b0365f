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
#: Shapes V + s W that the projectors of one of two points do not tell apart.
TURNING = np.array([[0.1, 0.9, 0.6], [0.3, -0.3, -0.2], [-0.1, 0.6, 0.8]])
TURN = np.array([[-0.3, 0.1, -0.2], [-0.1, -0.2, 0.3], [0.1, -0.1, -0.2]])


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


def crossing(shapes, turn=0.0):
    """Return a plant with λ = -3 + s, -1 - s + t and -0.1."""
    return plant(
        "abc",
        lambda s, t: (
            ca.SX(shapes) + s * ca.DM(turn + np.zeros((3, 3))),
            ca.diag(ca.vertcat(-3.0 + s, -1.0 - s + t, -0.1)),
        ),
    )


@pytest.mark.parametrize(
    ("shapes", "turn", "grid"),
    [(SHAPES, 0.0, [0.0, 0.15, 0.3]), (NEARLY_PARALLEL, 0.0, [0.0]), (TURNING, TURN, [0.0])],
    ids=["over a grid", "2 degrees apart", "turning"],
)
def test_eigenvalues_that_cross_keep_their_columns(shapes, turn, grid):
    """Modes keep their columns through a crossing, although another eigenvalue is nearer."""
    swept = sweep(crossing(shapes, turn), s=np.linspace(0.0, 2.0, 8), t=grid)
    s, t = swept.values.T
    expected = np.stack([-3.0 + s, -1.0 - s + t, np.full_like(s, -0.1)], axis=1)
    np.testing.assert_allclose(swept.eigenvalues, expected, atol=1e-11)


@pytest.mark.parametrize("pair", [1j, -1.0 + 0.3j])
@pytest.mark.parametrize("seed", range(4))
def test_eigenvalues_far_apart_keep_their_columns_whatever_their_shapes_do(seed, pair):
    """The eigenvalues 1, -1 and a pair, with other random mode shapes at each point of a grid, keep
    their columns, also where the path to a point leads back along an axis.
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


def test_modes_that_exchange_their_shapes_keep_their_eigenvalues():
    """Two modes with shapes 2 degrees apart turn into each other: -3 and -0.3 keep their columns."""

    def modes(s, t):
        shapes = [ca.vertcat(ca.cos(angle), ca.sin(angle)) for angle in (s, 0.035 - s)]
        return ca.horzcat(*shapes), ca.diag(ca.DM([-3.0, -0.3]))

    swept = sweep(plant("ab", modes), s=[0.0, 0.035])
    np.testing.assert_allclose(swept.eigenvalues, [[-3.0, -0.3], [-3.0, -0.3]], atol=1e-9)


def test_a_pair_that_becomes_real_keeps_its_columns():
    """v'' = -s v, where s changes its sign again and again: the lower real eigenvalue comes first,
    whichever of the two is nearer by a rounding.
    """
    shapes = ca.DM(SHAPES[:2, :2])  # V of D, the dynamics of (v, v')
    oscillator = plant("ab", lambda s, t: (shapes, ca.blockcat([[0.0, 1.0], [-s, 0.0]])))
    s = np.linspace(1.0, 4.0, 30) * np.resize([1.0, -1.0], 30)
    first = np.where(s > 0.0, 1j, -1.0) * np.sqrt(np.abs(s))
    found = sweep(oscillator, s=s).eigenvalues
    np.testing.assert_allclose(found, np.stack([first, -first], axis=1), atol=1e-12)
