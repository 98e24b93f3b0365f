"""The value means what it says: every check at once."""

from __future__ import annotations

import math

import numpy as np
import pytest
from game_samples import INITIAL, game_models

from controller.game.zero_sum import Game
from hfa_model.support.checks import Check
from verification.meaning.meaning import meaning_checks
from verification.riccati.gare import solve_game

MODELS = sorted(game_models())


@pytest.fixture(params=MODELS)
def game(request: pytest.FixtureRequest) -> Game:
    return game_models()[request.param]


@pytest.fixture(scope="module")
def first() -> tuple[Game, np.ndarray]:
    game = game_models()[MODELS[0]]
    return game, solve_game(game).P


def _failed(checks: tuple[Check, ...]) -> set[str]:
    return {check.name for check in checks if not check.ok}


def test_exact_solution_means_what_it_says(game: Game) -> None:
    checks = meaning_checks(game, solve_game(game).P, INITIAL)
    assert not _failed(checks), [check.reason for check in checks if not check.ok]
    assert {check.name for check in checks} == {
        "cost_lyapunov",
        "cost_simulated",
        "saddle_control_loses",
        "saddle_control_slope_error",
        "saddle_disturbance_loses",
        "saddle_disturbance_slope_error",
        "l2_gain",
        "l2_gain_methods_agree",
    }


def test_lqr_has_one_player() -> None:
    game = game_models()[MODELS[1]].with_delta(math.inf)
    checks = meaning_checks(game, solve_game(game).P, INITIAL)
    assert not _failed(checks)
    assert "saddle_disturbance_loses" not in {check.name for check in checks}
