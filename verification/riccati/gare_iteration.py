"""Second derivation of the game value: a sequence of standard (definite) Riccati equations."""

from __future__ import annotations

import warnings

import numpy as np

from controller.game.zero_sum import Game
from hfa_model.support.errors import NoSolutionError
from verification.riccati.units import NormalForm, normal_form

#: Convergence ends quadratically, but starts with about 2 (delta/delta_min - 1)^(-1/2) steps of growth: 5 steps
#: far from the smallest delta, 60 within a thousandth of it, 200 within a ten-thousandth.
MAX_STEPS = 300
#: Steps on the exact residual after that: they remove the errors that the others left in the sum.
MAX_POLISHING = 6


def iterated_solution(game: Game) -> np.ndarray:
    """X₀ = 0,  X_{k+1} = X_k + Z_k  with  A_k'Z + Z A_k - Z B B' Z + F_k = 0,  A_k = A - S X_k, in normal form.

    F_k is the residual of the game Riccati equation at X_k, which after a step is Z E E' Z >= 0: each step is an
    LQR problem. The sequence increases to the smallest solution X >= 0 if there is one; if there is none, some
    step has no stabilizing solution, or the sequence grows without end.
    Returns P, (n, n). Raises NoSolutionError when no positive semidefinite stabilizing solution exists.
    Source: Lanzon, Feng, Anderson and Rotkowitz, IEEE Trans. Automatic Control 53 (2008), 2280-2291.
    """
    form = normal_form(game)
    X, forcing = np.zeros_like(form.A), form.Q
    for step in range(1, MAX_STEPS + 1):
        Z = _lqr_step(form, X, forcing, step)
        X = X + Z
        gained = Z @ form.E
        forcing = gained @ gained.T  # symmetric to the last bit, as SciPy requires
        if np.abs(forcing).max() <= np.finfo(float).eps * _largest_term(form, X):
            return form.value(_polished(form, X, step))
    raise NoSolutionError(f"the Lanzon-Feng-Anderson iteration did not settle in {MAX_STEPS} steps")


def _polished(form: NormalForm, X: np.ndarray, step: int) -> np.ndarray:
    for more in range(1, MAX_POLISHING + 1):
        Z = _lqr_step(form, X, form.residual(X), step + more)
        X = X + Z
        if np.abs(Z).max() <= 4.0 * np.finfo(float).eps * np.abs(X).max():
            break
    return X


def _lqr_step(form: NormalForm, X: np.ndarray, forcing: np.ndarray, step: int) -> np.ndarray:
    """Stabilizing Z of A_k'Z + Z A_k - Z B B' Z + F = 0, solved with F scaled to one.

    With Z = c Y and F = c G the equation becomes A_k'Y + Y A_k - Y c B B' Y + G = 0. The scaling keeps a
    forcing of 1e-20 within the range in which a Riccati solver can check its own answer.
    """
    from scipy.linalg import LinAlgError, solve_continuous_are

    scale = float(np.abs(forcing).max()) or 1.0
    A = form.A - form.S @ X
    try:
        with np.errstate(all="ignore"), warnings.catch_warnings(action="ignore"):  # what is wrong is refused below
            Y = solve_continuous_are(A, np.sqrt(scale) * form.B, forcing / scale, np.eye(form.B.shape[1]))
    except (LinAlgError, ValueError) as error:
        raise NoSolutionError(f"step {step} of the Lanzon-Feng-Anderson iteration has no solution") from error
    Z = scale * (Y + Y.T) / 2.0
    if not np.all(np.isfinite(Z)) or np.linalg.eigvals(A - form.B @ (form.B.T @ Z)).real.max() >= 0.0:
        raise NoSolutionError(f"step {step} of the Lanzon-Feng-Anderson iteration is not stabilizing")
    return Z


def _largest_term(form: NormalForm, X: np.ndarray) -> float:
    control = X @ form.B
    return float(max(np.abs(form.A.T @ X).max(), np.abs(form.Q).max(), np.abs(control @ control.T).max()))
