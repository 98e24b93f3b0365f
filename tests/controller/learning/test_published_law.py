"""The paper's update law, Eq. (46): terms, explicit and implicit steps, and results."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from learning_samples import PUBLISHED, QUADRATIC, published, stable_game, value_of_policies
from reference_riccati import reference_solution, relative_error

from controller import basis, run
from controller.critic.training_run import TrainingRun
from controller.learning.published import (
    PublishedLaw,
    PublishedSettings,
    Sample,
    bellman,
    explicit_step_limit,
    proximal_step,
    published_law,
    signed_powers,
    theorem_gains,
    update_direction,
)
from controller.learning.recording import natural_spread
from hfa import Game, NoSolutionError

#: Settings with which the law converges without flight: implicit steps in scaled coordinates.
ALONE: dict[str, Any] = {
    "basis": "quadratic",
    "coordinates": "scaled",
    "integrator": "proximal",
    "step": 0.01,
}


def law_of(game: Game, **chosen: Any) -> PublishedLaw:
    return published_law(game, PublishedSettings(**chosen), seed=0)


def learned(game: Game, **chosen: Any) -> TrainingRun:
    law = law_of(game, **chosen)
    return law.conclude(run(law))


def random_sample(seed: int = 0, samples: int = 9, size: int = 4) -> Sample:
    rng = np.random.default_rng(seed)
    return Sample(rng.normal(size=(samples, size)), rng.normal(size=samples))


def test_residual_and_regressor_equal_the_papers_equations() -> None:
    """σ and e agree with Eq. (29) to (33) for explicit û and d̂ of arbitrary policies."""
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
    found = bellman(
        gradient[None], (game.A @ z)[None], np.array([z @ game.Q @ z]), game.S, W, policy
    )
    assert found[0][0] == pytest.approx(sigma, rel=1e-12)
    assert found[1][0] == pytest.approx(e, rel=1e-12)


def test_gains_equal_the_formulas_of_theorem_1() -> None:
    """The gains α equal the formulas of Theorem 1. For rank-deficient samples they are inf."""
    regressors = np.diag([2.0, 0.5])[[0, 1, 0]]
    gains = theorem_gains(regressors, gamma=0.01, eta=0.8, theta=0.9, T_w=10.0)
    assert gains.lambda_0 == pytest.approx(0.25)
    assert gains.c1 == pytest.approx((2 * 0.01 * 0.25) ** 0.6)
    assert gains.c2 == pytest.approx(3.0**-0.4 * (2 * 0.01 * 0.25) ** 1.4)
    assert gains.alpha1 == pytest.approx(np.pi / (0.9 * 5.0 * 0.8 * gains.c1))
    assert gains.alpha2 == pytest.approx(np.pi / (0.9 * 5.0 * 0.8 * gains.c2))
    poor = theorem_gains(np.array([[1.0, 0.0]] * 3), gamma=0.01, eta=0.8, theta=0.9, T_w=10.0)
    assert (poor.alpha1, poor.alpha2) == (np.inf, np.inf)


def test_explicit_steps_are_stable_below_the_limit() -> None:
    """Explicit Euler steps are stable below the step limit and unstable above it.

    The limit approaches 0 as the residuals approach 0.
    """
    sample = random_sample(3)
    gamma = 0.2
    a1 = 2.0
    a2 = 5.0
    eta = 0.8
    limit = explicit_step_limit(sample, gamma, a1, a2, eta)

    def growth(step: float) -> float:
        def moved(W: np.ndarray) -> np.ndarray:
            now = Sample(sample.regressors, sample.residuals + sample.regressors @ W)
            return W + step * update_direction(now, gamma, a1, a2, eta)

        jacobian = np.array([(moved(1e-7 * v) - moved(-1e-7 * v)) / 2e-7 for v in np.eye(4)])
        return float(np.abs(np.linalg.eigvals(jacobian)).max())

    assert growth(0.99 * limit) < 1.0
    assert growth(1.01 * limit) > 1.0
    # The step limit is inversely proportional to the rate of the law.
    assert explicit_step_limit(sample, 1e-6 * gamma, a1, a2, eta) == pytest.approx(1e6 * limit)
    at_rest = Sample(sample.regressors, np.zeros(9))
    assert explicit_step_limit(at_rest, gamma, a1, a2, eta) < 1e-200
    assert explicit_step_limit(Sample(np.zeros((2, 4)), np.ones(2)), gamma, a1, a2, eta) == np.inf


@pytest.mark.parametrize("gain", [1.0, 1e4, 1e9])
def test_implicit_step_satisfies_its_equation(gain: float) -> None:
    """An implicit step of the law satisfies (end - start) / step = direction(end), even for
    gains of 1e9.
    """
    sample = random_sample(4)
    gamma = 0.01
    step = 0.1
    start = np.array([0.5, -1.0, 2.0, 0.1])

    def at(W: np.ndarray) -> Sample:
        return Sample(sample.regressors, sample.residuals + sample.regressors @ W)

    end = proximal_step(at, start, step, gamma, gain, gain, 0.8)
    slope = update_direction(at(end), gamma, gain, gain, 0.8)
    largest = (
        gamma
        * np.abs(
            np.abs(at(end).regressors.T) @ np.abs(signed_powers(at(end).residuals, gain, gain, 0.8))
        ).max()
    )
    assert np.linalg.norm((end - start) / step - slope) < 1e-5 * largest


@pytest.mark.parametrize("name", PUBLISHED)
@pytest.mark.parametrize("policies", ["frozen", "reevaluated"])
def test_the_papers_settings_overflow_with_the_reason(name: str, policies: str) -> None:
    """With the paper's settings the law overflows. The error states lambda_0, alpha1 and the
    stable step.
    """
    game, _ = published(name)
    with pytest.raises(
        NoSolutionError,
        match=r"overflowed at step \d+ .*lambda_0 = .*alpha1 = .*explicit step below",
    ):
        run(law_of(game, stack_policies=policies))


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["root", pytest.param("squared", marks=pytest.mark.slow)])
def test_stored_policies_converge_within_the_theorems_time(kind: str) -> None:
    """With stored policies, the law converges to their value within the time of Theorem 1.

    The value of the stored policies differs from the value of the game by 10 to 100 %.
    """
    game, exact = published(PUBLISHED[1])
    recorded = reference_solution(replace(game, Q=1000.0 * np.eye(6), delta=np.inf)).P
    value = value_of_policies(game, recorded)
    weights = tuple(QUADRATIC.weights(recorded))
    options = {
        "normalisation": kind,
        "predefined_time": 5.0,
        "initial_weights": 0.0,
        "recorded_weights": weights,
    }
    result = learned(game, **ALONE | options)
    assert relative_error(result.P, value) < 1e-8
    assert 0.1 < relative_error(result.P, exact.P) < 1.0
    assert not result.settled
    own = result.law_residual_norm
    assert own[result.time >= 0.9 * 5.0 / 2.0].max() < 1e-8 * own[0]


def test_reevaluated_policies_converge_from_a_stabilizing_start() -> None:
    """With re-evaluated policies and a stabilizing start, the law converges to the game's P."""
    game, exact = published(PUBLISHED[1])
    start = tuple(
        QUADRATIC.weights(reference_solution(replace(game, Q=1000.0 * np.eye(6), delta=np.inf)).P)
    )
    options = {"stack_policies": "reevaluated", "predefined_time": 2.0, "initial_weights": start}
    options["box"] = tuple(natural_spread(game).tolist())
    result = learned(game, **ALONE | options)
    assert result.settled
    assert relative_error(result.P, exact.P) < 1e-9


def test_a_flight_equals_explicit_euler_steps() -> None:
    """A training run in flight with chosen gains α equals Euler steps written out in this test.

    The run does not settle. Its diagnostics contain the chosen gains and λ₀.
    """
    game = stable_game()
    functions = basis("quadratic", 2)
    flown = PublishedSettings(
        basis="quadratic",
        coordinates="raw",
        gains=(1.0, 2.0),
        predefined_time=0.05,
        step=0.01,
        samples=6,
        flight_start=(0.4, -0.2),
        initial_weights=1.0,
        recorded_weights=1.0,
        gamma=0.5,
    )
    law = published_law(game, flown, seed=0)
    z = np.array([0.4, -0.2])
    W = np.ones(3)
    states = law.stack.states
    drifts = law.stack.drifts
    for _ in range(5):
        step = np.zeros(3)
        for sample, (state, drift) in enumerate(
            [(z, game.A @ z), *zip(states, drifts, strict=True)]
        ):
            policy = W if sample == 0 else np.ones(3)
            sigma, e = bellman(
                functions.gradient(state)[None],
                drift[None],
                np.array([state @ game.Q @ state]),
                game.S,
                W,
                policy,
            )
            n = np.sqrt(1.0 + sigma[0] @ sigma[0])
            step += update_direction(Sample(sigma / n, e / n), 0.5, 1.0, 2.0, 0.8)
        rate = game.A @ z - 0.5 * game.S_control @ functions.gradient(z).T @ W
        W = W + 0.01 * step
        z = z + 0.01 * rate
    result = law.conclude(run(law))
    assert result.weights[-1] == pytest.approx(W, rel=1e-12)
    assert not result.settled
    assert result.diagnostics["alpha2"] == 2.0
    assert result.diagnostics["lambda_0"] == law.theorem.lambda_0
    assert result.time == pytest.approx([0.0, 0.01, 0.02, 0.03, 0.04, 0.05])
