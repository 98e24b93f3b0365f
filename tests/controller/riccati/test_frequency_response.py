"""The L2 gain by two methods, compared with closed forms, python-control and delta_min."""

from __future__ import annotations

import math

import control
import mpmath
import numpy as np
import pytest
from game_samples import failed_names, game_models, random_game
from tolerances import TWO_GAINS

from controller import bounded_real_gain, minimum_delta
from controller.riccati.existence import existence
from controller.riccati.frequency_response import (
    closed_loop,
    largest_gains,
    peak_gain,
    system_gain,
)
from controller.riccati.gain_sweep import SweptGain, swept_gain
from controller.riccati.meaning import gain_checks
from controller.riccati.normal_form import NormalForm
from hfa import Game, solve


def test_the_l2_gain_is_below_delta_by_both(game: Game) -> None:
    """The L2 gain with the game's policy is below delta by both methods, and the methods agree."""
    K = solve(game).K
    gain = bounded_real_gain(game, K)
    swept = swept_gain(*closed_loop(game, K))
    assert gain < game.delta
    # Both are within 1e-9 of the peak.
    assert swept.gain == pytest.approx(gain, rel=TWO_GAINS)
    assert swept.gain <= gain * (1.0 + 1e-12)


def test_gain_agrees_with_python_control(game: Game) -> None:
    """The L2 gain equals python-control's H-infinity norm to 1e-7."""
    K = solve(game).K
    output = np.vstack([np.sqrt(game.Q), np.sqrt(game.R) @ K])  # Q and R are diagonal
    inputs = np.hstack([game.E, np.zeros((6, 5))])  # python-control 0.10 takes square systems only
    system = control.ss(game.A - game.B @ K, inputs, output, 0.0)
    assert bounded_real_gain(game, K) == pytest.approx(
        control.system_norm(system, "inf", tol=1e-9), rel=1e-7
    )


def test_first_order_l2_gain_equals_closed_form() -> None:
    """The L2 gain of a first-order loop equals its closed form."""
    game = Game([[-1.0]], [[2.0]], [[3.0]], [[4.0]], [[5.0]], 10.0)
    exact = 3.0 * math.sqrt(4.0 + 5.0 * 0.25) / 2.0  # u = -z/2
    K = np.array([[0.5]])
    assert bounded_real_gain(game, K) == pytest.approx(exact, rel=2e-9)
    assert swept_gain(*closed_loop(game, K)) == SweptGain(pytest.approx(exact, rel=1e-12), 0.0)


@pytest.mark.parametrize("damping", [1e-7, 1e-3, 0.3])
def test_swept_resonance_gain_equals_closed_form(damping: float) -> None:
    """The sweep finds the resonance gain 1 / (2 ζ sqrt(1 - ζ²)) at sqrt(1 - 2 ζ²) rad/s."""
    oscillator = [[0.0, 1.0], [-1.0, -2.0 * damping]]
    game = Game(oscillator, [[0.0], [1.0]], [[0.0], [1.0]], np.diag([1.0, 0.0]), [[1.0]], 10.0)
    peak = swept_gain(*closed_loop(game, np.zeros((1, 2))))
    assert peak.gain == pytest.approx(1.0 / (2.0 * damping * math.sqrt(1.0 - damping**2)), rel=1e-9)
    assert peak.frequency == pytest.approx(math.sqrt(1.0 - 2.0 * damping**2), rel=1e-6)


@pytest.mark.parametrize("damping", [0.3, 0.4, 0.5])
def test_the_larger_of_two_nearly_equal_peaks_is_found(damping: float) -> None:
    """A resonance is found beside a gain at frequency 0 that is smaller by 1e-5."""
    highest = 1.0 / (2.0 * damping * math.sqrt(1.0 - damping**2))
    loop = np.array([[0.0, 1.0, 0.0], [-1.0, -2.0 * damping, 0.0], [0.0, 0.0, -1.0]])
    E = np.array([[0.0, 0.0], [1.0, 0.0], [0.0, highest * (1.0 - 1e-5)]])
    C = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    assert swept_gain(loop, E, C).gain == pytest.approx(highest, rel=1e-9)


def test_a_gain_at_infinite_frequency_is_found() -> None:
    """The gain of D - 0.5 / (s + 1) has its largest value, |D|, at infinite frequency."""
    for D in (1.0, 3.0):
        loop = ([[-1.0]], [[1.0]], [[-0.5]], [[D]])
        matrices = [np.array(each) for each in loop]
        assert system_gain(*matrices) == pytest.approx(D, rel=1e-6)
        assert peak_gain(*matrices, D) == D  # the Hamiltonian of this level does not exist


def test_close_resonances_of_many_modes_are_swept() -> None:
    """The sweep finds the largest of 40 lightly damped resonances in a narrow band.

    The largest gain is that of the mode with the least damping, alone in its output.
    """
    rng = np.random.default_rng(2)
    frequencies = 1.0 + 0.01 * rng.random(40)
    dampings = 10.0 ** rng.uniform(-5.0, -3.0, 40)
    zero = np.zeros((40, 40))
    stiffness = np.diag(frequencies**2)
    loop = np.block([[zero, np.eye(40)], [-stiffness, -2.0 * np.diag(dampings * frequencies)]])
    E = np.vstack([zero, stiffness])
    C = np.hstack([np.eye(40), zero])
    exact = (0.5 / (dampings * np.sqrt(1.0 - dampings**2))).max()
    assert swept_gain(loop, E, C).gain == pytest.approx(exact, rel=1e-9)


def test_a_resonance_narrower_than_rounding_is_swept() -> None:
    """The sweep of a resonance whose width is hidden by rounding ends, at its frequency."""
    loop = np.array([[-1e-14, 1.0], [-1.0, -1e-14]])
    swept = swept_gain(loop, np.eye(2), np.eye(2))
    assert swept.frequency == pytest.approx(1.0, rel=1e-9)
    assert 1e9 < swept.gain < 1.1e14


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
    """Both methods return an infinite L2 gain for an unstable loop.

    The failed check states that A - B K is not Hurwitz.
    """
    game, P = first
    K = -game.gain(P)
    assert bounded_real_gain(game, K) == swept_gain(*closed_loop(game, K)).gain == math.inf
    (check,) = gain_checks(game, K)
    assert not check.ok
    assert "not Hurwitz" in check.reason


def test_gain_without_disturbance_or_cost_is_zero() -> None:
    """The L2 gain is 0 if no path leads from the disturbance to the cost."""
    still = Game([[-1.0]], [[1.0]], [[0.0]], [[1.0]], [[1.0]], 1.0)
    hidden = Game(
        np.diag([-1.0, -2.0]), [[1.0], [0.0]], [[0.0], [1.0]], np.diag([1.0, 0.0]), [[1.0]], 1.0
    )
    for game, K in ((still, np.zeros((1, 1))), (hidden, np.zeros((1, 2)))):
        assert bounded_real_gain(game, K) == 0.0
        assert not failed_names(gain_checks(game, K))


def test_a_weak_policy_fails_the_gain_check(first: tuple[Game, np.ndarray]) -> None:
    """A policy with 1 % of the exact gain fails the check of the L2 gain."""
    game, P = first
    checks = gain_checks(game, 0.01 * game.gain(P))
    assert failed_names(checks) == {"l2_gain"}
    assert "is not below delta = 200" in checks[0].reason


def test_a_sweep_that_misses_the_peak_fails(
    first: tuple[Game, np.ndarray], monkeypatch: pytest.MonkeyPatch
) -> None:
    """A sweep that returns too small a gain fails the comparison of the two methods."""
    game, P = first
    # Planted fault: no loop is known for which the sweep misses its peak.
    monkeypatch.setattr("controller.riccati.meaning.swept_gain", lambda *_: SweptGain(100.0, 0.1))
    assert failed_names(gain_checks(game, game.gain(P))) == {"l2_gain_methods_agree"}


def test_smallest_delta_bounds_the_gain() -> None:
    """The L2 gain with the game's policy lies between the lower end of the bracket of delta_min
    and delta.
    """
    rng = np.random.default_rng(6)
    tried = 0
    while tried < 6:
        game = random_game(rng, scaled=False)
        if not existence(NormalForm.of(game)).exists:
            continue
        gain = bounded_real_gain(game, solve(game).K)
        assert minimum_delta(game).refused < gain < game.delta
        tried += 1


def test_both_methods_find_a_stiff_loops_gain() -> None:
    """Both methods find the known L2 gain of a very stiff loop, whose slow mode is hidden by
    rounding.
    """
    game = Game([[-1.0, 0.3], [0.2, -1e-3]], [[1.0], [0.0]], np.eye(2), np.eye(2), [[1.0]], 50.0)
    K = np.array([[1e40, 0.0]])
    assert bounded_real_gain(game, K) == pytest.approx(1044.03, rel=1e-5)
    assert swept_gain(*closed_loop(game, K)).gain == pytest.approx(1044.03, rel=1e-5)


@pytest.mark.parametrize("factor", [1e3, 1e6])
def test_both_methods_are_right_in_stiff_loops(factor: float) -> None:
    """In a stiff loop, both methods agree with the L2 gain computed with 50 digits at the peak."""
    game = game_models()["published-15"]
    K = factor * solve(game).K
    bound = bounded_real_gain(game, K)
    swept = swept_gain(*closed_loop(game, K))
    with mpmath.workdps(50):
        A, B, E, Q, R, gain = (
            mpmath.matrix(matrix.tolist()) for matrix in (game.A, game.B, game.E, game.Q, game.R, K)
        )
        response = (
            mpmath.inverse(mpmath.mpc(0, swept.frequency) * mpmath.eye(len(game.A)) - A + B * gain)
            * E
        )
        squares = mpmath.eigh(response.H * (Q + gain.T * R * gain) * response, eigvals_only=True)
        exact = float(mpmath.sqrt(max(mpmath.re(square) for square in squares)))
    assert swept.gain == pytest.approx(exact, rel=1e-10)
    assert bound == pytest.approx(exact, rel=TWO_GAINS)
