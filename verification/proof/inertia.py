"""How many eigenvalues lie on each side of the axis Re λ = -a, for every matrix of a Taylor form.

If H is symmetric and -(A'H + H A + 2 a H) is positive definite, A has as many eigenvalues with Re λ < -a as H has
positive ones, as many with Re λ > -a as H has negative ones, and none between: Ostrowski and Schneider (J. Math. Anal.
Appl. 4, 1962); with H > 0 it is Lyapunov's theorem. For a fixed H the matrix is affine in A, and positive definite
matrices form a convex cone: one H serves a whole box when it serves the corners of the box.
"""

from __future__ import annotations

import warnings
from collections.abc import Iterable, Iterator
from typing import TYPE_CHECKING

import numpy as np

from verification.proof.balls import exact, is_positive_definite, matrix, pivots

if TYPE_CHECKING:
    from flint import arb_mat


def candidates(A: np.ndarray, rate: float) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Pairs of H (n, n) for one matrix, found in doubles, and the congruence T in which its proof is well scaled.

    In the coordinates T of the eigenvectors A is normal. The first H solves (A + a I)'H + H (A + a I) = -T⁻ᵀ T⁻¹ and
    serves wide boxes; the second is T⁻ᵀ diag(±1) T⁻¹, which stays of size one where an eigenvalue nears the axis.
    None when the eigenvectors are dependent.
    """
    from scipy.linalg import LinAlgWarning, solve_continuous_lyapunov

    values, vectors = np.linalg.eig(A)
    try:
        inverse = np.linalg.inv(vectors)
        weight = (inverse.conj().T @ inverse).real
        congruence = np.linalg.inv(np.linalg.cholesky(weight)).T
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", (RuntimeWarning, LinAlgWarning))
            H = solve_continuous_lyapunov((A + rate * np.eye(len(A))).T, -weight)
    except np.linalg.LinAlgError:
        return
    yield (H + H.T) / 2, congruence
    signs = np.where(values.real > -rate, -1.0, 1.0)
    H = (inverse.conj().T @ (signs[:, None] * inverse)).real
    yield (H + H.T) / 2, congruence


def unstable_count(corners: Iterable[arb_mat], H: np.ndarray, congruence: np.ndarray, rate: float) -> int | None:
    """Eigenvalues with Re λ > -rate of every matrix in the hull of the corners; None when H does not prove it."""
    T, weight = matrix(congruence), matrix(H)
    turned = T.transpose()
    signs = pivots(turned * weight * T)
    if signs is None:
        return None
    shift = 2 * exact(rate) * weight
    for A in corners:
        product = weight * A
        if not is_positive_definite(turned * (-(product + product.transpose() + shift)) * T):
            return None
    return sum(1 for pivot in signs if pivot < 0)
