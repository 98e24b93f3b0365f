"""Laws of learned gains: one for the whole flight, or the one that is being learned, a baseline before it."""

from __future__ import annotations

from typing import Any

import numpy as np

from controller.game.basis import basis
from controller.game.learning_result import LearningResult
from controller.game.zero_sum import Game
from controller.laws.certify import abscissa, positivity
from controller.laws.learn import learn
from controller.policy.policies import FlownLaw, gain_law
from controller.training_data.recording import natural_spread
from hfa_support.errors import NoSolutionError
from hfa_support.progress import Progress

#: The baseline that is used while nothing is certified: the LQR of the game's Q and this many times its R.
BASELINE_EFFORT = 100.0


def baseline_value(game: Game) -> np.ndarray:
    """P with A'P + P A + Q - P B (f R)⁻¹ B'P = 0, f = BASELINE_EFFORT; (n, n). A gentle gain without a game.

    Raises NoSolutionError when (A, B) cannot be stabilized.
    """
    from scipy.linalg import solve_continuous_are

    try:
        P: np.ndarray = solve_continuous_are(game.A, game.B, game.Q, BASELINE_EFFORT * game.R)
    except (np.linalg.LinAlgError, ValueError) as error:
        raise NoSolutionError(f"no baseline gain: {error}; check that the inputs can stabilize the model") from error
    return P


def baseline_gain(game: Game) -> np.ndarray:
    """K = (f R)⁻¹ B'P of `baseline_value`, (m, n)."""
    return game.gain(baseline_value(game)) / BASELINE_EFFORT


def baseline_weights(game: Game) -> tuple[float, ...]:
    """Quadratic weights whose policy is that of `baseline_gain`, (M,)."""
    weights = basis("quadratic", len(game.A)).weights(baseline_value(game) / BASELINE_EFFORT)
    return tuple(weights.tolist())


def learned_value(game: Game, law: str, seed: int, progress: Progress | None = None, **settings: Any) -> LearningResult:
    """The learning of a law on a game; the integral law starts from the baseline's policy, which is stabilizing.

    settings: of the law. Raises NoSolutionError, naming the certificate, when what was learned is not certified.
    """
    start: dict[str, Any] = {"initial_weights": baseline_weights(game)} if law == "irl" else {}
    result = learn(game, law, seed, progress=progress, **(start | settings))
    if not result.converged:
        raise NoSolutionError(f"law '{law}' is not certified here ({result.outcome}); choose another law or model")
    return result


def frozen_law(law: str, learned: LearningResult) -> FlownLaw:
    """The learned gain for the whole flight."""
    return gain_law(law, learned.K, learned=learned)


def online_law(game: Game, law: str, learned: LearningResult, tick: float) -> FlownLaw:
    """Learning in flight: `certified_gains` tick by tick."""
    gains, first = certified_gains(game, learned, tick)
    return gain_law(law, gains, first, learned)


def certified_gains(game: Game, learned: LearningResult, tick: float) -> tuple[np.ndarray, float]:
    """In each tick of `tick` seconds the last gain that was certified by then, (N, m, n), and from when on, s.

    A value counts when A - S P and A - B K are Hurwitz and P is positive (`certify.positivity`); until there is
    one, the baseline is used. What has been learned at t is known at t: nothing of the later run is used.
    """
    functions = basis(learned.basis, len(game.A))
    current, first, scales = baseline_gain(game), np.inf, natural_spread(game)
    gains, row = [], 0
    for index in range(int(np.ceil(learned.times[-1] / tick - 1e-9)) + 1):
        while row < len(learned.times) and learned.times[row] <= index * tick + 1e-9:
            P = functions.matrix(learned.weights[row])
            if _is_value(game, P, scales):
                current, first = game.gain(P), min(first, index * tick)
            row += 1
        gains.append(current)
    return np.array(gains), first


def _is_value(game: Game, P: np.ndarray, scales: np.ndarray) -> bool:
    loops = (game.A - game.S @ P, game.A - game.B @ game.gain(P))
    return positivity(game, P, scales).ok and all(abscissa(loop) < 0.0 for loop in loops)
