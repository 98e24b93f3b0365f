"""Second derivation of the game value: a sequence of standard (definite) Riccati equations."""

from __future__ import annotations

import numpy as np

from controller.game.zero_sum import Game
from hfa_model.support.errors import NoSolutionError

#: Convergence ends quadratically, but starts with about 2 (delta/delta_min - 1)^(-1/2) steps of growth: 5 steps
#: far from the smallest delta, 60 within a thousandth of it, 200 within a ten-thousandth.
MAX_STEPS = 300


def iterated_solution(game: Game) -> np.ndarray:
    """P₀ = 0,  P_{k+1} = P_k + Z_k  with  A_k'Z + Z A_k - Z B R⁻¹B' Z + F_k = 0,  A_k = A - S P_k.

    F_k is the residual of the game Riccati equation at P_k, which after a step is δ⁻² Z E E' Z >= 0: each
    step is an LQR problem. The sequence increases to the smallest solution P >= 0 if there is one; if there is
    none, some step has no stabilizing solution, or the sequence grows without end.
    Returns (n, n). Raises NoSolutionError when no positive semidefinite stabilizing solution exists.
    Source: Lanzon, Feng, Anderson and Rotkowitz, IEEE Trans. Automatic Control 53 (2008), 2280-2291.
    """
    P = np.zeros_like(game.A)
    forcing = game.Q
    for step in range(1, MAX_STEPS + 1):
        Z = _lqr_step(game, P, forcing, step)
        P = P + Z
        forcing = Z @ (game.S_disturbance / game.delta**2) @ Z
        if np.abs(forcing).max() <= np.finfo(float).eps * _largest_term(game, P):
            return _polished(game, P, step)
    raise NoSolutionError(f"the Lanzon-Feng-Anderson iteration did not settle in {MAX_STEPS} steps")


def _polished(game: Game, P: np.ndarray, step: int) -> np.ndarray:
    """One more step on the residual as evaluated: removes the errors that the steps left in the sum."""
    residual = game.residual(P)
    return P + _lqr_step(game, P, (residual + residual.T) / 2.0, step + 1)


def _lqr_step(game: Game, P: np.ndarray, forcing: np.ndarray, step: int) -> np.ndarray:
    """Stabilizing Z of A_k'Z + Z A_k - Z B R⁻¹B' Z + F = 0, solved with F scaled to one.

    With Z = c Y and F = c G the equation becomes A_k'Y + Y A_k - Y c B R⁻¹B' Y + G = 0. The scaling keeps a
    forcing of 1e-20 within the range in which a Riccati solver can judge its own answer.
    """
    from scipy.linalg import LinAlgError, solve_continuous_are

    scale = float(np.abs(forcing).max()) or 1.0
    A = game.A - game.S @ P
    try:
        with np.errstate(all="ignore"):  # what overflows is not finite, and refused below
            Y = solve_continuous_are(A, np.sqrt(scale) * game.B, forcing / scale, game.R)
    except (LinAlgError, ValueError) as error:
        raise NoSolutionError(f"step {step} of the Lanzon-Feng-Anderson iteration has no solution") from error
    Z = scale * Y
    if not np.all(np.isfinite(Z)) or np.linalg.eigvals(A - game.S_control @ Z).real.max() >= 0.0:
        raise NoSolutionError(f"step {step} of the Lanzon-Feng-Anderson iteration is not stabilizing")
    return Z


def _largest_term(game: Game, P: np.ndarray) -> float:
    return float(max(np.abs(game.A.T @ P).max(), np.abs(game.Q).max(), np.abs(P @ game.S_control @ P).max()))
