"""First derivation of the game value: ordered Schur form of the Hamiltonian pencil, then Newton
refinement."""

from __future__ import annotations

import math
import warnings

import numpy as np

from controller.game.zero_sum import Game
from controller.riccati.balancing import NormalForm, normal_form, stable_graph
from hfa_support.errors import NoSolutionError

#: Each step gains about 16 digits less those that the condition takes; two are enough for all but
#: marginal games. Where the condition takes nearly all, corrections shrink and grow again, and what
#: stands after the smallest one counts.
REFINEMENTS = 12
#: A correction of this size is rounding.
SETTLED = 1e-15
_NO_GRAPH = "the Hamiltonian has no stable subspace that is the graph of a P"


def schur_solution(game: Game) -> np.ndarray:
    """A'P + P A + Q - P S P = 0 from the pencil with inputs [B, E] and weights blkdiag(I, -I), in
    normal form.

    Returns (n, n), symmetric. It is not checked here but in `certificate`.
    Raises NoSolutionError when the stable subspace has no graph, or does not exist.
    Source: Arnold and Laub, Proc. IEEE 72 (1984), as implemented in SciPy.
    """
    form = normal_form(game)
    return form.value(_refined(form, _by_schur(form)))


def quick_solution(game: Game) -> np.ndarray:
    """The same without refinement, from a Schur form of the Hamiltonian: to about ten digits and
    much faster.

    For a search, whose result is certified afterwards.
    """
    form = normal_form(game)
    try:
        return form.value(stable_graph(form.hamiltonian))
    except np.linalg.LinAlgError as error:
        raise NoSolutionError(_NO_GRAPH) from error


def _by_schur(form: NormalForm) -> np.ndarray:
    from scipy.linalg import LinAlgError, solve_continuous_are

    inputs = np.hstack([form.B, form.E])
    weights = np.diag(np.repeat([1.0, -1.0], [form.B.shape[1], form.E.shape[1]]))
    try:
        with (
            np.errstate(all="ignore"),
            warnings.catch_warnings(action="ignore"),
        ):  # what is wrong is not certified
            return np.asarray(solve_continuous_are(form.A, inputs, form.Q, weights))
    except (LinAlgError, ValueError) as error:
        raise NoSolutionError(_NO_GRAPH) from error


def _refined(form: NormalForm, X: np.ndarray) -> np.ndarray:
    """X + Z with (A - S X)'Z + Z (A - S X) + residual(X) = 0 (Kleinman's step, for the correction),
    repeated."""
    from scipy.linalg import LinAlgError, solve_continuous_lyapunov

    best, smallest = X, math.inf
    for _ in range(REFINEMENTS):
        try:
            with warnings.catch_warnings():
                warnings.simplefilter(
                    "error", RuntimeWarning
                )  # SciPy's word for a singular Lyapunov equation
                Z = solve_continuous_lyapunov((form.A - form.S @ X).T, -form.residual(X))
        except (LinAlgError, ValueError, RuntimeWarning) as error:
            raise NoSolutionError(
                "the Riccati equation has a multiple root: A - S P is singular"
            ) from error
        X = X + (Z + Z.T) / 2.0
        correction = float(np.abs(Z).max())
        if correction < smallest:
            best, smallest = X, correction
        if correction <= SETTLED * np.abs(X).max():
            break
    return best
