"""A gain of the discrete-time problem is named with its sample time."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.linalg import expm, solve_discrete_are

from controller.game.zero_sum import Game
from verification.critic.candidate import from_gain
from verification.critic.critic_check import LIMIT
from verification.critic.diagnosis import diagnose
from verification.critic.discrete_gains import discrete_gain
from verification.riccati.gare import solve_game


def test_dlqr_is_the_textbook_s(game: Game) -> None:
    """Written out once more in the plant's own units."""
    (n, m), dt = game.B.shape, 0.02
    F = expm(np.block([[game.A, game.B], [np.zeros((m, n + m))]]) * dt)
    A, B = F[:n, :n], F[:n, n:]
    S = solve_discrete_are(A, B, game.Q, game.R)
    expected = np.linalg.solve(game.R + B.T @ S @ B, B.T @ S @ A)
    np.testing.assert_allclose(discrete_gain(game, dt), expected, rtol=1e-6, atol=1e-9)


@pytest.mark.parametrize(("kind", "dt"), [("dlqr", 0.02), ("lqrd", 0.05), ("euler", 0.005)])
def test_a_gain_of_discrete_time_is_named_with_its_sample_time(game: Game, kind: str, dt: float) -> None:
    exact, wrong = solve_game(game), discrete_gain(game, dt, kind)
    said = diagnose(game, exact, from_gain(game, wrong), LIMIT)
    assert said.startswith("this is the gain of the discrete-time LQR")
    assert said.endswith(f" at dt = {dt:g} s")
    noisy = wrong * (1.0 + 0.01 * np.random.default_rng(4).standard_normal(wrong.shape))
    assert diagnose(game, exact, from_gain(game, noisy), LIMIT) == ""
