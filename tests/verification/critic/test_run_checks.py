"""When a run settles, and what is said where it does not."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from controller import Game, LearningResult, basis
from controller.game.learning_result import settled_at
from verification.critic import critic_check as module
from verification.critic.critic_check import run_checks, worthless_start

TIMES = np.array([0.0, 1.0, 2.0, 3.0])


@pytest.mark.parametrize(
    ("sizes", "settled"),
    [
        ([9.0, 0.1, 9.0, 0.1], 3.0),
        ([0.1, 0.1, 0.1, 0.1], 0.0),
        ([9.0, 1.0, 1.0, 1.0], 1.0),
        ([0.1, 0.1, 0.1, 9.0], math.inf),
        ([0.1, 0.1, 0.1, math.nan], math.inf),
    ],
)
def test_it_settles_where_it_stays_within_the_limit_to_the_end(sizes: list[float], settled: float) -> None:
    assert settled_at(TIMES, np.array(sizes), 1.0) == settled


@pytest.mark.parametrize(
    ("settled", "ok", "said"),
    [
        (2.0, True, "the residual settles at 2 s, not within T_w = 3 s"),
        (3.5, False, "the residual settles at 3.5 s, not within T_w = 3 s"),
        (math.inf, False, "the residual does not settle, not within T_w = 3 s"),
    ],
)
def test_the_check_says_when(monkeypatch: pytest.MonkeyPatch, settled: float, ok: bool, said: str) -> None:
    monkeypatch.setattr(module, "settling_time", lambda *_: settled)
    run: Any = SimpleNamespace(excitation=SimpleNamespace(rank=3, size=3), law="published")
    anything: Any = None
    rich, check = run_checks(anything, run, anything, 3.0)
    assert rich.ok
    assert (check.name, check.ok) == ("settling_time", ok)
    assert check.reason == ("" if ok else said)
    assert len(run_checks(anything, run, anything, None)) == 1


@pytest.mark.parametrize(
    ("A", "law", "worthless"),
    [(-1e-3, "published", False), (0.0, "published", True), (1e-3, "published", True), (0.0, "certified", False)],
)
def test_a_start_that_leaves_a_mode_undamped_has_no_value(A: float, law: str, worthless: bool) -> None:
    """K = 0 at the start: the abscissa is A itself."""
    one, run = np.eye(1), cast(LearningResult, SimpleNamespace(weights=np.array([[0.0], [1.0]]), law=law))
    said = worthless_start(Game(A * one, one, one, one, one, 2.0), run, basis("quadratic", 1))
    assert ("has no value to learn from" in said) == worthless
