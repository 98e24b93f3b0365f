"""Crossovers of a loop: in closed form, and where python-control finds them by polynomials."""

from __future__ import annotations

import math
import warnings

import control
import numpy as np
import pytest
from game_samples import game_models

from controller.analysis.solution_report import Loop
from verification import loop_margins, solve_game


def loop_of(numerator: list[float], denominator: list[float]) -> Loop:
    system = control.ss(control.tf(numerator, denominator))
    return Loop(system.A, system.B[:, 0], system.C[0])


def test_a_third_order_loop_in_closed_form() -> None:
    """L = 4 / (s + 1)³: real at ω = √3, where it is -1/2; of size one at ω² = 4^(2/3) - 1."""
    loop = loop_of([4.0], [1.0, 3.0, 3.0, 1.0])
    np.testing.assert_allclose(np.sort(loop.real_responses()), [-0.5, 4.0], rtol=1e-12)
    omega = math.sqrt(4 ** (2 / 3) - 1)
    np.testing.assert_allclose(loop.unit_responses(), [4 / (1 + 1j * omega) ** 3], rtol=1e-12)


def test_a_loop_without_crossovers_and_one_with_a_pole_at_zero() -> None:
    assert loop_of([0.5], [1.0, 1.0]).unit_responses().size == 0
    integrator = loop_of([2.0], [1.0, 0.0])
    assert integrator.real_responses().size == 0
    np.testing.assert_allclose(integrator.unit_responses(), [-1j], rtol=1e-12)


@pytest.mark.parametrize("factor", [0.3, 1.0, 3.0])
@pytest.mark.parametrize("name", sorted(game_models()))
def test_margins_are_those_of_python_control(name: str, factor: float) -> None:
    game = game_models()[name]
    K = factor * solve_game(game).K
    if np.linalg.eigvals(game.A - game.B @ K).real.max() >= 0.0:
        pytest.skip("the scaled gain does not stabilize")
    for i, margin in enumerate(loop_margins(game, K)):
        others = [j for j in range(game.B.shape[1]) if j != i]
        loop = control.ss(game.A - game.B[:, others] @ K[others], game.B[:, [i]], K[[i]], 0.0)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # where a loop has no crossover
            found, phases, *_ = control.stability_margins(loop, returnall=True)
        gains, phases = np.asarray(found), np.abs(np.asarray(phases))
        low, high = gains[(gains < 1.0) & (gains > 1e-12)], gains[gains > 1.0]
        assert margin.gain_low == pytest.approx(low.max(initial=0.0), rel=1e-6)
        assert margin.gain_high == pytest.approx(high.min(initial=math.inf), rel=1e-6)
        assert margin.phase == pytest.approx(np.minimum(phases, 360 - phases).min(initial=math.inf), rel=1e-6)
