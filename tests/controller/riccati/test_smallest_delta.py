"""The smallest delta: against the reference, against formulas, and what its neighbourhood says."""

from __future__ import annotations

import math

import numpy as np
import pytest
from game_samples import random_game
from reference_riccati import reference_solution

from controller import Game
from controller.riccati.smallest_delta import has_value
from hfa_support import NoSolutionError
from verification import minimum_delta, solve_game


def test_minimum_delta_brackets_the_exact_one(game: Game) -> None:
    found = minimum_delta(game)
    assert found.value / found.refused <= 1.000001  # as the page of promises says, whatever `TOLERANCE` is
    assert reference_solution(game.with_delta(found.value)).exists
    assert not reference_solution(game.with_delta(found.refused)).exists
    assert found.margin(game.delta) == pytest.approx(game.delta / found.value)


@pytest.mark.parametrize("games", [8, pytest.param(20, marks=pytest.mark.slow)])
def test_minimum_delta_of_random_games(games: int) -> None:
    rng = np.random.default_rng(11)
    for number in range(games):
        game = random_game(rng, scaled=number % 2 == 0)
        found = minimum_delta(game)
        assert reference_solution(game.with_delta(found.value)).exists
        assert not reference_solution(game.with_delta(found.refused)).exists


@pytest.mark.parametrize("games", [8, pytest.param(40, marks=pytest.mark.slow)])
def test_existence_is_decided_as_by_the_reference(games: int) -> None:
    rng = np.random.default_rng(12)
    verdicts = [0, 0]
    for number in range(games):
        game = random_game(rng, scaled=number % 2 == 0)
        exists = reference_solution(game).exists
        assert has_value(game) == exists
        verdicts[exists] += 1
    assert min(verdicts) >= games // 4


def test_delta_below_the_minimum_says_what_to_ask_for(game: Game) -> None:
    smallest = minimum_delta(game).value
    with pytest.raises(NoSolutionError) as refusal:
        solve_game(game.with_delta(80.0))
    message = str(refusal.value)
    assert "Hamiltonian has an eigenvalue on the imaginary axis" in message
    assert f"delta = 80 is below delta_min = {smallest:.7g}; ask for a larger delta" in message
    assert "\n" not in message
    with pytest.raises(NoSolutionError, match=r"P is indefinite .* is below delta_min"):
        solve_game(game.with_delta(smallest * (1.0 - 1e-5)))


def test_a_thousandth_above_the_minimum_is_solved_and_a_millionth_says_why_not(game: Game) -> None:
    smallest = minimum_delta(game).value
    assert solve_game(game.with_delta(smallest * 1.001)).certificate.ok
    with pytest.raises(
        NoSolutionError, match=r"not certified: .* is only .* % above delta_min = .*; ask for a larger delta"
    ):
        solve_game(game.with_delta(smallest * (1.0 + 3e-6)))


@pytest.mark.parametrize("size", [1e-6, 1e-3, 1.0, 1e3, 1e6])
def test_an_undamped_mode_that_costs_nothing_is_named_in_any_unit_of_time(size: float) -> None:
    """An oscillator in random coordinates, whose eigenvalues rounding moves off the axis, to either side."""
    for seed in range(10):
        rng = np.random.default_rng(seed)
        modes = rng.standard_normal((3, 3))
        rows = np.linalg.inv(modes)
        A = size * modes @ np.array([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, -1.0]]) @ rows
        game = Game(A, rng.standard_normal((3, 1)), np.zeros((3, 1)), np.outer(rows[2], rows[2]), np.eye(1), math.inf)
        with pytest.raises(NoSolutionError, match="is not detectable: the undamped mode"):
            solve_game(game)
