"""Of a value that belongs to another game, which game that is."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from controller import Game
from verification import solve_game
from verification.critic.other_games import games_of_value

WEIGHTS = np.array([1.0, 2.0, 3.0, 4.0, 5.0, 6.0])
#: What differs, in words, and the game.
OTHERS: dict[str, Callable[[Game], Game]] = {
    "at delta = 300": lambda game: game.with_delta(300.0),
    "with Q 2 times as large": lambda game: replace(game, Q=2.0 * game.Q),
    "with R 3 times as large": lambda game: replace(game, R=3.0 * game.R),
    "with Q = diag": lambda game: replace(game, Q=game.Q * WEIGHTS),
    "with R = diag": lambda game: replace(game, R=game.R * WEIGHTS[:5]),
}


#: Without an opponent nothing tells of another delta.
ASKED = [(said, delta) for said in OTHERS for delta in (200.0, np.inf) if delta < np.inf or "delta" not in said]


@pytest.mark.parametrize(("said", "delta"), ASKED)
def test_the_game_of_a_value_is_found(game: Game, said: str, delta: float) -> None:
    wanted = OTHERS[said](game.with_delta(delta))
    found = dict(games_of_value(game.with_delta(delta), solve_game(wanted).P))
    (name,) = [each for each in found if each.startswith(said)]
    for matrix in ("Q", "R"):
        np.testing.assert_allclose(getattr(found[name], matrix), getattr(wanted, matrix), rtol=1e-6, atol=1e-8)
    assert found[name].delta == pytest.approx(wanted.delta, rel=1e-6)
