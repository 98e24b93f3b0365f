"""Follow each mode through a sweep, across crossings, by the continuity of its eigenvector."""

from __future__ import annotations

import numpy as np

from hfa_model.vectors import STATE_SCALES


def track(
    A: np.ndarray, states: tuple[str, ...], previous: tuple[np.ndarray, np.ndarray] | None
) -> tuple[np.ndarray, np.ndarray]:
    """Eigenvalues (n,) and scaled eigenvectors (n, n) of A, ordered as in `previous`.

    The pairing maximizes Σ |v_i^H w_i|² - |λ_i - μ_i| / (|λ_i| + |μ_i|) over all pairings: the first term (modal
    assurance criterion) holds on to the shape of a mode where eigenvalues cross, the second tells apart
    the two members of a pair. Without `previous`: fastest first, positive imaginary part first.
    """
    eigenvalues, vectors = np.linalg.eig(A)
    scaled = vectors / np.array([getattr(STATE_SCALES, name) for name in states])[:, None]
    scaled = scaled / np.linalg.norm(scaled, axis=0)
    if previous is None:
        order = np.lexsort((-eigenvalues.imag, -np.round(np.abs(eigenvalues), 9)))
        return eigenvalues[order], scaled[:, order]
    from scipy.optimize import linear_sum_assignment

    before, shapes = previous
    likeness = np.abs(shapes.conj().T @ scaled) ** 2
    distance = np.abs(before[:, None] - eigenvalues[None, :])
    size = np.abs(before)[:, None] + np.abs(eigenvalues)[None, :]
    _, order = linear_sum_assignment(-likeness + distance / np.maximum(size, 1e-12))
    return eigenvalues[order], scaled[:, order]
