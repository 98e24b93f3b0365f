"""Runs of the learning laws that the tests of commands share: a run follows from its arguments alone."""

from __future__ import annotations

import os
from collections import Counter
from typing import Any

import pytest

from controller import Game, LearningResult

#: Arguments -> the result, and how often each test had it.
_RUNS: dict[tuple[Any, ...], tuple[LearningResult, Counter[str]]] = {}


def share_learning(patched: pytest.MonkeyPatch) -> None:
    """`learn`, as commands call it, runs once for the same arguments; once more where a test asks for a second time."""
    from controller.laws import learn as module
    from controller.policy import learned_gain

    learn = module.learn

    def shared(game: Game, law: str = "certified", seed: int = 0, **options: Any) -> LearningResult:
        if options.get("progress") is not None:
            return learn(game, law, seed, **options)
        matrices = (each.tobytes() for each in (game.A, game.B, game.E, game.Q, game.R))
        key = (law, seed, game.delta, repr(sorted(options.items())), game.B.shape, *matrices)
        test = os.environ.get("PYTEST_CURRENT_TEST", "").rpartition(" ")[0]
        known = _RUNS.get(key)
        asks_again = known is not None and known[1][test] == 1  # it may compare two runs
        result = learn(game, law, seed, **options) if known is None or asks_again else known[0]
        _RUNS.setdefault(key, (result, Counter()))[1][test] += 1
        return result

    patched.setattr(module, "learn", shared)
    patched.setattr(learned_gain, "learn", shared)
