"""The value that a law has learned on a game, certified; a gentle baseline."""

from __future__ import annotations

from typing import Any

import numpy as np

from controller.game.learning_result import LearningResult
from controller.game.zero_sum import Game
from controller.laws.certified import learn
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


def learned_value(game: Game, law: str, seed: int, progress: Progress | None = None, **settings: Any) -> LearningResult:
    """The learning of a law on a game; settings: of the law.

    Raises NoSolutionError, naming the certificate, when what was learned is not certified."""
    result = learn(game, law, seed, progress=progress, **settings)
    if not result.converged:
        raise NoSolutionError(f"law '{law}' is not certified here ({result.outcome}); choose another law or model")
    return result
