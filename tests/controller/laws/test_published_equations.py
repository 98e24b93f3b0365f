"""The terms of Eq. (46) and its explicit and implicit steps."""

from __future__ import annotations

import numpy as np
import pytest
from learning_samples import PUBLISHED, QUADRATIC, published, stable_game

from controller import Game, basis, random_pool
from controller.laws.published_equations import (
    RecordedStack,
    Sample,
    bellman,
    explicit_step_limit,
    normaliser,
    proximal_step,
    signed_powers,
    theorem_gains,
    update_direction,
)
from controller.training_data.stack_equations import StackEquations


def equations_of(game: Game, name: str = "quadratic", samples: int = 40) -> StackEquations:
    stack = random_pool(game, samples, 0)
    return StackEquations.build(game, basis(name, len(game.A)), stack, stack.channel_scales())


def random_sample(seed: int = 0, samples: int = 9, size: int = 4) -> Sample:
    rng = np.random.default_rng(seed)
    return Sample(rng.normal(size=(samples, size)), rng.normal(size=samples))


# The terms.


def test_residual_and_regressor_are_those_of_the_paper() -> None:
    """σ and e with û, d̂ put in one by one (Eq. 29-33), for a policy that is not that of the weights."""
    game = stable_game()
    functions = basis("quadratic+quartic", 2)
    rng = np.random.default_rng(1)
    W, policy = rng.normal(size=(2, functions.size))
    z = rng.normal(size=2)
    gradient = functions.gradient(z)
    u = -0.5 * np.linalg.solve(game.R, game.B.T @ gradient.T @ policy)
    d = game.E.T @ gradient.T @ policy / (2.0 * game.delta**2)
    sigma = gradient @ (game.A @ z + game.B @ u + game.E @ d)
    e = W @ sigma + z @ game.Q @ z + u @ game.R @ u - game.delta**2 * d @ d
    found = bellman(gradient[None], (game.A @ z)[None], np.array([z @ game.Q @ z]), game.S, W, policy)
    assert found[0][0] == pytest.approx(sigma, rel=1e-12)
    assert found[1][0] == pytest.approx(e, rel=1e-12)


def test_direction_is_the_printed_sum() -> None:
    sample, gamma, a1, a2, eta = random_sample(), 0.01, 3.0, 7.0, 0.8
    expected = np.zeros(4)
    for sigma, e in zip(*sample, strict=True):
        expected -= (a1 + 1.0) * gamma * sigma * abs(e) ** (1.0 - eta) * np.sign(e)
        expected -= (a2 + 1.0) * gamma * sigma * abs(e) ** (1.0 + eta) * np.sign(e)
    assert update_direction(sample, gamma, a1, a2, eta) == pytest.approx(expected, rel=1e-12)
    assert signed_powers(np.zeros(3), a1, a2, eta).tolist() == [0.0, 0.0, 0.0]


def test_both_normalisations() -> None:
    sigma = np.array([[3.0, 4.0]])
    assert normaliser(sigma, "squared").tolist() == [26.0]
    assert normaliser(sigma, "root") == pytest.approx([np.sqrt(26.0)])


def test_gains_are_those_of_the_theorem() -> None:
    regressors = np.diag([2.0, 0.5])[[0, 1, 0]]
    gains = theorem_gains(regressors, gamma=0.01, eta=0.8, theta=0.9, predefined_time=10.0)
    assert gains.lambda_0 == pytest.approx(0.25)
    assert gains.c1 == pytest.approx((2 * 0.01 * 0.25) ** 0.6)
    assert gains.c2 == pytest.approx(3.0**-0.4 * (2 * 0.01 * 0.25) ** 1.4)
    assert gains.alpha1 == pytest.approx(np.pi / (0.9 * 5.0 * 0.8 * gains.c1))
    assert gains.alpha2 == pytest.approx(np.pi / (0.9 * 5.0 * 0.8 * gains.c2))
    poor = theorem_gains(np.array([[1.0, 0.0]] * 3), gamma=0.01, eta=0.8, theta=0.9, predefined_time=10.0)
    assert (poor.alpha1, poor.alpha2) == (np.inf, np.inf)


@pytest.mark.parametrize("name", PUBLISHED)
def test_stored_policies_agree_with_current_ones_where_they_are_the_same(name: str) -> None:
    game, exact = published(name)
    equations = equations_of(game)
    W = equations.scaled(QUADRATIC.weights(1.3 * exact.P))
    current, stored = RecordedStack(equations, "root", None), RecordedStack(equations, "root", W)
    assert stored.at(W).residuals == pytest.approx(current.at(W).residuals, rel=1e-9)
    assert stored.at(W).regressors == pytest.approx(current.at(W).regressors, rel=1e-12)
    elsewhere = 2.0 * W
    assert np.linalg.norm(stored.at(elsewhere).regressors - current.at(elsewhere).regressors) > 1e-3
    assert stored.raw(elsewhere)[0] == pytest.approx(stored.raw(W)[0], rel=1e-15)


@pytest.mark.parametrize("name", PUBLISHED)
def test_residual_is_quadratic_in_the_weight_error(name: str) -> None:
    """ε_H of Eq. (35) is -¼ W̃'∂ψ S ∂ψ'W̃ for an exact basis: the ideal case of Theorem 1 does not occur.

    e = W̃'σ + ¼ W̃'M W̃ with M = ∂ψ S ∂ψ', σ at the current weights.
    """
    game, exact = published(name)
    equations = equations_of(game)
    W_exact = equations.scaled(QUADRATIC.weights(exact.P))
    error = np.random.default_rng(2).normal(size=21) * np.abs(W_exact)
    regressors, residuals = RecordedStack(equations, "root", None).raw(W_exact + error)
    gradient = np.einsum("jmi,m->ji", equations.gradient, error)
    second = 0.25 * np.sum((gradient @ equations.S) * gradient, axis=1)
    assert residuals - regressors @ error == pytest.approx(second, rel=1e-6, abs=1e-9 * np.abs(second).max())
    assert np.linalg.norm(second) > 0.01 * np.linalg.norm(residuals)


# The steps.


def test_explicit_steps_are_stable_below_the_limit_and_not_above() -> None:
    """Growth of a small disturbance of the weights under forward Euler, frozen policies."""
    sample, gamma, a1, a2, eta = random_sample(3), 0.2, 2.0, 5.0, 0.8
    limit = explicit_step_limit(sample, gamma, a1, a2, eta)

    def growth(step: float) -> float:
        def moved(W: np.ndarray) -> np.ndarray:
            now = Sample(sample.regressors, sample.residuals + sample.regressors @ W)
            return W + step * update_direction(now, gamma, a1, a2, eta)

        jacobian = np.array([(moved(1e-7 * v) - moved(-1e-7 * v)) / 2e-7 for v in np.eye(4)])
        return float(np.abs(np.linalg.eigvals(jacobian)).max())

    assert growth(0.99 * limit) < 1.0
    assert growth(1.01 * limit) > 1.0
    # The slower the law, the longer the step, without end.
    assert explicit_step_limit(sample, 1e-6 * gamma, a1, a2, eta) == pytest.approx(1e6 * limit)
    at_rest = Sample(sample.regressors, np.zeros(9))
    assert explicit_step_limit(at_rest, gamma, a1, a2, eta) < 1e-200
    assert explicit_step_limit(Sample(np.zeros((2, 4)), np.ones(2)), gamma, a1, a2, eta) == np.inf


@pytest.mark.parametrize("gain", [1.0, 1e4, 1e9])
def test_implicit_step_satisfies_its_equation(gain: float) -> None:
    sample, gamma, step = random_sample(4), 0.01, 0.1
    start = np.array([0.5, -1.0, 2.0, 0.1])

    def at(W: np.ndarray) -> Sample:
        return Sample(sample.regressors, sample.residuals + sample.regressors @ W)

    end = proximal_step(at, start, step, gamma, gain, gain, 0.8)
    slope = update_direction(at(end), gamma, gain, gain, 0.8)
    largest = (
        gamma * np.abs(np.abs(at(end).regressors.T) @ np.abs(signed_powers(at(end).residuals, gain, gain, 0.8))).max()
    )
    assert np.linalg.norm((end - start) / step - slope) < 1e-5 * largest


def test_implicit_step_reports_overflow() -> None:
    def at(W: np.ndarray) -> Sample:
        return Sample(np.ones((3, 2)), np.full(3, 1e200))

    with np.errstate(over="ignore", invalid="ignore"):
        assert np.all(np.isnan(proximal_step(at, np.zeros(2), 0.1, 0.01, 1e300, 1e300, 0.8)))
