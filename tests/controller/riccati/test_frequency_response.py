"""The L2 gain, compared with closed forms; test_cross_weights compares it with python-control."""

from __future__ import annotations

import math

import numpy as np
import pytest

from controller import bounded_real_gain
from hfa import Game


@pytest.mark.parametrize("damping", [1e-7, 1e-3, 0.3])
def test_the_gain_of_a_resonance_equals_its_closed_form(damping: float) -> None:
    """The search finds the gain 1 / (2 ζ sqrt(1 - ζ²)) of a resonance."""
    oscillator = [[0.0, 1.0], [-1.0, -2.0 * damping]]
    game = Game(
        oscillator, [[0.0], [1.0]], E=[[0.0], [1.0]], Q=np.diag([1.0, 0.0]), R=[[1.0]], delta=10.0
    )
    exact = 1.0 / (2.0 * damping * math.sqrt(1.0 - damping**2))
    found = bounded_real_gain(game, np.zeros((1, 2)))
    assert exact <= found <= exact * (1.0 + 2e-9)


def test_gain_of_an_unstable_loop_is_infinite() -> None:
    game = Game([[1.0]], [[1.0]], E=[[1.0]], Q=[[1.0]], R=[[1.0]], delta=10.0)
    assert bounded_real_gain(game, np.array([[0.9]])) == math.inf


def test_gain_without_disturbance_or_cost_is_zero() -> None:
    """The L2 gain is 0 if no path leads from the disturbance to the cost."""
    still = Game([[-1.0]], [[1.0]], E=[[0.0]], Q=[[1.0]], R=[[1.0]], delta=1.0)
    hidden = Game(
        np.diag([-1.0, -2.0]),
        [[1.0], [0.0]],
        E=[[0.0], [1.0]],
        Q=np.diag([1.0, 0.0]),
        R=[[1.0]],
        delta=1.0,
    )
    for game, K in ((still, np.zeros((1, 1))), (hidden, np.zeros((1, 2)))):
        assert bounded_real_gain(game, K) == 0.0


def test_a_gain_at_the_nyquist_frequency_equals_its_closed_form() -> None:
    """The response 1 / (z + 0.9) of a discrete loop is largest at z = -1, where it is 10."""
    game = Game([[-0.9]], [[1.0]], E=[[1.0]], Q=[[4.0]], R=[[1.0]], delta=100.0, dt=0.1)
    assert bounded_real_gain(game, np.zeros((1, 1))) == pytest.approx(20.0, rel=2e-9)
