"""The L2 gain, compared with closed forms, python-control and delta_min."""

from __future__ import annotations

import math

import mpmath
import numpy as np
import pytest
from game_samples import failed_names, game_models
from tolerances import TWO_GAINS

from controller import bounded_real_gain
from controller.riccati.frequency_response import (
    closed_loop,
    largest_gains,
    loop_gain,
    peak_gain,
    system_gain,
)
from controller.riccati.meaning import gain_checks
from hfa import Game, solve


def test_first_order_l2_gain_equals_closed_form() -> None:
    """The L2 gain of a first-order loop equals its closed form."""
    game = Game([[-1.0]], [[2.0]], [[3.0]], [[4.0]], [[5.0]], 10.0)
    exact = 3.0 * math.sqrt(4.0 + 5.0 * 0.25) / 2.0  # u = -z/2
    K = np.array([[0.5]])
    assert bounded_real_gain(game, K) == pytest.approx(exact, rel=2e-9)


@pytest.mark.parametrize("damping", [1e-7, 1e-3, 0.3])
def test_the_gain_of_a_resonance_equals_its_closed_form(damping: float) -> None:
    """The search finds the resonance gain 1 / (2 ζ sqrt(1 - ζ²)) at sqrt(1 - 2 ζ²) rad/s."""
    oscillator = [[0.0, 1.0], [-1.0, -2.0 * damping]]
    game = Game(oscillator, [[0.0], [1.0]], [[0.0], [1.0]], np.diag([1.0, 0.0]), [[1.0]], 10.0)
    peak = loop_gain(closed_loop(game, np.zeros((1, 2))), is_discrete=False)
    exact = 1.0 / (2.0 * damping * math.sqrt(1.0 - damping**2))
    assert peak.low <= exact * (1.0 + 1e-12)
    assert exact <= peak.high <= exact * (1.0 + 2e-9)
    assert peak.point.imag == pytest.approx(math.sqrt(1.0 - 2.0 * damping**2), rel=1e-5)


def test_a_gain_at_infinite_frequency_is_found() -> None:
    """The gain of D - 0.5 / (s + 1) has its largest value, |D|, at infinite frequency."""
    for D in (1.0, 3.0):
        loop = ([[-1.0]], [[1.0]], [[-0.5]], [[D]])
        matrices = [np.array(each) for each in loop]
        assert system_gain(*matrices) == pytest.approx(D, rel=1e-6)
        assert peak_gain(*matrices, D) == D  # the Hamiltonian of this level does not exist


@pytest.mark.parametrize("shape", [(5, 3), (3, 5), (4, 1), (4, 0)])
def test_largest_gains_are_largest_singular_values(shape: tuple[int, int]) -> None:
    """Each large gain is the largest singular value, and each smaller one is not below it."""
    rng = np.random.default_rng(3)
    sizes = 10.0 ** rng.uniform(-3.0, 0.0, 50)[:, None, None]
    matrices = sizes * (rng.standard_normal((50, *shape)) + 1j * rng.standard_normal((50, *shape)))
    gains = largest_gains(matrices, 0.5)
    exact = np.linalg.svd(matrices, compute_uv=False).max(axis=1, initial=0.0)
    is_large = exact >= 0.5 * exact.max()
    assert gains[is_large] == pytest.approx(exact[is_large], rel=1e-13)
    assert (gains >= exact * (1.0 - 1e-13)).all()
    assert (gains[~is_large] < exact.max()).all()


def test_gain_of_an_unstable_loop_is_infinite(first: tuple[Game, np.ndarray]) -> None:
    """The L2 gain is infinite for an unstable loop.

    The failed check states that A - B K is not stable.
    """
    game, P = first
    K = -game.gain(P)
    assert bounded_real_gain(game, K) == math.inf
    (check,) = gain_checks(game, K)
    assert not check.ok
    assert "not stable" in check.reason


def test_gain_without_disturbance_or_cost_is_zero() -> None:
    """The L2 gain is 0 if no path leads from the disturbance to the cost."""
    still = Game([[-1.0]], [[1.0]], [[0.0]], [[1.0]], [[1.0]], 1.0)
    hidden = Game(
        np.diag([-1.0, -2.0]), [[1.0], [0.0]], [[0.0], [1.0]], np.diag([1.0, 0.0]), [[1.0]], 1.0
    )
    for game, K in ((still, np.zeros((1, 1))), (hidden, np.zeros((1, 2)))):
        assert bounded_real_gain(game, K) == 0.0
        assert not failed_names(gain_checks(game, K))


@pytest.mark.parametrize("factor", [1e3, 1e6])
def test_the_gain_of_a_stiff_loop_is_right(factor: float) -> None:
    """In a stiff loop, both bounds agree with the gain computed with 50 digits at the peak."""
    game = game_models()["published-15"]
    K = factor * solve(game).K
    found = loop_gain(closed_loop(game, K), is_discrete=False)
    with mpmath.workdps(50):
        A, B, E, Q, R, gain = (
            mpmath.matrix(matrix.tolist()) for matrix in (game.A, game.B, game.E, game.Q, game.R, K)
        )
        response = (
            mpmath.inverse(mpmath.mpc(0, found.point.imag) * mpmath.eye(len(game.A)) - A + B * gain)
            * E
        )
        squares = mpmath.eigh(response.H * (Q + gain.T * R * gain) * response, eigvals_only=True)
        exact = float(mpmath.sqrt(max(mpmath.re(square) for square in squares)))
    assert found.low == pytest.approx(exact, rel=1e-9)
    assert found.high == pytest.approx(exact, rel=TWO_GAINS)
