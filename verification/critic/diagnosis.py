"""Why a critic is wrong, where the reason can be told from its numbers."""

from __future__ import annotations

import math

import numpy as np

from controller.game.basis import Basis
from controller.game.zero_sum import Game
from hfa_model.support.errors import NoSolutionError
from verification.critic.candidate import Candidate
from verification.riccati.certificate import relative_residual
from verification.riccati.gare import GameSolution, solve_game
from verification.riccati.spectrum import spectrum
from verification.riccati.units import balanced_units, in_units

#: A residual below this marks a root of the Riccati equation, if not the right one.
_ROOT = 1e-9
#: An eigenvalue below this share of the largest has no sign.
SIGNLESS = 1e-12


def relative_error(value: np.ndarray, exact: np.ndarray) -> float:
    """|value - exact| / |exact|, Frobenius norms; inf when a number is not finite, or |exact| alone is 0."""
    if not np.all(np.isfinite(value)):
        return math.inf
    difference, size = float(np.linalg.norm(value - exact)), float(np.linalg.norm(exact))
    if size == 0.0:
        return 0.0 if difference == 0.0 else math.inf
    return difference / size


def diagnose(game: Game, exact: GameSolution, candidate: Candidate, basis: Basis, limit: float) -> str:
    """One sentence that names the known mistake which this critic makes, or "" when none is recognized.

    Recognized: a gain of the wrong sign, two weights in each other's place, a P that is not symmetric, the LQR solution
    in place of the game's, a K and a P that do not belong together, another root of the Riccati equation, the value of
    another policy than its own.
    """
    units = balanced_units(game)
    squared, balanced = np.outer(units, units), in_units(game, units)
    K = candidate.K * units
    if relative_error(-K, exact.K * units) <= limit:
        return "the gain has the wrong sign: the policy is u = -K z"
    if candidate.weights is not None:
        swapped = _swapped(candidate.weights, basis.weights(exact.P), basis.scaling(units), limit)
        if swapped:
            return swapped
    if candidate.P is None:
        return _gain_of_lqr(balanced, K, limit)
    P = candidate.P * squared
    if relative_error(K, balanced.gain(P)) > limit:
        return "K is not R⁻¹B'P: the stored K and P do not belong together, or not to this plant and R"
    if relative_error(P, P.T) > limit:
        return "P is not symmetric: the value z'Pz knows (P + P')/2 alone"
    if relative_error(P, _lqr(balanced)) <= limit:
        return f"this is the LQR solution (delta = inf), not the game's at delta = {game.delta:.6g}"
    return _residual_of_another(balanced, P)


def _residual_of_another(game: Game, P: np.ndarray) -> str:
    """game, P: in balanced units."""
    residual, abscissa = relative_residual(game, P), spectrum(game.A - game.S @ P).abscissa
    if residual > _ROOT:
        return _policy_evaluation(game, P, abscissa)
    if abscissa < 0.0:
        return ""  # the root of the game: what is left of its residual is rounding, whose signs say nothing
    return (
        f"this is another root of the Riccati equation: its residual is {residual:.2g}, but A - S P is not Hurwitz "
        f"(abscissa {abscissa:+.3g} 1/s)"
    )


def _swapped(weights: np.ndarray, exact: np.ndarray, scaling: np.ndarray, limit: float) -> str:
    """scaling: of the weights to balanced units, in which it is told which two are wrong."""
    scaled = scaling * exact
    wrong = np.flatnonzero(np.abs(scaling * weights - scaled) > limit * np.abs(scaled).max())
    if len(wrong) == 2:
        crossed = np.abs(weights[wrong] - exact[wrong[::-1]])
        if crossed.max() <= limit * np.abs(exact[wrong]).max():
            return f"weights {wrong[0] + 1} and {wrong[1] + 1} stand in each other's place"
    return ""


def _lqr(game: Game) -> np.ndarray:
    try:
        return solve_game(game.with_delta(math.inf)).P
    except NoSolutionError:
        return np.full(game.A.shape, np.nan)


def _gain_of_lqr(game: Game, K: np.ndarray, limit: float) -> str:
    P = _lqr(game)
    if np.all(np.isfinite(P)) and relative_error(K, game.gain(P)) <= limit:
        return f"this is the LQR gain (delta = inf), not the game's at delta = {game.delta:.6g}"
    return ""


def _policy_evaluation(game: Game, P: np.ndarray, abscissa: float) -> str:
    """The value P of a policy with gain R⁻¹B'P0 leaves the residual -(P - P0) S (P - P0), which has the signs of -S
    (Sylvester's law of inertia), or one less where P and P0 agree."""
    missing = np.subtract(_signs(-game.S), _signs(game.residual(P)))
    if abscissa < 0.0 and missing.min() >= 0 and missing.sum() <= 1:
        return (
            "the Riccati residual has the signs that policy evaluation leaves: this may be the value of a recorded "
            "policy instead of its own, or belong to another plant, Q or R"
        )
    return ""


def _signs(matrix: np.ndarray) -> tuple[int, int]:
    """Numbers of positive and of negative eigenvalues."""
    eigenvalues = np.linalg.eigvalsh((matrix + matrix.T) / 2)
    floor = SIGNLESS * float(np.abs(eigenvalues).max())
    return int(np.count_nonzero(eigenvalues > floor)), int(np.count_nonzero(eigenvalues < -floor))
