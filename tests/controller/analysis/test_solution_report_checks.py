"""The value means what it says: every check at once."""

from __future__ import annotations

import math

import numpy as np
from game_samples import INITIAL, failed_names, game_models

from controller import Game
from controller.analysis.solution_report import meaning_checks
from verification import solve_game


def test_exact_solution_means_what_it_says(game: Game) -> None:
    checks = meaning_checks(game, solve_game(game).P, INITIAL)
    assert not failed_names(checks), [check.reason for check in checks if not check.ok]
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
    game = game_models()["published-5"].with_delta(math.inf)
    checks = meaning_checks(game, solve_game(game).P, INITIAL)
    assert not failed_names(checks)
    assert "saddle_disturbance_loses" not in {check.name for check in checks}


def test_only_a_game_of_value_zero_has_no_saddle_checks() -> None:
    """An unstable plant without a weight on its states still costs the control that brings it to rest."""
    one = np.eye(1)
    for a, has_value in ((1.0, True), (-1.0, False)):
        game = Game(A=a * one, B=one, E=one, Q=0 * one, R=one, delta=10.0)
        checks = meaning_checks(game, solve_game(game).P, np.ones(1))
        assert not failed_names(checks)
        assert any(check.name.startswith("saddle") for check in checks) is has_value
