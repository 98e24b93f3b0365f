"""Why a linear-quadratic problem has no solution: the mode that no input reaches, or that costs nothing."""

from __future__ import annotations

import numpy as np

from controller.game.zero_sum import Game
from verification.riccati.balance import balanced

#: A rank test this close to failing, relative to A, names the mode; a guess at a cause, never a test of success.
SUSPICION = 1e-8


def lqr_obstacle(game: Game) -> str:
    """One line on why A'P + P A + Q - P B R⁻¹ B' P = 0 has no stabilizing solution.

    It has one exactly when [A - λI, B] has full rank for every eigenvalue λ of A with Re λ >= 0 (stabilizable)
    and [A - λI; Q] for every λ with Re λ = 0. An unstable mode outside Q is no obstacle: P is then the least
    cost among the policies that bring the state to rest. Source: Zhou, Doyle and Glover, Theorem 13.7.
    """
    A, scaling = balanced(game.A)
    size = float(np.linalg.norm(A, 2)) or 1.0
    B = _of_size(game.B / scaling[:, None], size)
    Q = _of_size(game.Q * np.outer(scaling, scaling), size)
    eigenvalues = np.linalg.eigvals(A)
    not_stable = eigenvalues[eigenvalues.real >= -SUSPICION * size]
    undamped = not_stable[not_stable.real <= SUSPICION * size]
    for value in not_stable:
        if _rank_distance(A, value, B.T) <= SUSPICION * size:
            return (
                f"(A, B) is not stabilizable: no input reaches the mode with eigenvalue {_text(value)}; "
                "change B or leave that mode out of A"
            )
    for value in undamped:
        if _rank_distance(A.T, value, Q) <= SUSPICION * size:
            return (
                f"(A, Q) is not detectable: the undamped mode with eigenvalue {_text(value)} costs nothing; "
                "give Q weight on it"
            )
    return "the problem without disturbance (delta = inf) could not be certified; check the scaling of A, B, Q, R"


def _rank_distance(A: np.ndarray, value: complex, rows: np.ndarray) -> float:
    """Smallest singular value of [A' - λI; rows]."""
    stacked = np.vstack([A.T - value * np.eye(len(A)), rows])
    return float(np.linalg.svd(stacked, compute_uv=False)[-1])


def _of_size(matrix: np.ndarray, size: float) -> np.ndarray:
    norm = float(np.linalg.norm(matrix, 2))
    return matrix * (size / norm) if norm > 0.0 else matrix


def _text(value: complex) -> str:
    return f"{value.real:+.4g}" if abs(value.imag) <= 1e-12 * abs(value) else f"{value.real:+.4g}{value.imag:+.4g}j"
