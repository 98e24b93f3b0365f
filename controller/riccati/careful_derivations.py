"""Solutions X of the Riccati equation of one normal form: as many digits as there are, none tested.

By the Schur form, and by a sequence of LQR problems."""

from __future__ import annotations

import math
import warnings

import numpy as np

from controller.game.zero_sum import Game
from controller.riccati.balancing import is_hurwitz
from controller.riccati.normal_form import NormalForm, stable_graph
from hfa_support.errors import NoSolutionError

#: Newton steps after the Schur form. Each gains about 16 digits less those that the condition
#: takes; two are enough for all but marginal games.
REFINEMENTS = 12
#: A correction of this size, relative, is rounding.
ROUNDING = 4.0 * float(np.finfo(float).eps)
#: The sequence of LQR problems ends quadratically, but starts with about 2 (delta/delta_min -
#: 1)^(-1/2) steps of growth: 5 steps far from the smallest delta, 60 within a thousandth of it.
MAX_STEPS = 300
#: A correction below this part of X comes of the end of that sequence, where the next ones only
#: remove what rounding left.
SETTLING = 1e-9
_NO_GRAPH = "the Hamiltonian has no stable subspace that is the graph of a P"


def by_schur(form: NormalForm) -> np.ndarray:
    """X, (n, n), of the ordered Schur form of the Hamiltonian, refined with twice the digits.

    Raises NoSolutionError when the stable subspace has no graph, or does not exist.
    Source: Laub, IEEE Trans. Automatic Control 24 (1979), 913-921."""
    return refined(form, unrefined(form))


def unrefined(form: NormalForm) -> np.ndarray:
    """`by_schur` to about ten digits and much faster, for a search.

    0 where nothing is paid for and A is Hurwitz: there the Schur form finds rounding.
    """
    if not form.Q.any() and is_hurwitz(form.A):
        return np.zeros_like(form.A)
    try:
        return stable_graph(form.hamiltonian)
    except np.linalg.LinAlgError as error:
        raise NoSolutionError(_NO_GRAPH) from error


def refined(form: NormalForm, X: np.ndarray) -> np.ndarray:
    """X + Z with (A - S X)'Z + Z (A - S X) + residual(X) = 0 (Kleinman's step), repeated.

    Where the condition takes nearly all digits corrections shrink and grow again, and the X after
    the smallest one counts."""
    from scipy.linalg import LinAlgError, solve_continuous_lyapunov

    X = (X + X.T) / 2.0
    best = X
    smallest = math.inf
    for _ in range(REFINEMENTS):
        try:
            with warnings.catch_warnings():
                # SciPy warns of a singular Lyapunov equation.
                warnings.simplefilter("error", RuntimeWarning)
                Z = solve_continuous_lyapunov((form.A - form.S @ X).T, -form.residual(X))
        except (LinAlgError, ValueError, RuntimeWarning) as error:
            raise NoSolutionError(
                "the Riccati equation has a multiple root: A - S P is singular"
            ) from error
        X = X + (Z + Z.T) / 2.0
        correction = float(np.abs(Z).max())
        if correction < smallest:
            best = X
            smallest = correction
        if correction <= ROUNDING * np.abs(X).max():
            break
    return best


def schur_solution(game: Game) -> np.ndarray:
    """P of `by_schur`, (n, n), in the user's units, without a certificate."""
    form = NormalForm.of(game)
    return form.value(by_schur(form))


def quick_solution(game: Game) -> np.ndarray:
    """P of `unrefined`, (n, n), in the user's units: for a search, certified afterwards."""
    form = NormalForm.of(game)
    return form.value(unrefined(form))


def by_iteration(form: NormalForm) -> np.ndarray:
    """X₀ = 0,  X_{k+1} = X_k + Z_k  with  A_k'Z + Z A_k - Z B B' Z + F_k = 0,  A_k = A - S X_k.

    F_k is the residual at X_k, Z E E' Z >= 0 but for rounding: each step is an LQR problem, solved
    by a Schur form of its Hamiltonian. The sequence increases to the smallest solution X >= 0 if
    there is one; if there is none, some step has no stabilizing solution, or the sequence grows
    without end. Returns X, (n, n). Raises NoSolutionError when no positive semidefinite stabilizing
    solution exists. Source: Lanzon, Feng, Anderson and Rotkowitz, IEEE Trans. Automatic Control 53
    (2008), 2280-2291."""
    X = np.zeros_like(form.A)
    best = X
    smallest = math.inf
    size = 0.0
    for step in range(1, MAX_STEPS + 1):
        Z = _lqr_step(form, X, step)
        X = X + Z
        correction = float(np.abs(Z).max())
        size = max(size, float(np.abs(X).max()))  # of an X of 0 nothing but rounding is left
        if smallest <= SETTLING * size and correction > 0.5 * smallest:  # no digit more
            return best
        best = X
        smallest = correction
        if correction <= ROUNDING * size:
            return X
    raise NoSolutionError(f"the Lanzon-Feng-Anderson iteration did not settle in {MAX_STEPS} steps")


def _lqr_step(form: NormalForm, X: np.ndarray, step: int) -> np.ndarray:
    """Stabilizing Z of A_k'Z + Z A_k - Z B B' Z + F = 0, solved with Z scaled to one.

    With Z = c Y and F = c G the equation becomes A_k'Y + Y A_k - Y c B B' Y + G = 0. Z is of the
    size of F, and at least of that of A_k / B B' where A_k must be stabilized."""
    A = form.A - form.S @ X
    forcing = form.residual(X)
    scale = float(np.abs(forcing).max()) or 1.0
    if not is_hurwitz(A):
        largest_input = float(np.abs(form.B).max()) or 1.0
        scale = max(scale, float(np.abs(A).max()) / largest_input**2)
    H = np.block([[A, -scale * form.B @ form.B.T], [-forcing / scale, -A.T]])
    try:
        Z = scale * stable_graph(H)
    except np.linalg.LinAlgError as error:
        raise NoSolutionError(
            f"step {step} of the Lanzon-Feng-Anderson iteration has no solution"
        ) from error
    Z = (Z + Z.T) / 2.0
    loop = A - form.B @ (form.B.T @ Z)
    if not np.all(np.isfinite(Z)) or np.linalg.eigvals(loop).real.max() >= 0.0:
        raise NoSolutionError(
            f"step {step} of the Lanzon-Feng-Anderson iteration is not stabilizing"
        )
    return Z
