"""60-digit solution of A'P + P A + Q - P S P = 0 by the matrix sign function of the Hamiltonian.

The arithmetic is `decimal`, with explicit elimination. No floating-point solver is used, and of
this project only the matrices of a `Game`. For W = sign(H), the stable subspace consists of the
vectors v with W v = -v, therefore (W + I) [I; P] = 0. `test_gare.py` compares the result with
eigenvectors computed by mpmath. Source: Roberts, Int. J. Control 32, 1980.
"""

from __future__ import annotations

from dataclasses import dataclass
from decimal import Decimal, localcontext

import numpy as np

from hfa import Game

DIGITS = 60
#: Number of guard digits.
GUARD = 30
#: Newton's iteration needs 10 to 20 steps, and one more for each halving of the distance between
#: the eigenvalues and the imaginary axis.
MAX_STEPS = 80


@dataclass(frozen=True)
class Reference:
    """Reference solution of a game.

    exists: whether the stabilizing P exists and is positive semidefinite
    P: stabilizing solution (n, n), empty if it does not exist
    K: gain of P (m, n), empty if P does not exist
    """

    exists: bool
    P: np.ndarray
    K: np.ndarray


def reference_solution(game: Game) -> Reference:
    """Return the solution of the game, computed with 60 digits and rounded to double precision.

    Whether the solution exists is also decided with 60 digits.
    """
    nothing = Reference(exists=False, P=np.empty((0, 0)), K=np.empty((0, 0)))
    with localcontext() as context:
        context.prec = DIGITS + GUARD
        A, B, E, Q, R = (decimal(matrix) for matrix in (game.A, game.B, game.E, game.Q, game.R))
        R_inverse_B = inverse_of(R) @ B.T
        S = B @ R_inverse_B
        if np.isfinite(game.delta):
            S = S - E @ E.T / Decimal(game.delta) ** 2
        n = len(A)
        W = _sign(np.block([[A, -S], [-Q, -A.T]]))
        if W is None or abs(np.trace(W)) > Decimal("0.5"):
            return nothing
        identity = decimal(np.eye(n))
        stacked = np.concatenate([W[:n, n:], W[n:, n:] + identity])
        right = -np.concatenate([W[:n, :n] + identity, W[n:, :n]])
        normal = inverse_of(stacked.T @ stacked)
        if normal is None:
            return nothing
        P = normal @ (stacked.T @ right)
        P = (P + P.T) / 2
        residual = A.T @ P + P @ A + Q - P @ S @ P
        terms = largest(Q) + (largest(A) + largest(S) * largest(P)) * largest(P)
        assert largest(residual) <= Decimal(10) ** -(DIGITS // 2) * terms, (
            "the reference is not exact"
        )
        return Reference(
            exists=_semidefinite(P), P=P.astype(float), K=(R_inverse_B @ P).astype(float)
        )


def relative_error(value: np.ndarray, exact: np.ndarray) -> float:
    """Return ‖value - exact‖ / ‖exact‖ in the Frobenius norm."""
    return float(np.linalg.norm(value - exact) / np.linalg.norm(exact))


def _sign(H: np.ndarray) -> np.ndarray | None:
    """Return sign(H) by Newton's iteration Z <- (c Z + Z⁻¹/c)/2 with norm scaling c.

    Returns None if an eigenvalue of H is on the imaginary axis.
    """
    Z = H
    for _ in range(MAX_STEPS):
        inverse = inverse_of(Z)
        if inverse is None:
            return None
        scale = (_norm(inverse) / _norm(Z)).sqrt()
        if abs(scale - 1) < Decimal("0.1"):
            scale = Decimal(1)
        following = (scale * Z + inverse / scale) / 2
        settled = largest(following - Z) < Decimal(10) ** -DIGITS * largest(following)
        Z = following
        if settled:
            # If eigenvalues are on the axis, Z may converge to the sign of rounding errors.
            apart = largest(Z @ H - H @ Z) / (largest(Z) * largest(H))
            return Z if apart < Decimal(10) ** -(DIGITS // 2) else None
    return None


def inverse_of(matrix: np.ndarray) -> np.ndarray | None:
    """Return the inverse of a matrix, or None if the matrix is singular.

    The method is Gauss-Jordan elimination in place, with row pivoting. An exchange of rows of the
    matrix is the same exchange of columns of the inverse.
    """
    work = matrix.copy()
    exchanges = []
    for column in range(len(work)):
        pivot = column + int(np.argmax(np.abs(work[column:, column])))
        if work[pivot, column] == 0:
            return None
        work[[column, pivot]] = work[[pivot, column]]
        exchanges.append([column, pivot])
        factors = work[:, column].copy()
        factors[column] = Decimal(0)
        divisor = work[column, column]
        work[:, column] = Decimal(0)
        work[column, column] = Decimal(1)
        work[column] = work[column] / divisor
        work = work - np.outer(factors, work[column])
    for one, other in reversed(exchanges):
        work[:, [one, other]] = work[:, [other, one]]
    return work


def _semidefinite(P: np.ndarray) -> bool:
    """Return whether P is positive semidefinite within a relative tolerance of 1e-40.

    The pivots are computed with the diagonal of P raised by this fraction.
    """
    work = P + np.diag(np.diag(P)) * Decimal("1e-40")
    for k in range(len(work)):
        if work[k, k] < 0 or (work[k, k] == 0 and any(work[k, k:] != 0)):
            return False
        if work[k, k] > 0:
            work = work - np.outer(work[:, k], work[k]) / work[k, k]
    return True


def decimal(matrix: np.ndarray) -> np.ndarray:
    return np.vectorize(Decimal, otypes=[object])(matrix)


def largest(matrix: np.ndarray) -> Decimal:
    return max(np.abs(matrix).ravel())


def _norm(matrix: np.ndarray) -> Decimal:
    return max(np.abs(matrix).sum(axis=0))
