"""The L2 gain, compared with closed forms, python-control and delta_min."""

from __future__ import annotations

import math

import mpmath
import numpy as np
import pytest
import scipy.linalg
from game_samples import game_models
from tolerances import TWO_GAINS

from controller import bounded_real_gain
from hfa import Game, solve


@pytest.mark.parametrize("damping", [1e-7, 1e-3, 0.3])
def test_the_gain_of_a_resonance_equals_its_closed_form(damping: float) -> None:
    """The search finds the gain 1 / (2 ζ sqrt(1 - ζ²)) of a resonance."""
    oscillator = [[0.0, 1.0], [-1.0, -2.0 * damping]]
    game = Game(oscillator, [[0.0], [1.0]], [[0.0], [1.0]], np.diag([1.0, 0.0]), [[1.0]], 10.0)
    exact = 1.0 / (2.0 * damping * math.sqrt(1.0 - damping**2))
    found = bounded_real_gain(game, np.zeros((1, 2)))
    assert exact <= found <= exact * (1.0 + 2e-9)


def test_gain_of_an_unstable_loop_is_infinite(first: tuple[Game, np.ndarray]) -> None:
    game, P = first
    assert bounded_real_gain(game, -game.gain(P)) == math.inf


def test_gain_without_disturbance_or_cost_is_zero() -> None:
    """The L2 gain is 0 if no path leads from the disturbance to the cost."""
    still = Game([[-1.0]], [[1.0]], [[0.0]], [[1.0]], [[1.0]], 1.0)
    hidden = Game(
        np.diag([-1.0, -2.0]), [[1.0], [0.0]], [[0.0], [1.0]], np.diag([1.0, 0.0]), [[1.0]], 1.0
    )
    for game, K in ((still, np.zeros((1, 1))), (hidden, np.zeros((1, 2)))):
        assert bounded_real_gain(game, K) == 0.0


@pytest.mark.parametrize("factor", [1e3, 1e6])
def test_the_gain_of_a_stiff_loop_is_right(factor: float) -> None:
    """In a stiff loop, the gain is the largest one near its peak, computed with 50 digits."""
    game = game_models()["published-15"]
    K = factor * solve(game).K
    with mpmath.workdps(50):
        A, B, E, Q, R, gain = (
            mpmath.matrix(matrix.tolist()) for matrix in (game.A, game.B, game.E, game.Q, game.R, K)
        )

        def gain_at(omega: float) -> float:
            closed = mpmath.mpc(0, omega) * mpmath.eye(len(game.A)) - A + B * gain
            response = mpmath.inverse(closed) * E
            cost = response.H * (Q + gain.T * R * gain) * response
            squares = mpmath.eigh(cost, eigvals_only=True)
            return float(mpmath.sqrt(max(mpmath.re(square) for square in squares)))

        grid = np.array([0.0, *np.geomspace(1e-4, 1e6, 2001)])
        root = scipy.linalg.sqrtm(game.Q + K.T @ game.R @ K)
        loops = 1j * grid[:, None, None] * np.eye(6) - game.A + game.B @ K
        peaks = np.linalg.svd(root @ np.linalg.solve(loops, game.E), compute_uv=False)[:, 0]
        exact = max(gain_at(grid[place]) for place in np.argsort(peaks)[-3:])
    found = bounded_real_gain(game, K)
    assert exact * (1.0 - TWO_GAINS) <= found <= exact * (1.0 + 1e-3)


def test_a_gain_at_the_nyquist_frequency_equals_its_closed_form() -> None:
    """The response 1 / (z + 0.9) of a discrete loop is largest at z = -1, where it is 10."""
    game = Game([[-0.9]], [[1.0]], [[1.0]], [[4.0]], [[1.0]], 100.0, dt=0.1)
    assert bounded_real_gain(game, np.zeros((1, 1))) == pytest.approx(20.0, rel=2e-9)
