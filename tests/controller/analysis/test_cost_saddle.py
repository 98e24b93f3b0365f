"""Each player loses by deviating, to second order; with errors planted."""

from __future__ import annotations

import math

import numpy as np
import pytest
from game_samples import INITIAL, failed_names, game_models

from controller import Game
from controller.analysis.cost import CHANGE, RATIO, saddle_checks
from controller.analysis.solution_report import meaning_checks
from controller.riccati.balancing import balanced_units, in_units
from hfa_support import BadInputError
from verification import check_critic, from_value, solve_game


def test_each_player_loses_to_second_order(game: Game) -> None:
    checks = {check.name: check for check in saddle_checks(game, solve_game(game).P, INITIAL)}
    # The larger change lies between CHANGE / 4 and CHANGE, the smaller is RATIO² below.
    for player in ("control", "disturbance"):
        assert CHANGE / 5.0 < checks[f"saddle_{player}_loses"].value * RATIO**2 < 1.1 * CHANGE
    assert checks["saddle_control_slope_error"].value < 0.02
    assert checks["saddle_disturbance_slope_error"].value < 0.02


def test_one_percent_off_is_no_saddle_point(first: tuple[Game, np.ndarray]) -> None:
    game, P = first
    failed = failed_names(saddle_checks(game, 1.01 * P, INITIAL))
    assert "saddle_control_slope_error" in failed
    assert "saddle_control_loses" in failed


def test_lqr_value_is_no_saddle_point_of_a_hard_game() -> None:
    """Near the smallest delta the disturbance gains by leaving the policy that the LQR value gives it."""
    game = game_models()["published-15"].with_delta(120.0)
    P = solve_game(game.with_delta(math.inf)).P
    failed = failed_names(saddle_checks(game, P, INITIAL))
    assert "saddle_disturbance_slope_error" in failed


def test_a_flight_that_costs_nothing_is_refused(first: tuple[Game, np.ndarray]) -> None:
    game, P = first
    with pytest.raises(BadInputError, match="costs nothing; choose another initial state"):
        saddle_checks(game, P, np.zeros(6))


def test_a_player_who_does_not_matter_cannot_lose() -> None:
    """The disturbance does not reach the state: its own price is all that a deviation brings."""
    game = Game([[-1.0]], [[1.0]], [[0.0]], [[1.0]], [[1.0]], 3.0)
    assert not failed_names(saddle_checks(game, solve_game(game).P, np.array([2.0])))


@pytest.mark.parametrize("seed", [6, 40, 41, 42, 43, 44])
def test_rounding_in_a_stiff_plant_is_not_taken_for_an_error(seed: int) -> None:
    """Poles at -3e4 and 0.09, in random coordinates; errors planted in P are seen as in any other plant."""
    rng = np.random.default_rng(seed)
    n = int(rng.integers(2, 5))
    modes, poles = rng.standard_normal((n, n)), -np.geomspace(1.0, 100.0, n)
    poles[0], poles[-1] = 0.09, -3e4
    A, B = modes @ np.diag(poles) @ np.linalg.inv(modes), rng.standard_normal((n, 1))
    game = Game(A, B, rng.standard_normal((n, 1)), np.eye(n), np.eye(1), math.inf)
    found = check_critic(game, from_value(game, solve_game(game).P))
    assert found.ok, failed_names(found.checks)
    units = balanced_units(game)
    alike, P = in_units(game, units), solve_game(game).P * np.outer(units, units)
    assert max(check.value for check in saddle_checks(alike, P, np.ones(n)) if "slope" in check.name) < 1e-3
    assert "saddle_control_slope_error" in failed_names(saddle_checks(alike, 1.01 * P, np.ones(n)))


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


def test_only_a_game_of_value_zero_has_no_saddle_checks() -> None:
    """An unstable plant without a weight on its states still costs the control that brings it to rest."""
    one = np.eye(1)
    for a, has_value in ((1.0, True), (-1.0, False)):
        game = Game(A=a * one, B=one, E=one, Q=0 * one, R=one, delta=10.0)
        checks = meaning_checks(game, solve_game(game).P, np.ones(1))
        assert not failed_names(checks)
        assert any(check.name.startswith("saddle") for check in checks) is has_value
