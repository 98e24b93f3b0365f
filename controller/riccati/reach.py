"""Distance of a plant (A, B) from the nearest plant with an uncontrollable mode."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from controller.riccati.normal_form import FAINT, RANK

#: An eigenvalue with a real part above -|A| times this may belong to a mode that does not decay.
_NEAR = 1e-6
#: Steps of inverse iteration; one is enough if the smallest singular value is much smaller than the
#: next.
_INVERSE_STEPS = 4
#: Number of passes. Each uses the magnitudes of the last vector as weights; the second halves the
#: remaining error.
_PASSES = 3


def least_reach(A: np.ndarray, B: np.ndarray) -> np.ndarray:
    """Return the relative change of A and B that makes an unstable mode uncontrollable, (N,).

    The result is the smallest change that the search finds, an upper bound of the smallest change.
    A mode is included if Re λ >= -`_NEAR` |A|. The result is 1 for a plant without such a mode.

    A: (N, n, n)
    B: (N, n, m)
    """
    values = np.linalg.eigvals(A)
    sizes = np.linalg.norm(A, axis=(1, 2))
    suspects = (values.real >= -_NEAR * sizes[:, None]) & (values.imag >= 0.0)
    game = np.nonzero(suspects)[0]
    reach = np.ones(len(A))
    if game.size:
        found = rank_distance(A[game], B.mT[game], values[suspects], not_decaying)
        np.minimum.at(reach, game, found)
    return reach


def not_decaying(values: np.ndarray) -> np.ndarray:
    """Return the nearest complex numbers with a nonnegative real part.

    values: complex numbers
    """
    return np.maximum(values.real, 0.0) + 1j * values.imag


def on_axis(values: np.ndarray) -> np.ndarray:
    """Return the nearest complex numbers on the imaginary axis.

    values: complex numbers
    """
    return 1j * values.imag


def loses_rank(
    A: np.ndarray,
    rows: np.ndarray,
    value: complex,
    nearest: Callable[[np.ndarray], np.ndarray],
) -> bool:
    """Return whether a relative change of at most `RANK` makes [A' - λI; rows] rank-deficient for
    some λ.

    A: (n, n)
    rows: (p, n)
    value: initial λ of the search
    nearest: function that maps numbers to the nearest permitted λ
    """
    return bool(rank_distance(A[None], rows[None], np.array([value]), nearest)[0] <= RANK)


def rank_distance(
    A: np.ndarray,
    rows: np.ndarray,
    values: np.ndarray,
    nearest: Callable[[np.ndarray], np.ndarray],
) -> np.ndarray:
    """Return the smallest relative change found that makes [A' - λI; rows] rank-deficient, (K,).

    Rank-deficient means less than full column rank. The result is an upper bound of the smallest
    change, at most 1. λ and the singular vector of the smallest singular value are searched for
    together. Each row is divided by the magnitude of its terms. Fast states therefore do not hide
    entries of slow states.

    Source: Higham, Accuracy and Stability of Numerical Algorithms, Theorem 7.3 (Oettli and Prager).

    A: (K, n, n)
    rows: (K, p, n)
    values: (K,), initial λ of the search
    nearest: function that maps numbers to the nearest permitted λ
    """
    n = A.shape[-1]
    both = np.concatenate([A.mT, rows], axis=1)
    sizes = np.abs(both)

    def weights(at: np.ndarray, parts: np.ndarray) -> np.ndarray:
        terms = sizes @ parts
        terms[:, :n] += np.abs(at) * parts
        return 1.0 / np.where(terms > 0.0, terms, 1.0)

    at = nearest(values)[:, None, None]
    weight = weights(at, np.ones((len(A), n, 1)))
    least = np.ones(len(A))
    for _ in range(_PASSES):
        shifted = both.astype(complex)
        np.einsum("kii->ki", shifted[:, :n])[:] -= at[:, 0]
        vector = least_vectors(weight * shifted)
        parts = np.abs(vector)
        rounding = 8 * n * np.finfo(float).eps * parts.max(axis=1, keepdims=True)
        vector = np.where(parts <= rounding, 0.0, vector)
        image = both @ vector
        weighted = weight[:, :n] * vector
        # The largest number is 1, so that the squares neither overflow nor all vanish.
        factor = 1.0 / np.abs(weighted).max(axis=1, keepdims=True)
        conjugate = factor * weighted.conj()
        moved = (conjugate * (factor * weight[:, :n]) * image[:, :n]).sum(axis=1)
        rate = moved / (conjugate * factor * weighted).sum(axis=1)
        at = nearest(rate)[:, :, None]
        weight = weights(at, np.abs(vector))
        image[:, :n] -= at * vector
        changes = weight * np.abs(image)
        least = np.minimum(least, changes.max(axis=(1, 2)))
        if least.min() > 1e3 * RANK:
            break
    return least


def least_vectors(matrices: np.ndarray) -> np.ndarray:
    """Return the right singular vectors of the smallest singular values, (K, n, 1).

    The vectors are computed by inverse iteration. If the inverse overflows, as for a chain of 20
    integrators, the singular value decomposition is used. Source: Golub and Van Loan, Matrix
    Computations, Section 5.5.7.

    matrices: (K, p, n), p >= n
    """
    from scipy.linalg.lapack import ztrtri

    triangle = np.linalg.qr(matrices, mode="r")
    diagonal = np.einsum("kii->ki", triangle)  # a view of `triangle`
    rounding = np.finfo(float).eps * np.abs(triangle).max(axis=(1, 2))[:, None] + FAINT
    diagonal[np.abs(diagonal) < rounding] = 0.0
    diagonal += np.where(diagonal == 0.0, rounding, 0.0)
    inverse = np.array([ztrtri(each.T, lower=1)[0].T for each in triangle])
    if not np.isfinite(inverse).all():
        return np.linalg.svd(matrices)[2][:, -1:].mT.conj()
    inverse = inverse / np.abs(inverse).max(axis=(1, 2), keepdims=True)
    adjoint = inverse.mT.conj()
    row = np.linalg.norm(inverse, axis=2).argmax(axis=1)[:, None, None]
    vector = inverse @ np.take_along_axis(adjoint, row, axis=2)
    for _ in range(_INVERSE_STEPS):  # by at most n² per step, never less
        vector = inverse @ (adjoint @ vector)
    return vector / np.linalg.norm(vector, axis=1, keepdims=True)
