"""What the tests share because it follows from its arguments alone: runs of the learning laws, solutions of games."""

from __future__ import annotations

import os
import pickle
from collections import Counter
from collections.abc import Callable, Hashable
from typing import Any

import numpy as np
import pytest

from controller import Game
from controller.game.learning_result import LearningResult


class _Shared:
    """A function computed once for the same key; once more where a test asks a second time, since it may compare."""

    def __init__(self, function: Callable[..., Any]) -> None:
        self._function = function
        self._known: dict[Hashable, tuple[Any, Counter[str]]] = {}

    def __call__(self, key: Hashable, *arguments: Any, **options: Any) -> Any:
        test = os.environ.get("PYTEST_CURRENT_TEST", "").rpartition(" ")[0]
        known = self._known.get(key)
        asks_again = known is not None and known[1][test] == 1
        result = self._function(*arguments, **options) if known is None or asks_again else known[0]
        self._known.setdefault(key, (result, Counter()))[1][test] += 1
        return result


def share(patched: pytest.MonkeyPatch) -> None:
    """`learn`, as commands call it, and the solution of a game with its certificate."""
    from controller.laws import certified as module
    from controller.riccati import certificate, gare, smallest_delta

    learn = _Shared(module.learn)
    solve = _Shared(certificate.certified_solution)

    def learned(game: Game, law: str = "certified", seed: int = 0, **options: Any) -> LearningResult:
        if options.get("progress") is not None:
            return learn._function(game, law, seed, **options)
        return learn((law, seed, pickle.dumps(sorted(options.items())), *_key(game)), game, law, seed, **options)

    def solved(game: Game) -> tuple[np.ndarray, certificate.Certificate]:
        return solve(_key(game), game)

    patched.setattr(module, "learn", learned)
    patched.setattr(gare, "certified_solution", solved)
    patched.setattr(smallest_delta, "certified_solution", solved)


def _key(game: Game) -> tuple[Hashable, ...]:
    return game.delta, game.B.shape, *(each.tobytes() for each in (game.A, game.B, game.E, game.Q, game.R))
