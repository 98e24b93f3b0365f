"""Follow each mode along a path of linear models, across crossings, by the continuity of its eigenvector."""

from __future__ import annotations

import numpy as np

from hfa_model.vectors import STATE_SCALES


def track_modes(A: np.ndarray, states: tuple[str, ...]) -> np.ndarray:
    """Eigenvalues (N, n) of A (N, n, n), neighbours along the path paired so that a column follows one mode.

    Two neighbours are paired by the permutation that maximizes
    Σ |v_i^H w_i|² - |λ_i - μ_i| / (|λ_i| + |μ_i|): the first term (modal assurance criterion, on states in
    units of `STATE_SCALES`) holds on to the shape of a mode where eigenvalues cross, the second tells the two
    members of a pair apart. The first point is ordered fastest first, positive imaginary part first.
    """
    values, vectors = np.linalg.eig(A)
    scales = np.array([getattr(STATE_SCALES, name) for name in states])
    shapes = vectors / scales[:, None]
    shapes = shapes / np.linalg.norm(shapes, axis=1, keepdims=True)
    first = np.lexsort((-values[0].imag, -np.round(np.abs(values[0]), 9)))
    steps = _pairings(values, shapes)
    order = np.empty(values.shape, dtype=int)
    order[0] = first
    for i, step in enumerate(steps):
        order[i + 1] = step[order[i]]
    return np.take_along_axis(values.astype(complex), order, axis=1)


def _pairings(values: np.ndarray, shapes: np.ndarray) -> np.ndarray:
    """(N - 1, n): which eigenvalue of the next point belongs to each eigenvalue of this one."""
    before, after = values[:-1], values[1:]
    likeness = np.abs(np.einsum("nki,nkj->nij", shapes[:-1].conj(), shapes[1:])) ** 2
    distance = np.abs(before[:, :, None] - after[:, None, :])
    size = np.abs(before)[:, :, None] + np.abs(after)[:, None, :]
    gain = likeness - distance / np.maximum(size, 1e-12)
    best = gain.argmax(axis=2)
    # Where every row's favourite is another column the favourites are the optimal permutation already.
    contested = np.flatnonzero((np.sort(best, axis=1) != np.arange(best.shape[1])).any(axis=1))
    if contested.size:
        from scipy.optimize import linear_sum_assignment

        for i in contested:
            best[i] = linear_sum_assignment(gain[i], maximize=True)[1]
    return best
