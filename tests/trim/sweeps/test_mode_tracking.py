"""Tracking of modes in a sweep through crossings, for any order of eigenvalues and along any
grid.
"""

from __future__ import annotations

import numpy as np
import pytest
from own_models import F16
from random_points import STATE_SCALES

import hfa
from hfa import Model, sweep
from trim.sweeps.mode_tracking import track_modes

STATES = ("alpha", "pitch_rate", "speed")
#: Three mode shapes that are far from parallel, in units of `STATE_SCALES`.
SHAPES = np.array([[1.0, 0.2, 0.3], [0.1, 1.0, -0.4], [0.3, -0.2, 1.0]])
#: Two of the shapes are two degrees apart.
NEARLY_PARALLEL = np.array(
    [[1.0, np.cos(np.radians(2)), 0.0], [0.0, np.sin(np.radians(2)), 0.0], [0.0, 0.0, 1.0]]
)


def models_with(eigenvalues: np.ndarray, shapes: np.ndarray = SHAPES) -> np.ndarray:
    """Return matrices with given eigenvalues and eigenvectors, (N, 3, 3).

    eigenvalues: (N, 3)
    shapes: (3, 3), eigenvectors as columns, in nominal sizes of the states
    """
    scales = np.array([getattr(STATE_SCALES, name) for name in STATES])
    vectors = scales[:, None] * shapes
    return np.einsum("ik,nk,kj->nij", vectors, eigenvalues, np.linalg.inv(vectors))


@pytest.mark.parametrize("shapes", [SHAPES, NEARLY_PARALLEL], ids=["apart", "2 degrees apart"])
def test_eigenvalues_that_cross_keep_their_columns(shapes: np.ndarray) -> None:
    """Modes keep their columns through a crossing, although another eigenvalue is nearer."""
    s = np.linspace(0.0, 2.0, 8)
    expected = np.stack([-3.0 + s, -1.0 - s, np.full_like(s, -0.1)], axis=1)
    nearest = np.abs(expected[3, 0] - expected[4, 1]) < np.abs(expected[3, 0] - expected[4, 0])
    assert nearest
    A = models_with(expected, shapes)
    np.testing.assert_allclose(track_modes(A, STATES, hfa.aircraft()), expected, atol=1e-11)
    two = np.einsum("ik,nk,kj->nij", shapes[:2, :2], expected[:, :2], np.linalg.inv(shapes[:2, :2]))
    nominal = np.array([hfa.aircraft().states[name].nominal for name in STATES[:2]])
    tracked = track_modes(two * nominal[:, None] / nominal, STATES[:2], hfa.aircraft())
    np.testing.assert_allclose(tracked, expected[:, :2], atol=1e-11)


def test_modes_are_followed_along_the_most_similar_neighbors() -> None:
    """Two shapes turn by 40 deg from point to point, too far between the first and the last."""
    nominal = np.array([hfa.aircraft().states[name].nominal for name in STATES[:2]])
    A = []
    for angle in np.radians([0.0, 40.0, 80.0]):
        turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
        A.append(turn @ np.diag([-2.0, -1.0]) @ turn.T * nominal[:, None] / nominal)
    for pairs in ([[0, 1], [1, 2], [0, 2]], [[0, 2], [2, 1], [1, 0]]):
        tracked = track_modes(np.array(A), STATES[:2], hfa.aircraft(), np.array(pairs))
        np.testing.assert_allclose(tracked, [[-2.0, -1.0]] * 3)


def test_a_complex_pair_is_tracked_as_one_mode() -> None:
    """A complex pair that becomes two real eigenvalues is tracked as one mode.

    At 502 ft/s the short period of the F-16 is real, on both sides of the phugoid pair.
    """
    result = sweep(F16, {"speed": [300.0, 502.0], "altitude": [0.0, 10_000.0]}, listed=True)
    names = np.array(result.mode_names)
    short, phugoid = (result.eigenvalues[1, names == name] for name in ("short period", "phugoid"))
    np.testing.assert_allclose(short, [-1.5297, 0.1323], atol=1e-4)
    np.testing.assert_allclose(phugoid, [-0.0847 + 0.1319j, -0.0847 - 0.1319j], atol=1e-4)


@pytest.mark.parametrize("real", [(-1.0, 1.0), (1.0, -1.0)])
def test_equally_good_orders_begin_with_lower_eigenvalue(real: tuple[float, float]) -> None:
    """Where a complex pair becomes two real eigenvalues, the lower one is first in both orders.

    Both orders fit equally well there.
    """
    pair = np.array([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, -0.1]])
    two = np.diag([*real, -0.1])
    scales = np.array([getattr(STATE_SCALES, name) for name in STATES])
    path = scales[:, None] * np.array([pair, two, pair]) / scales
    tracked = track_modes(path, STATES, hfa.aircraft())
    np.testing.assert_allclose(tracked, [[1j, -1j, -0.1], [-1, 1, -0.1], [1j, -1j, -0.1]])
    backwards = track_modes(path[1:], STATES, hfa.aircraft())
    np.testing.assert_allclose(backwards, tracked[1:])


@pytest.mark.parametrize("sizes", [(5,), (3, 4), (2, 3, 4), (4, 1, 3)])
def test_modes_are_paired_between_grid_neighbors(
    published_aircraft: Model, sizes: tuple[int, ...]
) -> None:
    """Between neighbors of a grid, modes are paired as in a sweep of these two points alone."""
    ranges = {"dihedral": (0.05, 0.3), "speed": (64.0, 72.0), "altitude": (39_000.0, 41_000.0)}
    grid = {
        name: np.linspace(*ranges[name], size) for name, size in zip(ranges, sizes, strict=False)
    }
    result = sweep(published_aircraft, grid)
    assert result.trimmed.all()
    index = np.arange(len(result.A)).reshape(sizes)
    for axis in range(len(sizes)):
        along = np.moveaxis(index, axis, 0)
        for mode, next_mode in zip(along[:-1].ravel(), along[1:].ravel(), strict=True):
            step = track_modes(result.A[[mode, next_mode]], result.model.linear, hfa.aircraft())
            assert set(zip(*step.round(9).tolist(), strict=True)) == set(
                zip(*result.eigenvalues[[mode, next_mode]].round(9).tolist(), strict=True)
            )
