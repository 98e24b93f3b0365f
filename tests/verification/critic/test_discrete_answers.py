"""A gain and a value of the discrete-time problem are named with their sample time."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.linalg import expm, solve_discrete_are

from controller import Game
from verification import Candidate, GameSolution, from_gain, from_value, solve_game
from verification.critic.actuated import with_actuators
from verification.critic.critic_check import LIMIT
from verification.critic.diagnosis import diagnose
from verification.critic.discrete_answers import discrete_lqr


def test_dlqr_is_the_textbook_s(game: Game) -> None:
    """Written out once more in the plant's own units."""
    (n, m), dt = game.B.shape, 0.02
    F = expm(np.block([[game.A, game.B], [np.zeros((m, n + m))]]) * dt)
    A, B = F[:n, :n], F[:n, n:]
    expected = solve_discrete_are(A, B, game.Q, game.R)
    S, K = discrete_lqr(game, dt)
    np.testing.assert_allclose(S, expected, rtol=1e-6, atol=1e-6)
    np.testing.assert_allclose(
        K, np.linalg.solve(game.R + B.T @ expected @ B, B.T @ expected @ A), rtol=1e-6, atol=1e-9
    )


def noisy(matrix: np.ndarray) -> np.ndarray:
    """With random errors of 1 percent; a value stays symmetric."""
    noise = np.random.default_rng(4).standard_normal(matrix.shape)
    return matrix * (1.0 + 0.01 * (noise if matrix.shape[0] != matrix.shape[1] else noise + noise.T))


def assert_named(game: Game, exact: GameSolution, candidates: dict[str, Candidate]) -> None:
    for words, candidate in candidates.items():
        said = diagnose(game, exact, candidate, LIMIT)
        assert said.endswith(words), said


#: Of the plant alone or of a design with actuators, which kind, the sample time.
ANSWERS = [
    (False, "dlqr", 0.02),
    (False, "lqrd", 0.05),
    (False, "euler", 0.005),
    (True, "dlqr", 0.02),
    (True, "lqrd", 0.05),
]


@pytest.mark.parametrize(("design", "kind", "dt"), [*ANSWERS[:-1], pytest.param(*ANSWERS[-1], marks=pytest.mark.slow)])
def test_an_answer_of_discrete_time_is_named_with_its_sample_time(
    game: Game, design: bool, kind: str, dt: float
) -> None:
    game = with_actuators(game, 20.0, None) if design else game
    exact = solve_game(game)
    S, K = discrete_lqr(game, dt, kind)
    words = {"dlqr": "hold)", "euler": "I + A dt, B dt)", "lqrd": "(lqrd)"}[kind]
    wrong = {
        f"{words} at dt = {dt:g} s": from_value(game, S * dt),
        f"{words}, a sum over its samples, at dt = {dt:g} s": from_value(game, S),
    }
    assert_named(game, exact, {f"{words} at dt = {dt:g} s": from_gain(game, K)})
    assert_named(game, exact, wrong)


@pytest.mark.parametrize(
    ("design", "kind", "dt"), [ANSWERS[0], *(pytest.param(*each, marks=pytest.mark.slow) for each in ANSWERS[1:])]
)
def test_what_is_only_near_such_an_answer_gets_no_cause(game: Game, design: bool, kind: str, dt: float) -> None:
    game = with_actuators(game, 20.0, None) if design else game
    exact = solve_game(game)
    S, K = discrete_lqr(game, dt, kind)
    for right in (from_gain(game, noisy(K)), from_value(game, noisy(S)), from_value(game, noisy(S * dt))):
        assert diagnose(game, exact, right, LIMIT) == ""


def test_euler_is_the_regulator_of_one_step(game: Game) -> None:
    time = 0.05
    A, B = np.eye(6) + time * game.A, time * game.B
    S = solve_discrete_are(A, B, game.Q, game.R)
    found, K = discrete_lqr(game, time, "euler")
    np.testing.assert_allclose(found, S, rtol=1e-6, atol=1e-9 * np.abs(S).max())
    np.testing.assert_allclose(K, np.linalg.solve(game.R + B.T @ S @ B, B.T @ S @ A), rtol=1e-5, atol=1e-8)
