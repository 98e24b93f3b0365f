"""Fixtures of the games of the two printed models; a room's conftest takes them in place of `game` at 15 degrees."""

from __future__ import annotations

import numpy as np
import pytest
from game_samples import game_models

from controller import Game
from verification import solve_game


@pytest.fixture(params=sorted(game_models()))
def game(request: pytest.FixtureRequest) -> Game:
    return game_models()[request.param]


@pytest.fixture(scope="session")
def first() -> tuple[Game, np.ndarray]:
    """The game of one of them and its P."""
    game = game_models()["published-15"]
    return game, solve_game(game).P
