"""Answers of a plant with other actuators than the game's, and gains with the actuators' positions in them."""

from __future__ import annotations

import numpy as np
import pytest

from controller import Game
from verification import from_gain, from_value, solve_game
from verification.critic.actuated import actuators_in, with_actuators
from verification.critic.critic_check import LIMIT
from verification.critic.critic_errors import relative_error
from verification.critic.diagnosis import diagnose


@pytest.mark.parametrize(
    ("damping", "words"), [(None, "first order, bandwidth 20 rad/s"), (0.7, "second order, bandwidth 12 rad/s")]
)
def test_the_part_of_a_design_s_answer_that_fits_the_plant_is_named(
    game: Game, damping: float | None, words: str
) -> None:
    exact, n = solve_game(game), len(game.A)
    design = solve_game(with_actuators(game, 20.0 if damping is None else 12.0, damping))
    for candidate in (from_gain(game, design.K[:, :n]), from_value(game, design.P[:n, :n])):
        assert words in diagnose(game, exact, candidate, LIMIT)


@pytest.mark.parametrize("bandwidth", [1.5, 2.0, 20.0, 50.0])
def test_the_value_behind_slow_and_fast_actuators_of_second_order_is_named(game: Game, bandwidth: float) -> None:
    design, n = solve_game(with_actuators(game, bandwidth, 0.7)), len(game.A)
    said = diagnose(game, solve_game(game), from_value(game, design.P[:n, :n]), LIMIT)
    assert f"second order, bandwidth {bandwidth:g} rad/s, damping 0.7" in said


ENGINE_AND_SURFACES = (None, 0.7, 0.7, 0.7, 0.7)


@pytest.mark.parametrize(
    "dampings", [(None,) * 5, ENGINE_AND_SURFACES, pytest.param((0.7, None, None, 0.7, None), marks=pytest.mark.slow)]
)
def test_the_gain_behind_actuators_that_differ_is_named_with_each(
    game: Game, dampings: tuple[float | None, ...]
) -> None:
    bandwidths, n = np.array([3.0, 12.0, 20.0, 8.0, 15.0]), len(game.A)
    design, exact = solve_game(with_actuators(game, bandwidths, dampings)), solve_game(game)
    orders = ["first" if damping is None else "second" for damping in dampings]
    words = ", ".join(f"{order} {speed:g}" for order, speed in zip(orders, bandwidths, strict=True))
    assert f"that differ: order and bandwidth in rad/s {words}, " in diagnose(
        game, exact, from_gain(game, design.K[:, :n]), LIMIT
    )
    noise = np.random.default_rng(5).standard_normal((5, n))
    assert diagnose(game, exact, from_gain(game, design.K[:, :n] * (1.0 + 1e-4 * noise)), LIMIT) == ""


def test_from_a_value_alone_actuators_that_differ_are_not_told(game: Game) -> None:
    """An engine of 5 or of 8 rad/s changes P by less than 3e-6 of it."""
    n = len(game.A)
    one, other = (
        solve_game(with_actuators(game, np.array([speed, 30.0, 30.0, 14.0, 12.0]), 0.7)).P[:n, :n]
        for speed in (5.0, 8.0)
    )
    assert 0.0 < relative_error(one, other) < 3e-6
    assert diagnose(game, solve_game(game), from_value(game, one), LIMIT) == ""


@pytest.mark.parametrize("damping", [None, 0.7])
def test_the_answer_of_the_plant_alone_and_positions_in_a_gain_are_named(game: Game, damping: float | None) -> None:
    design, n = with_actuators(game, 20.0, damping), len(game.A)
    actuators = actuators_in(design)
    assert actuators.inputs == tuple(range(5))
    alone, exact = solve_game(game), solve_game(design)
    P, K, positions = np.zeros_like(exact.P), np.zeros_like(exact.K), np.zeros_like(exact.K)
    P[:n, :n], K[:, :n] = alone.P, alone.K
    positions[actuators.inputs, actuators.positions] = 1.0
    wrong = {
        "the gain of the plant without its actuators (states 7, 8, 9, 10, 11": from_gain(design, K),
        "the solution of the plant without its actuators (states 7, 8, 9, 10, 11": from_value(design, P),
        "(states 7, 8, 9, 10, 11) are +1 off: the gain gives u - position": from_gain(design, exact.K + positions),
        "(states 7, 8, 9, 10, 11) are -1 off: the gain gives u + position": from_gain(design, exact.K - positions),
    }
    for words, candidate in wrong.items():
        assert words in diagnose(design, exact, candidate, LIMIT)
    assert diagnose(design, exact, from_gain(design, exact.K + 0.9 * positions), LIMIT) == ""
