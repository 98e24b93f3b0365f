"""The L2 gain, compared with closed forms; test_cross_weights compares it with python-control."""

import math

import numpy as np
import pytest

from hfa import Game, solve


def bounds_of(game, K):
    return solve(game).closed_loops.l2_gain(K)


@pytest.mark.parametrize("damping", [1e-7, 1e-3, 0.3])
def test_the_gain_of_a_resonance_equals_its_closed_form(damping):
    """The gain 1 / (2 ζ sqrt(1 - ζ²)) of a resonance is between the proved bounds."""
    oscillator = [[0.0, 1.0], [-1.0, -2.0 * damping]]
    game = Game(oscillator, [[0.0], [1.0]], E=[[0.0], [1.0]], Q=np.diag([1.0, 0.0]), R=[[1.0]])
    exact = 1.0 / (2.0 * damping * math.sqrt(1.0 - damping**2))
    low, high = bounds_of(game, np.zeros((1, 2)))
    assert low <= exact * (1.0 + 1e-15)
    assert exact * (1.0 - 1e-15) <= high <= low * (1.0 + 1e-6)


@pytest.mark.parametrize("damping", [1e-3, 0.3])
def test_a_gain_that_is_positive_at_no_pole_equals_its_closed_form(damping):
    """With the cost v² - 1.5 x², the gain of a resonance is that at ω² = s, the root of
    s² - 3 s + 2 - 6 ζ² = 0; at its poles, ω² <= 1, the cost is negative.
    """
    oscillator = [[0.0, 1.0], [-1.0, -2.0 * damping]]
    game = Game(oscillator, [[0.0], [1.0]], E=[[0.0], [1.0]], Q=np.diag([-1.5, 1.0]), R=[[1e6]])
    s = 1.5 + math.sqrt(0.25 + 6.0 * damping**2)
    exact = math.sqrt((s - 1.5) / ((1.0 - s) ** 2 + 4.0 * damping**2 * s))
    low, high = bounds_of(game, np.zeros((1, 2)))
    assert low * (1.0 - 1e-12) <= exact <= high * (1.0 + 1e-12)
    assert high <= low * (1.0 + 1e-6)


def test_gain_without_disturbance_or_cost_is_zero():
    """The L2 gain is 0 if no path leads from the disturbance to the cost."""
    still = Game([[-1.0]], [[1.0]], E=[[0.0]], Q=[[1.0]], R=[[1.0]])
    hidden = Game(
        np.diag([-1.0, -2.0]),
        [[1.0], [0.0]],
        E=[[0.0], [1.0]],
        Q=np.diag([1.0, 0.0]),
        R=[[1.0]],
        delta=1.0,
    )
    for game, K in ((still, np.zeros((1, 1))), (hidden, np.zeros((1, 2)))):
        assert bounds_of(game, K) == (0.0, 0.0)
        assert solve(game).l2_gain == 0.0


@pytest.mark.parametrize("dt", [None, 0.2])
def test_delta_min_of_equal_modes_that_no_input_reaches_is_their_gain(dt):
    """Three equal first-order modes of the gain g, of which B reaches one direction: δ_min is g."""
    pole, gain = (-2.0, 0.5) if dt is None else (0.5, 2.0)
    game = Game(pole * np.eye(3), np.ones((3, 2)), Q=np.ones(3), R=np.ones(2), dt=dt)
    bounds = solve(game).delta_min_bounds
    assert gain * (1.0 - 2e-6) <= bounds.refused <= gain <= bounds.value <= gain * (1.0 + 2e-6)
