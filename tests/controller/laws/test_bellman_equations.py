"""The residuals of the stack: their derivative, their course along a step, and the Riccati equation behind them."""

from __future__ import annotations

import numpy as np
import pytest
from learning_samples import (
    PUBLISHED,
    QUADRATIC,
    build,
    published,
)

from controller.game.basis import BASES
from controller.laws.bellman_equations import GAME, LQ, PartialGame


@pytest.mark.parametrize("name", BASES)
def test_regressor_is_the_derivative_of_the_residual(name: str) -> None:
    """∂e_j/∂W = σ_j where the value is quadratic, with any policy terms re-evaluated: remainder of order 2."""
    game, exact = published(PUBLISHED[0])
    equations = build(game, name)
    weights = equations.scaled(equations.basis.weights(1.5 * exact.P))
    direction = np.random.default_rng(1).normal(size=equations.basis.size) * np.abs(weights).max()
    for problem in (GAME, LQ, PartialGame(0.7, 0.3)):
        found = equations.at(weights, problem)
        remainders = [
            np.linalg.norm(
                equations.at(weights + h * direction, problem).residuals
                - found.residuals
                - h * found.regressors @ direction
            )
            for h in (1e-5, 1e-6)
        ]
        assert np.log10(remainders[0] / remainders[1]) == pytest.approx(2.0, abs=0.01)
        wrong = found.regressors + 0.1 * np.abs(found.regressors).max()
        missed = [
            np.linalg.norm(
                equations.at(weights + h * direction, problem).residuals - found.residuals - h * wrong @ direction
            )
            for h in (1e-5, 1e-6)
        ]
        assert np.log10(missed[0] / missed[1]) < 1.9


@pytest.mark.parametrize("name", BASES)
def test_residual_along_a_step_is_an_exact_parabola(name: str) -> None:
    game, _ = published(PUBLISHED[1])
    equations = build(game, name)
    rng = np.random.default_rng(2)
    weights, step = rng.normal(size=(2, equations.basis.size)) * 100.0
    problem = PartialGame(0.4, 0.6)
    found = equations.at(weights, problem)
    linear, quadratic = equations.along_step(weights, step, found, problem)
    for f in (0.3, 1.0, -2.0):
        exact = equations.at(weights - f * step, problem).residuals
        assert np.linalg.norm(found.residuals + f * linear + f * f * quadratic - exact) < 1e-12 * np.linalg.norm(exact)


def test_residuals_are_those_of_the_discounted_riccati_equation() -> None:
    game, exact = published(PUBLISHED[0])
    equations = build(game)
    P, problem = 0.7 * exact.P, PartialGame(0.3, 0.4)
    S = game.S_control - 0.4 * game.S_disturbance / game.delta**2
    A = game.A - 0.3 * np.eye(6)
    residual = A.T @ P + P @ A + game.Q - P @ S @ P
    z = equations.states * equations.scales
    found = equations.at(equations.scaled(QUADRATIC.weights(P)), problem).residuals
    assert found == pytest.approx(np.sum((z @ residual) * z, axis=1), rel=1e-9)
