"""A 60-digit answer to A'P + P A + Q - P S P = 0, from the matrix sign function of the Hamiltonian.

The arithmetic is `decimal`, the elimination written out: nothing here uses a floating-point solver,
nor anything of the project but the numbers of a `Game`. With sign(H) = W the stable subspace is
that of W = -I, hence (W + I) [I; P] = 0 (Roberts, Int. J. Control 32, 1980). `test_gare.py` holds
it against eigenvectors by mpmath."""

from __future__ import annotations

from dataclasses import dataclass
from decimal import Decimal, localcontext

import numpy as np

from controller import Game
from controller.game.discrete_game import DiscreteGame

DIGITS = 60
#: Carried beyond the digits that are asked for.
GUARD = 30
#: Newton's iteration needs 10 to 20 steps, and one more for each halving of the distance to the
#: imaginary axis.
MAX_STEPS = 80


@dataclass(frozen=True)
class Reference:
    """The stabilizing P and its K, and whether P is the value of the game; both are empty when
    there is no P."""

    exists: bool
    P: np.ndarray
    K: np.ndarray


def reference_solution(game: Game) -> Reference:
    """The value of the game to 60 digits, rounded to double; `exists` is decided at 60 digits
    too."""
    nothing = Reference(exists=False, P=np.empty((0, 0)), K=np.empty((0, 0)))
    with localcontext() as context:
        context.prec = DIGITS + GUARD
        A, B, E, Q, R = (_decimal(matrix) for matrix in (game.A, game.B, game.E, game.Q, game.R))
        R_inverse_B = _inverse(R) @ B.T
        S = B @ R_inverse_B
        if np.isfinite(game.delta):
            S = S - E @ E.T / Decimal(game.delta) ** 2
        n = len(A)
        W = _sign(np.block([[A, -S], [-Q, -A.T]]))
        if W is None or abs(np.trace(W)) > Decimal("0.5"):
            return nothing
        identity = _decimal(np.eye(n))
        stacked = np.concatenate([W[:n, n:], W[n:, n:] + identity])
        right = -np.concatenate([W[:n, :n] + identity, W[n:, :n]])
        normal = _inverse(stacked.T @ stacked)
        if normal is None:
            return nothing
        P = normal @ (stacked.T @ right)
        P = (P + P.T) / 2
        residual = A.T @ P + P @ A + Q - P @ S @ P
        terms = _largest(Q) + (_largest(A) + _largest(S) * _largest(P)) * _largest(P)
        assert _largest(residual) <= Decimal(10) ** -(DIGITS // 2) * terms, (
            "the reference is not exact"
        )
        return Reference(
            exists=_semidefinite(P), P=P.astype(float), K=(R_inverse_B @ P).astype(float)
        )


def reference_step_value(problem: DiscreteGame) -> np.ndarray:
    """P of a game in discrete time, (n, n), by value iteration to 90 digits, rounded to double.

    Each pass doubles the horizon: A <- A M A, G <- G + A M G A', H <- H + A'H M A with M = (I + G
    H)⁻¹, from A, G = B R⁻¹B' - E E'/δ² and H = Q (Chu, Fan, Lin and Wang, Int. J. Control 77,
    2004). For games that have a value, of which every state costs something."""
    step = problem.step
    with localcontext() as context:
        context.prec = DIGITS + GUARD
        root = Decimal(problem.discount).sqrt()
        A, B, E, H, R = (_decimal(matrix) for matrix in (step.A, step.B, step.E, step.Q, step.R))
        A = root * (A + _decimal(problem.A_low))
        G = B @ _inverse(R) @ B.T
        if np.isfinite(step.delta):
            G = G - E @ E.T / Decimal(step.delta) ** 2
        G = root**2 * G
        identity = _decimal(np.eye(len(A)))
        increase = H
        while _largest(increase) > Decimal(10) ** -DIGITS * _largest(H):
            M = _inverse(identity + G @ H)
            increase = A.T @ H @ M @ A
            G = G + A @ M @ G @ A.T
            H = H + increase
            A = A @ M @ A
        return ((H + H.T) / 2).astype(float)


def relative_error(value: np.ndarray, exact: np.ndarray) -> float:
    """Relative Frobenius distance."""
    return float(np.linalg.norm(value - exact) / np.linalg.norm(exact))


def _sign(H: np.ndarray) -> np.ndarray | None:
    """Newton's Z <- (c Z + Z⁻¹/c)/2 with norm scaling c; None when an eigenvalue is on the
    imaginary axis."""
    Z = H
    for _ in range(MAX_STEPS):
        inverse = _inverse(Z)
        if inverse is None:
            return None
        scale = (_norm(inverse) / _norm(Z)).sqrt()
        if abs(scale - 1) < Decimal("0.1"):
            scale = Decimal(1)
        following = (scale * Z + inverse / scale) / 2
        settled = _largest(following - Z) < Decimal(10) ** -DIGITS * _largest(following)
        Z = following
        if settled:
            # With eigenvalues on the axis Z may cancel to its rounding, and settle on the sign of
            # that.
            apart = _largest(Z @ H - H @ Z) / (_largest(Z) * _largest(H))
            return Z if apart < Decimal(10) ** -(DIGITS // 2) else None
    return None


def _inverse(matrix: np.ndarray) -> np.ndarray | None:
    """Gauss-Jordan with row pivoting; None when singular."""
    n = len(matrix)
    work = np.concatenate([matrix, _decimal(np.eye(n))], axis=1)
    for column in range(n):
        pivot = column + int(np.argmax(np.abs(work[column:, column])))
        if work[pivot, column] == 0:
            return None
        work[[column, pivot]] = work[[pivot, column]]
        work[column] = work[column] / work[column, column]
        factors = work[:, column].copy()
        factors[column] = Decimal(0)
        work = work - np.outer(factors, work[column])
    return work[:, n:]


def _semidefinite(P: np.ndarray) -> bool:
    """Positive pivots of P with its diagonal raised by 1e-40, so that a semidefinite P passes
    too."""
    work = P + np.diag(np.diag(P)) * Decimal("1e-40")
    for k in range(len(work)):
        if work[k, k] < 0 or (work[k, k] == 0 and any(work[k, k:] != 0)):
            return False
        if work[k, k] > 0:
            work = work - np.outer(work[:, k], work[k]) / work[k, k]
    return True


def _decimal(matrix: np.ndarray) -> np.ndarray:
    return np.vectorize(Decimal, otypes=[object])(matrix)


def _largest(matrix: np.ndarray) -> Decimal:
    return max(np.abs(matrix).ravel())


def _norm(matrix: np.ndarray) -> Decimal:
    return max(np.abs(matrix).sum(axis=0))
