"""The number of times that a check of a critic balances the matrices of its game."""

from __future__ import annotations

import numpy as np
import pytest

from controller.critic.critic import from_value
from controller.riccati import normal_form
from hfa import Game, solve
from verification.critic.critic_check import verify


def test_one_check_balances_the_game_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """One check of a critic balances the matrices of the game once."""
    rng = np.random.default_rng(12)
    A, B, E = (rng.standard_normal((4, size)) for size in (4, 2, 1))
    game = Game(A, B, E, np.eye(4), np.eye(2), 30.0)
    critic = from_value(game, solve(game).P)
    units_of = normal_form.units_of
    balanced = []

    def counted(*matrices: np.ndarray) -> np.ndarray:
        balanced.append(matrices)
        return units_of(*matrices)

    # Only counting the calls shows how often the game is balanced.
    monkeypatch.setattr(normal_form, "units_of", counted)
    normal_form.NormalForm.of.cache_clear()
    assert verify(game, critic).ok
    assert len(balanced) == 1
