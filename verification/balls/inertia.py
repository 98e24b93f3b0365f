"""How many eigenvalues lie on each side of the axis Re λ = -a, for every matrix of a Taylor form.

If H is symmetric and -(A'H + H A + 2 a H) is positive definite, A has as many eigenvalues with Re λ < -a as H has
positive ones, as many with Re λ > -a as H has negative ones, and none between: Ostrowski and Schneider (J. Math. Anal.
Appl. 4, 1962); with H > 0 it is Lyapunov's theorem. For a fixed H the matrix is affine in A, and positive definite
matrices form a convex cone: one H serves a whole box when it serves the corners of the box.
"""

from __future__ import annotations

import warnings
from collections.abc import Iterable, Iterator, Sequence
from typing import TYPE_CHECKING

import numpy as np

from verification.balls.balls import (
    doubles,
    exact,
    is_positive_definite,
    map_entries,
    matrix,
    pivots,
    radii,
    symmetric,
)

if TYPE_CHECKING:
    from flint import arb_mat


def candidates(A: np.ndarray, rate: float, errors: Sequence[arb_mat] = ()) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Pairs of H (n, n) for one matrix, found in doubles, and the congruence T in which its proof is well scaled.

    In the coordinates T of the eigenvectors A is normal. The first H solves (A + a I)'H + H (A + a I) = -T⁻ᵀ T⁻¹ and
    serves wide boxes; the others are T⁻ᵀ diag(±h) T⁻¹, which stay of size one where an eigenvalue nears the axis, with
    h = 1 and with the h that allows for the errors best. None when the eigenvectors are dependent.
    """
    from scipy.linalg import LinAlgWarning, solve_continuous_lyapunov

    values, vectors = np.linalg.eig(A)
    try:
        inverse = np.linalg.inv(vectors)
        weight = (inverse.conj().T @ inverse).real
        # Real and imaginary parts: T = X U with a unitary U.
        parts = np.where(values.imag > 0.0, vectors.real, vectors.imag)
        congruence = np.where(values.imag == 0.0, vectors.real, np.sqrt(2.0) * parts)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", (RuntimeWarning, LinAlgWarning))
            H = solve_continuous_lyapunov((A + rate * np.eye(len(A))).T, -weight)
    except np.linalg.LinAlgError:
        return
    yield (H + H.T) / 2, congruence
    signs = np.where(values.real > -rate, -1.0, 1.0)
    for share in (np.ones(len(A)), _shares(np.abs(values.real + rate), inverse, vectors, errors)):
        if share is not None:
            H = (inverse.conj().T @ ((signs * share)[:, None] * inverse)).real
            yield (H + H.T) / 2, congruence


def _shares(
    distances: np.ndarray, inverse: np.ndarray, vectors: np.ndarray, errors: Sequence[arb_mat]
) -> np.ndarray | None:
    """h = y/x with G x = 1, G'y = 1, G = diag(distances) - N, N what the errors do at most in the eigenvectors.

    Where G has a positive inverse, diag(h) G + G' diag(h) is positive definite (Berman and Plemmons 1979).
    """
    if not errors:
        return None
    worst = sum(
        np.abs(inverse @ doubles(each) @ vectors) + np.abs(inverse) @ radii(each) @ np.abs(vectors) for each in errors
    )
    G = np.diag(distances) - worst
    try:
        x, y = (np.linalg.solve(each, np.ones(len(G))) for each in (G, G.T))
    except np.linalg.LinAlgError:
        return None
    return y / x if min(x.min(), y.min()) > 0.0 else None


def unstable_count(
    corners: Iterable[arb_mat], H: np.ndarray, congruence: np.ndarray, rate: float, errors: Sequence[arb_mat] = ()
) -> int | None:
    """Eigenvalues with Re λ > -rate of every matrix in the hull of the corners; None when H does not prove it.

    errors: any of the matrices, times a number of at most 1, may be added.
    """
    T, weight = matrix(congruence), matrix(H)
    turned = T.transpose()
    signs = pivots(turned * weight * T)
    if signs is None:
        return None
    shift = 2 * exact(rate) * weight

    def growth(A: arb_mat) -> arb_mat:
        product = weight * A
        return turned * (product + product.transpose()) * T

    rest = turned * shift * T
    for each in errors:
        rest += map_entries(symmetric, growth(each))
    for A in corners:
        if not is_positive_definite(-(growth(A) + rest)):
            return None
    return sum(1 for pivot in signs if pivot < 0)
