"""The value that a law has learned on a game, certified."""

from __future__ import annotations

from typing import Any

from controller.game.learning_result import LearningResult
from controller.game.zero_sum import Game
from controller.laws.certified import learn
from hfa_support.errors import NoSolutionError
from hfa_support.progress import Progress


def learned_value(game: Game, law: str, seed: int, progress: Progress | None = None, **settings: Any) -> LearningResult:
    """The learning of a law on a game; settings: of the law.

    Raises NoSolutionError, naming the certificate, when what was learned is not certified."""
    result = learn(game, law, seed, progress=progress, **settings)
    if not result.converged:
        raise NoSolutionError(f"law '{law}' is not certified here ({result.outcome}); choose another law or model")
    return result
