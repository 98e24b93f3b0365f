"""Mistakes that gains of plants with actuators make are named."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from controller import Game
from verification import from_gain, solve_game
from verification.critic.actuated import actuators_in, at_once, with_actuators, with_speed
from verification.critic.critic_check import LIMIT
from verification.critic.diagnosis import diagnose

#: A plant of four states behind an actuator of first order (state 5) and one of second (states 6 and 7).
_A = np.array([[-0.5, 1.0, 0.2, 0.0], [-2.0, -0.8, 0.3, 0.1], [0.1, 0.0, -0.3, 1.0], [0.4, 0.2, -1.5, -0.4]])
_B = np.array([[0.1, 0.5], [3.0, 0.2], [0.0, 0.1], [0.3, 2.0]])


@pytest.fixture(scope="module")
def game() -> Game:
    A, B = np.zeros((7, 7)), np.zeros((7, 2))
    A[:4, :4], A[:4, [4, 5]] = _A, _B
    A[4, 4], B[4, 0] = -6.0, 6.0
    A[5, 6], A[6, 5], A[6, 6], B[6, 1] = 1.0, -100.0, -14.0, 100.0
    Q = np.diag([1.0, 2.0, 3.0, 1.0, 0.0, 0.0, 0.0])
    return Game(A=A, B=B, E=np.eye(7), Q=Q, R=np.diag([1.0, 2.0]), delta=np.inf)


def test_actuators_are_found(game: Game) -> None:
    found = actuators_in(game)
    assert (found.positions, found.inputs, found.states) == ((4, 5), (0, 1), (4, 5, 6))
    without = at_once(game, found)
    np.testing.assert_array_equal(without.A, _A)
    np.testing.assert_array_equal(without.B, _B)
    faster = with_speed(game, found, 2.0)
    assert (faster.A[4, 4], faster.B[4, 0]) == (-12.0, 12.0)
    assert (faster.A[6, 5], faster.A[6, 6], faster.B[6, 1]) == (-400.0, -28.0, 400.0)
    assert actuators_in(without).inputs == ()
    B = game.B.copy()
    B[4, 0] = 5.0  # it ends at 5/6 of its input
    assert actuators_in(replace(game, B=B)).inputs == (1,)


def wrong_gains(game: Game) -> dict[str, np.ndarray]:
    actuators, K = actuators_in(game), solve_game(game).K
    padded, lacking = np.zeros_like(K), K.copy()
    padded[:, :4] = solve_game(at_once(game, actuators)).K
    lacking[:, 4:] = 0.0
    return {
        "the plant without its actuators (states 5, 6, 7)": padded,
        "the feedback of states 5, 6, 7 is missing: their columns of K are 0": lacking,
        "with actuators 2 times as fast": solve_game(with_speed(game, actuators, 2.0)).K,
        "at delta = 50": solve_game(game.with_delta(50.0)).K,
    }


def test_the_mistakes_of_plants_with_actuators_are_named(game: Game) -> None:
    exact = solve_game(game)
    for words, K in wrong_gains(game).items():
        assert words in diagnose(game, exact, from_gain(game, K), LIMIT), words
        noisy = K * (1.0 + 0.01 * np.random.default_rng(4).standard_normal(K.shape))
        assert diagnose(game, exact, from_gain(game, noisy), LIMIT) == ""


@pytest.mark.parametrize(("damping", "expected"), [(None, [1.0, 8.0]), (0.7, [1.0, 11.2, 64.0])])
def test_actuators_put_before_a_plant_have_the_poles_that_they_are_said_to(
    game: Game, damping: float | None, expected: list[float]
) -> None:
    plant = at_once(game, actuators_in(game))
    made = with_actuators(plant, 8.0, damping)
    lag, n = made.A[4:, 4:], len(plant.A)
    np.testing.assert_allclose(np.poly(lag), np.polymul(expected, expected), rtol=1e-12)
    positions = -np.linalg.solve(lag, made.B[n:])[:2]  # at rest, where the inputs are
    np.testing.assert_allclose(positions, np.eye(2), atol=1e-14)
