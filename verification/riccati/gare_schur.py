"""First derivation of the game value: ordered Schur form of the Hamiltonian pencil, then Newton refinement."""

from __future__ import annotations

import warnings

import numpy as np

from controller.game.zero_sum import Game
from hfa_model.support.errors import NoSolutionError
from verification.riccati.units import balanced_units, in_units

#: The first step removes the error of the Schur method (1e-13), the second shows that nothing is left.
REFINEMENTS = 2


def schur_solution(game: Game) -> np.ndarray:
    """A'P + P A + Q - P S P = 0 from the pencil with inputs [B, E/δ] and weights blkdiag(R, -I).

    Returns (n, n), symmetric. Nothing is promised about it: `certificate.certify` must judge it.
    Raises NoSolutionError when the stable subspace has no graph, or does not exist.
    Source: Arnold and Laub, Proc. IEEE 72 (1984), as implemented in SciPy.
    """
    from scipy.linalg import LinAlgError, block_diag, solve_continuous_are

    inputs = np.hstack([game.B, game.E / game.delta])
    weights = block_diag(game.R, -np.eye(game.E.shape[1]))
    try:
        with np.errstate(all="ignore"):  # what overflows does not pass the certificate
            P = solve_continuous_are(game.A, inputs, game.Q, weights)
    except (LinAlgError, ValueError) as error:
        raise NoSolutionError("the Hamiltonian has no stable subspace that is the graph of a P") from error
    return _refined(game, P)


def _refined(game: Game, P: np.ndarray) -> np.ndarray:
    """Newton steps in balanced units of state."""
    units = balanced_units(game)
    squared = np.outer(units, units)
    balanced, P = in_units(game, units), P * squared
    for _ in range(REFINEMENTS):
        P = _newton_step(balanced, P)
    return P / squared


def _newton_step(game: Game, P: np.ndarray) -> np.ndarray:
    """P + X with (A - S P)'X + X (A - S P) + residual(P) = 0 (Kleinman's step, for the correction).

    Solving for the correction rather than for the new P keeps the error at the rounding of the residual.
    """
    from scipy.linalg import LinAlgError, solve_continuous_lyapunov

    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error", RuntimeWarning)  # SciPy's word for a singular Lyapunov equation
            correction = solve_continuous_lyapunov((game.A - game.S @ P).T, -game.residual(P))
    except (LinAlgError, ValueError, RuntimeWarning) as error:
        raise NoSolutionError("the Riccati equation has a multiple root: A - S P is singular") from error
    refined = P + correction
    return (refined + refined.T) / 2.0
