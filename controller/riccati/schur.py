"""Stable subspace of a Hamiltonian from its ordered Schur form."""

from __future__ import annotations

import numpy as np


def stable_basis(matrix: np.ndarray) -> np.ndarray | None:
    """Return an orthonormal basis (2n, n) of the stable subspace of a Hamiltonian.

    The result is None if the dimension of the subspace is not n or the Schur form fails.
    """
    return ordered_basis(matrix, job=b"N")[0]


def ordered_basis(matrix: np.ndarray, job: bytes) -> tuple[np.ndarray | None, float]:
    """Return an orthonormal basis (2n, n) of the stable subspace of a matrix, and a separation.

    The basis is None if the dimension of the subspace is not n, or if the Schur form fails. The
    separation is that of the stable and unstable blocks of the Schur form.

    matrix: (2n, 2n)
    job: LAPACK job, b"N" for the basis alone, b"V" to compute the separation too
    """
    from scipy.linalg.lapack import dgees, dtrsen

    half = len(matrix) // 2
    form, _, growth, _, basis, _, failed = dgees(lambda *_: 0, matrix)  # unsorted
    if failed:
        return None, 0.0
    size = max(1, 2 * half * half)
    _, basis, growth, _, _, _, separation, failed = dtrsen(
        growth < 0.0, form, basis, job=job, lwork=size, liwork=size
    )
    stable_first = np.array_equal(growth < 0.0, np.arange(2 * half) < half)
    return (basis[:, :half] if stable_first and not failed else None), float(separation)
