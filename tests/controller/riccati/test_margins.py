"""Stability margins of one loop and of all loops together."""

from __future__ import annotations

import math
import warnings

import control
import numpy as np
import pytest
from copies import in_units
from game_samples import game_models
from scipy.optimize import minimize
from tolerances import SAME_FORMULA, TWO_BRACKETS, TWO_GAINS

from controller import bounded_real_gain, disk_margin, minimum_delta
from controller.riccati.frequency_response import responses
from controller.riccati.loop_margins import loop_margins, margin_of
from controller.riccati.margins import (
    ABOVE,
    ClosedLoop,
    _osborne_scaling,
    best_scaling,
    disk_of,
    scaled_norm,
)
from hfa import Game, NoSolutionError, solve


def test_margins_of_lqr_equal_the_textbook_values(game: Game) -> None:
    """Each loop of an LQR with diagonal R tolerates gain factors from 1/2 to inf and a phase shift
    of 60 deg."""
    K = solve(game.with_delta(math.inf)).K
    for margin in loop_margins(game, K):
        assert margin.gain_low <= 0.5
        assert margin.gain_high == math.inf
        assert margin.phase >= 60.0 - 1e-9


def test_loop_margins_are_the_limits_of_stability(game: Game) -> None:
    """The loop is stable 0.1 % inside each gain and phase margin, and unstable 0.1 % outside it."""
    K = solve(game).K
    for i, margin in enumerate(loop_margins(game, K)):
        for factor, stable in (
            (margin.gain_low * 1.001, True),
            (margin.gain_low * 0.999, margin.gain_low == 0.0),
            (min(margin.gain_high * 0.999, 1e3), True),
        ):
            assert (_abscissa(game, K, np.eye(5)[i] * (factor - 1.0) + 1.0) < 0.0) == stable
        if math.isfinite(margin.phase):
            late, early = (np.exp(-1j * np.radians(margin.phase * part)) for part in (1.001, 0.999))
            assert _abscissa(game, K, np.eye(5)[i] * (early - 1.0) + 1.0) < 0.0
            worst = max(
                _abscissa(game, K, np.eye(5)[i] * (f - 1.0) + 1.0) for f in (late, late.conjugate())
            )
            assert worst > 0.0


def test_single_loop_disk_margin_agrees_with_python_control() -> None:
    """The disk margin of a single loop equals python-control's to 0.1 %."""
    game = Game([[0.0, 1.0], [0.0, -1.0]], [[0.0], [1.0]], np.eye(2), np.eye(2), [[1.0]], 10.0)
    K = np.array([[4.0, 0.5]])
    loop = control.ss(game.A, game.B, K, 0.0)
    alpha, gain_db, phase = control.disk_margins(loop, np.geomspace(1e-2, 1e3, 20001))
    disk, (loop_margin,) = disk_margin(game, K), loop_margins(game, K)
    assert disk.disk == pytest.approx(alpha, rel=1e-3)
    assert loop_margin.disk == pytest.approx(alpha, rel=1e-3)
    assert 20.0 * math.log10(disk.gain) == pytest.approx(gain_db, rel=1e-3)
    assert disk.phase == pytest.approx(phase, rel=1e-3)


def test_factors_within_the_disk_margin_keep_stability(game: Game) -> None:
    """The loop is stable for random complex factors on the inputs within the disk of the margin."""
    K = solve(game).K
    alpha = disk_margin(game, K).disk
    rng = np.random.default_rng(7)
    for _ in range(300):
        disk = alpha * 0.999 * np.exp(2j * np.pi * rng.random(5)) * rng.choice([1.0, 0.9], 5)
        assert _abscissa(game, K, (2.0 + disk) / (2.0 - disk)) < 0.0


def test_disk_margin_is_tight(game: Game) -> None:
    """The disk margin is at most 3 % below the smallest destabilizing perturbation that is found.

    The search varies the phases of the five factors on the inputs at the critical frequency.
    """
    K = solve(game).K
    margin = disk_margin(game, solve(game).K)
    closed = 1j * margin.frequency * np.eye(6) - game.A + game.B @ K
    M = 0.5 * np.eye(5) - K @ np.linalg.solve(closed, game.B)

    def radius(phases: np.ndarray) -> float:
        return -float(np.abs(np.linalg.eigvals(M * np.exp(1j * phases))).max())

    starts = np.random.default_rng(2).uniform(-np.pi, np.pi, (8, 5))
    largest = max(
        -minimize(radius, start, method="Nelder-Mead", options={"maxiter": 3000}).fun
        for start in starts
    )
    assert largest <= 1.0 / margin.disk * (1.0 + 1e-9)
    assert largest >= 0.97 / margin.disk


@pytest.mark.parametrize("size", [2, 8])
@pytest.mark.parametrize("scale", [1e-8, 1.0, 1e8])
@pytest.mark.parametrize("draws", [3, pytest.param(30, marks=pytest.mark.slow)])
def test_the_structured_bound_equals_known_values(size: int, scale: float, draws: int) -> None:
    """The upper bound of μ for a unitary matrix in other units is 1, times the scale of the matrix.

    For a triangular matrix the bound is the largest diagonal entry.
    """
    rng = np.random.default_rng(size)
    for _ in range(draws):
        M = rng.standard_normal((size, size)) + 1j * rng.standard_normal((size, size))
        units = np.exp(3.0 * rng.standard_normal(size))
        unitary = np.linalg.qr(M)[0] * units / units[:, None]
        assert _structured_bound(scale * unitary) == pytest.approx(scale, rel=1e-8)
        for triangular in (np.triu(M), np.triu(M.real) * units, np.triu(M.real) * units[:, None]):
            exact = scale * np.abs(np.diag(triangular)).max()
            assert _structured_bound(scale * triangular) == pytest.approx(exact, rel=1e-5)


def test_weak_gain_has_smaller_margins(game: Game) -> None:
    """A weak gain has a smaller disk margin, and margins of an unstable loop are refused."""
    K = solve(game).K
    assert disk_margin(game, 0.05 * K).disk < disk_margin(game, K).disk
    for margins in (loop_margins, disk_margin):
        with pytest.raises(NoSolutionError, match="no margins; give a stabilizing gain"):
            margins(game, -K)


def _light_modes() -> tuple[Game, np.ndarray]:
    """Return a game with two lightly damped modes, and its exact gain with one wrong entry.

    The modes have 2.00 and 2.03 rad/s, the damping ratio 3e-5, and one input.
    """
    A = np.zeros((4, 4))
    for first, omega in ((0, 2.0), (2, 2.03)):
        A[first : first + 2, first : first + 2] = [[0.0, 1.0], [-(omega**2), -6e-5 * omega]]
    game = Game(A, [[0.0], [1.0], [0.0], [0.7]], np.eye(4), np.eye(4), [[100.0]], 1e6)
    return game, solve(game).K * [[1.0, 1.0, 0.5, 1.0]]


def test_margins_of_light_and_close_modes_are_attained() -> None:
    """Factors at the edge of the disk margin and of the phase margin put a pole on the imaginary
    axis.

    The phase margin of the disk is smaller than the phase margin of the loop.
    """
    game, K = _light_modes()
    disk = disk_margin(game, K)
    (loop,) = loop_margins(game, K)
    closed = 1j * disk.frequency * np.eye(4) - game.A + game.B @ K
    M = 0.5 - (K @ np.linalg.solve(closed, game.B)).item()
    factor = (1.0 + 0.5 / M) / (1.0 - 0.5 / M)
    assert abs(1.0 / M) == pytest.approx(disk.disk, rel=1e-7)
    assert min(abs(np.linalg.eigvals(game.A - factor * game.B @ K).real)) < 1e-11
    assert disk.disk == pytest.approx(loop.disk, rel=ABOVE)  # each is so far below the margin
    assert disk.phase < loop.phase
    turned = [np.exp(side * 1j * math.radians(loop.phase)) for side in (-1.0, 1.0)]
    edges = [np.linalg.eigvals(game.A - turn * game.B @ K).real.max() for turn in turned]
    assert max(edges) == pytest.approx(0.0, abs=1e-11)


def test_a_disabled_frequency_search_raises_the_margin(monkeypatch: pytest.MonkeyPatch) -> None:
    """If the search for the critical frequency is disabled, the disk margin is larger than a
    true one.
    """
    game, K = _light_modes()
    right = disk_margin(game, K).disk
    # Planted fault: a search that ends at once.
    monkeypatch.setattr("controller.riccati.margins._above", lambda *_: ())
    assert disk_margin(game, K).disk > right * (1.0 + 1e-6)


def test_the_disk_margin_follows_from_the_largest_bound() -> None:
    """The disk margin is the reciprocal of the largest bound of μ on a fine frequency grid.

    The bound is largest at the frequency of the disk margin.
    """
    A = [[-0.6, 2.5], [-1.2, 1.1]]
    game = Game(A, [[-1.3, -0.8], [1.7, -0.5]], np.eye(2), np.eye(2), np.eye(2), 1e6)
    K = solve(game).K
    disk = disk_margin(game, K)
    bounds = []
    for omega in [*np.geomspace(0.03, 30.0, 400), disk.frequency]:
        closed = 1j * omega * np.eye(2) - game.A + game.B @ K
        bounds.append(_structured_bound(0.5 * np.eye(2) - K @ np.linalg.solve(closed, game.B)))
    assert max(bounds) * disk.disk == pytest.approx(1.0, abs=1e-7)
    assert max(bounds) * disk.disk <= 1.0
    assert bounds[-1] == max(bounds)


def _structured_bound(M: np.ndarray) -> float:
    return float(scaled_norm(M, best_scaling(M)))


def _abscissa(game: Game, K: np.ndarray, factors: np.ndarray) -> float:
    return float(np.linalg.eigvals(game.A - (game.B * factors) @ K).real.max())


def test_units_do_not_change_the_margins(game: Game) -> None:
    """In meters instead of feet, margins, poles, L2 gain and delta_min are unchanged. K changes."""
    units = np.array([1 / 0.3048, 1.0, 1.0, 1.0, 1.0, 1.0])
    si = in_units(game, units)
    here = solve(game)
    there = solve(si)
    exact = [(there.K, here.K * units), (loop_margins(si, there.K), loop_margins(game, here.K))]
    disks = (disk_margin(si, there.K), disk_margin(game, here.K))
    np.testing.assert_allclose(disks[0], disks[1], rtol=1e-6)  # accuracy of the search for the peak
    exact += [
        (
            np.sort_complex(there.closed_loop_eigenvalues),
            np.sort_complex(here.closed_loop_eigenvalues),
        )
    ]
    for computed, expected in exact:
        # The conversion of units rounds once; the condition number of the margins is at most 1e3.
        np.testing.assert_allclose(np.array(computed), np.array(expected), rtol=SAME_FORMULA)
    assert bounded_real_gain(si, there.K) == pytest.approx(
        bounded_real_gain(game, here.K), rel=TWO_GAINS
    )
    # The tolerance of each search is 1e-6.
    assert minimum_delta(si).value == pytest.approx(minimum_delta(game).value, rel=TWO_BRACKETS)
    assert np.abs(there.K / here.K - 1.0).max() > 2.0  # K depends on the units


def test_margins_of_third_order_loop_equal_closed_form() -> None:
    """The margins of L = 4 / (s + 1)³ equal their closed form.

    L(i √3) = -1/2, and |L| = 1 at ω² = 4^(2/3) - 1.
    """
    system = control.ss(control.tf([4.0], [1.0, 3.0, 3.0, 1.0]))
    game = Game(system.A, system.B, np.eye(3), np.eye(3), [[1.0]], 10.0)
    (margin,) = loop_margins(game, system.C)
    assert (margin.gain_low, margin.gain_high) == (0.0, pytest.approx(2.0, rel=1e-12))
    omega = math.sqrt(4 ** (2 / 3) - 1)
    assert margin.phase == pytest.approx(180.0 - 3.0 * math.degrees(math.atan(omega)), rel=1e-10)


@pytest.mark.parametrize("factor", [0.3, 1.0, 3.0])
@pytest.mark.parametrize("name", sorted(game_models()))
def test_gain_and_phase_margins_equal_python_control(name: str, factor: float) -> None:
    """Gain and phase margins of each loop, with the other loops closed, agree with
    python-control."""
    game = game_models()[name]
    K = factor * solve(game).K
    if np.linalg.eigvals(game.A - game.B @ K).real.max() >= 0.0:
        pytest.skip("the scaled gain does not stabilize")
    for i, margin in enumerate(loop_margins(game, K)):
        others = [j for j in range(game.B.shape[1]) if j != i]
        loop = control.ss(game.A - game.B[:, others] @ K[others], game.B[:, [i]], K[[i]], 0.0)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # a loop without a crossover
            computed, phases, *_ = control.stability_margins(loop, returnall=True)
        gains = np.asarray(computed)
        phases = np.abs(np.asarray(phases))
        low = gains[(gains < 1.0) & (gains > 1e-12)]
        high = gains[gains > 1.0]
        assert margin.gain_low == pytest.approx(low.max(initial=0.0), rel=1e-6)
        assert margin.gain_high == pytest.approx(high.min(initial=math.inf), rel=1e-6)
        assert margin.phase == pytest.approx(
            np.minimum(phases, 360 - phases).min(initial=math.inf), rel=1e-6
        )


def test_nine_equal_loops_have_the_slackest_margin() -> None:
    """Nine loops k / (s (s + 1)) together have the margins of the loop with the largest k.

    The loops are given in random order at each frequency.
    """
    gains = np.linspace(0.5, 4.5, 9)
    frequencies = np.geomspace(1e-3, 100.0, 400)

    def shifted(omega: np.ndarray, count: int = 9) -> np.ndarray:
        loops = gains[-count:] / (1j * omega * (1j * omega + 1.0))[:, None]
        return np.random.default_rng(len(omega)).permuted(1.0 / (1.0 + loops) - 0.5, axis=1)

    together = margin_of(shifted, frequencies)
    alone = margin_of(lambda omega: shifted(omega, 1), frequencies)
    # All margins except gain_low, which is 0.
    assert together[1:] == pytest.approx(alone[1:], rel=SAME_FORMULA)


def test_two_complex_loci_have_no_gain_margin() -> None:
    """Two loops with complex loci have no gain margin. Every common factor leaves the loops stable.

    The loop is L = [[-3, 2], [-2, -3]] / 10 (s + 2) / (s + 1).
    """

    def loci(omega: np.ndarray) -> np.ndarray:
        s = 1j * omega[:, None]
        loops = np.array([-0.3 + 0.2j, -0.3 - 0.2j]) * (s + 2.0) / (s + 1.0)
        return 1.0 / (1.0 + loops) - 0.5

    frequencies = np.concatenate([[0.0], np.geomspace(1e-3, 1e3, 100)])
    margin = margin_of(loci, frequencies)
    assert (margin.gain_low, margin.gain_high) == (0.0, math.inf)


def test_loci_that_change_places_do_not_cross() -> None:
    """Two loci on either side of the real axis that change places do not count as a crossing."""

    def loci(omega: np.ndarray) -> np.ndarray:
        passed = np.clip(omega - 1.0, 0.0, 1.0)
        return np.stack([0.7 + 3.0 * passed + 0.1j, 3.7 - 3.0 * passed - 0.1j], axis=1)

    margin = margin_of(loci, np.arange(4.0))
    assert (margin.gain_low, margin.gain_high) == (0.0, math.inf)


FREQUENCIES = np.concatenate([[0.0], np.geomspace(1e-3, 1e3, 2000)])


def _random_loop(seed: int, inputs: int, states: int = 4) -> ClosedLoop:
    """Return a random stable closed loop M with a direct part D."""
    rng = np.random.default_rng(seed)
    A = rng.standard_normal((states, states))
    A -= (np.linalg.eigvals(A).real.max() + 0.3) * np.eye(states)
    B, C, D = (
        rng.standard_normal(shape)
        for shape in ((states, inputs), (inputs, states), (inputs, inputs))
    )
    return ClosedLoop(A, B, C, D)


def _response(loop: ClosedLoop, frequencies: np.ndarray) -> np.ndarray:
    return loop.D + loop.C @ responses(loop.A, loop.B, frequencies)


@pytest.mark.parametrize("inputs", [1, 2, 3, 8])
def test_the_disk_margin_agrees_with_a_grid_of_frequencies(inputs: int) -> None:
    """No bound on a grid of 2,000 frequencies, or at infinite frequency, exceeds 1 / α.

    For up to three inputs, 1 / α exceeds the largest bound by 0.2 % at most.
    """
    for seed in range(4):
        loop = _random_loop(seed, inputs)
        matrices = np.array([*_response(loop, FREQUENCIES), loop.D])
        rough = scaled_norm(matrices, _osborne_scaling(matrices))
        tried = (*matrices[::100], *matrices[np.argsort(rough)[-5:]], loop.D)
        bounds = [float(scaled_norm(M, best_scaling(M))) for M in tried]
        assert disk_of(loop).disk * max(bounds) < 1.0 + 1e-3
        if inputs <= 3:
            assert disk_of(loop).disk * max(bounds) > 1.0 - 2e-3


def test_a_loop_of_many_inputs_is_bounded_to_a_thousandth() -> None:
    """With 12 inputs and 24 states, no bound on a grid exceeds 1 / α, which exceeds all by 1 %."""
    loop = _random_loop(1, 12, 24)
    matrices = _response(loop, FREQUENCIES[::10])
    rough = scaled_norm(matrices, _osborne_scaling(matrices))
    near = matrices[np.argsort(rough)[-5:]]
    bound = max(float(scaled_norm(M, best_scaling(M))) for M in (*near, loop.D))
    assert 1.0 - 1e-2 < disk_of(loop).disk * bound < 1.0 + 1e-3


def test_the_disk_margin_of_a_common_factor_agrees_with_a_grid() -> None:
    """The disk margin of two loops with a common factor is 1 / max |eigenvalue of M|, at most 2."""
    for seed in range(4):
        loop = _random_loop(seed, 2)

        def loci(frequencies: np.ndarray, loop: ClosedLoop = loop) -> np.ndarray:
            return np.linalg.eigvals(_response(loop, frequencies))

        sizes = np.abs([*loci(FREQUENCIES), np.linalg.eigvals(loop.D)])
        margin = margin_of(loci, FREQUENCIES)
        assert margin.disk == pytest.approx(min(1.0 / sizes[:-1].max(), 2.0), rel=1e-9)
