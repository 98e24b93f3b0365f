"""Stability margins of one loop and of all loops together."""

from __future__ import annotations

import math
import warnings

import control
import numpy as np
import pytest
from game_samples import game_models
from strategies import in_coordinates
from tolerances import SAME_FORMULA, TWO_BRACKETS, TWO_GAINS

import hfa
from controller import bounded_real_gain, disk_margin, minimum_delta
from controller.riccati.frequency_response import responses
from controller.riccati.loop_margins import LoopMargin, loop_margins, margin_of, named_margins
from controller.riccati.margins import (
    ClosedLoop,
    _osborne_scaling,
    best_scaling,
    disk_of,
    disk_sizes,
    scaled_norm,
)
from hfa import Game, NoSolutionError, solve


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


def _structured_bound(M: np.ndarray) -> float:
    return float(scaled_norm(M, best_scaling(M)))


def test_units_do_not_change_the_margins(game: Game) -> None:
    """In meters instead of feet, margins, poles, L2 gain and delta_min are unchanged. K changes."""
    units = np.array([1 / 0.3048, 1.0, 1.0, 1.0, 1.0, 1.0])
    si = in_coordinates(game, np.diag(1.0 / units))
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
            computed, angles, _, _, crossovers, _ = control.stability_margins(loop, returnall=True)
        gains = np.asarray(computed)
        phases = np.abs(np.asarray(angles))
        least = np.minimum(phases, 360 - phases)
        low = gains[(gains < 1.0) & (gains > 1e-12)]
        high = gains[gains > 1.0]
        assert margin.gain_low == pytest.approx(low.max(initial=0.0), rel=1e-6)
        assert margin.gain_high == pytest.approx(high.min(initial=math.inf), rel=1e-6)
        assert margin.phase == pytest.approx(least.min(initial=math.inf), rel=1e-6)
        delays = np.radians(np.mod(angles, 360.0)) / crossovers
        assert margin.delay == pytest.approx(delays.min(initial=math.inf), rel=1e-6)
        if least.size:
            assert margin.crossover == pytest.approx(crossovers[least.argmin()], rel=1e-6)
        sensitivity = 1.0 / (1.0 + loop(1j * FREQUENCIES))
        assert margin.disk == pytest.approx(1.0 / np.abs(sensitivity - 0.5).max(), rel=1e-3)
        farther = min(margin.gain_high, 1.0 / margin.gain_low if margin.gain_low else math.inf)
        assert margin.gain == pytest.approx(20.0 * math.log10(farther), rel=1e-12)


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


@pytest.mark.parametrize("inputs", [2, pytest.param(8, marks=pytest.mark.slow)])
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
        found = disk_of(loop)
        assert found.disk * max(bounds) < 1.0 + 1e-3
        assert (found.gain, found.phase) == disk_sizes(found.disk)
        if inputs <= 3:
            assert found.disk * max(bounds) > 1.0 - 2e-3
            M = loop.D if math.isinf(found.frequency) else loop.at(np.array([found.frequency]))[0]
            assert found.disk * scaled_norm(M, best_scaling(M)) == pytest.approx(1.0, abs=1e-3)


def test_gain_and_phase_of_a_disk_margin_are_the_textbooks() -> None:
    """A disk margin of 1 is a factor of 1/3 to 3 or 53.13 deg (Seiler, Packard, Gahinet 2020)."""
    assert disk_sizes(1.0) == pytest.approx((3.0, 53.13010235))
    assert disk_sizes(2.0) == (math.inf, 90.0)
    loop = LoopMargin(0.5, 3.0, 40.0, 2.0, 0.1, 1.0)
    named = named_margins(["flap"], [loop])["flap"]
    assert named == loop._asdict() | {"disk_gain": 3.0, "disk_phase": disk_sizes(1.0)[1]}


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


def test_a_delay_turns_a_leading_loop_by_more_than_half_a_turn() -> None:
    """The loop g s² / (s + 1)³ leads at both crossovers: a delay turns it by π + phase there.

    Crossovers are the roots of g² ω⁴ = (1 + ω²)³, the phase is π - 3 atan ω.
    """
    gain = 2.62
    A = [[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [-1.0, -3.0, -3.0]]
    linear = hfa.LinearModel.of(A, [[0.0], [0.0], [1.0]])
    squares = np.roots([1.0, 3.0 - gain**2, 3.0, 1.0])
    crossovers = np.sqrt(squares[squares > 0.0])
    phases = np.pi - 3.0 * np.arctan(crossovers)
    assert phases.min() > 0.0
    found = hfa.margins(linear, [[0.0, 0.0, gain]])["u1"]
    assert found.delay == pytest.approx(((np.pi + phases) / crossovers).min(), rel=1e-6)
