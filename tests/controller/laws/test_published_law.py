"""The paper's update law, Eq. (46), as printed: its terms, its gains, its steps, and where it ends."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from learning_samples import PUBLISHED, QUADRATIC, published, stable_game
from reference_riccati import reference_solution, relative_error

from controller.game.basis import basis
from controller.game.zero_sum import Game
from controller.laws import certify
from controller.laws.learn import learn
from controller.laws.proximal import proximal_step
from controller.laws.published_equations import (
    RecordedStack,
    Sample,
    bellman,
    explicit_step_limit,
    normaliser,
    signed_powers,
    theorem_gains,
    update_direction,
)
from controller.laws.published_law import PublishedSettings, published_law
from controller.samples.recording import random_pool
from controller.samples.stack_equations import GAME, StackEquations
from controller.study.published_study import STUDY, StudyRow, StudyRun, published_study
from hfa_model.published import published_data
from hfa_model.support.errors import BadInputError, NoSolutionError


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
    second = 0.25 * np.sum((gradient @ equations.S(GAME)) * gradient, axis=1)
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


# Where it ends.


@pytest.mark.parametrize("name", PUBLISHED)
@pytest.mark.parametrize("policies", ["frozen", "reevaluated"])
def test_the_papers_settings_overflow_with_the_reason(name: str, policies: str) -> None:
    game, _ = published(name)
    with pytest.raises(NoSolutionError, match=r"overflowed at step \d+ .*lambda_0 = .*alpha1 = .*explicit step below"):
        learn(game, "published", stack_policies=policies)


def test_numbers_without_measure_overflow_in_one_line() -> None:
    """Neither a traceback of `theorem_gains` nor a warning, which the tests take for an error."""
    with pytest.raises(NoSolutionError, match="overflowed at step"):
        learn(stable_game(), "published", basis="quadratic", gamma=1e300)


def test_weights_that_stay_finite_and_whose_residual_does_not_are_not_certified() -> None:
    options = {"basis": "quadratic", "stack_policies": "reevaluated", "normalisation": "squared"}
    result = learn(published("15 deg")[0], "published", initial_weights=1e60, step=0.1, **options)
    assert result.residual_norm[-1] == np.inf
    assert result.settling_time == np.inf
    assert result.status.startswith("failed: ")


def test_defaults_are_those_of_the_paper() -> None:
    printed, chosen = published_data()["critic"], PublishedSettings()
    assert chosen.predefined_time == printed["T_w_s"]
    assert chosen.eta == printed["eta"]
    assert chosen.step == printed["step_s"]
    assert f"{chosen.gamma} I" == printed["Gamma"]
    assert f"{chosen.initial_weights:g} * ones(M)" == printed["W0"]
    assert basis(chosen.basis, 6).size == printed["M"]


@pytest.mark.parametrize("kind", ["root", "squared"])
def test_stored_policies_lead_to_their_own_value_in_the_time_of_the_theorem(kind: str) -> None:
    """The value of the recorded policies: (A - S P_r)'P + P (A - S P_r) + Q + P_r S P_r = 0."""
    from scipy.linalg import solve_continuous_lyapunov

    game, exact = published(PUBLISHED[1])
    recorded = reference_solution(replace(game, Q=1000.0 * np.eye(6), delta=np.inf)).P
    value = solve_continuous_lyapunov((game.A - game.S @ recorded).T, -game.Q - recorded @ game.S @ recorded)
    chosen: dict[str, Any] = {"basis": "quadratic", "coordinates": "scaled", "integrator": "proximal", "step": 0.01}
    weights = tuple(QUADRATIC.weights(recorded))
    result = learn(
        game,
        "published",
        **chosen,
        normalisation=kind,
        predefined_time=5.0,
        initial_weights=0.0,
        recorded_weights=weights,
    )
    assert relative_error(result.P, value) < 1e-8
    assert 0.1 < relative_error(result.P, exact.P) < 1.0
    assert not result.converged
    own = result.law_residual_norm
    assert own[result.times >= 0.9 * 5.0 / 2.0].max() < 1e-8 * own[0]


def test_reevaluated_policies_can_reach_the_game_from_a_stabilizing_start() -> None:
    game, exact = published(PUBLISHED[1])
    start = tuple(QUADRATIC.weights(reference_solution(replace(game, Q=1000.0 * np.eye(6), delta=np.inf)).P))
    chosen: dict[str, Any] = {"basis": "quadratic", "coordinates": "scaled", "integrator": "proximal", "step": 0.01}
    result = learn(
        game, "published", stack_policies="reevaluated", predefined_time=2.0, initial_weights=start, **chosen
    )
    assert result.converged
    assert relative_error(result.P, exact.P) < 1e-9


def test_gains_by_hand_fly_with_the_plant_and_end_uncertified() -> None:
    """z' = A z + B û is flown beside the learning: Euler steps of both, against a hand-written loop."""
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
    z, W = np.array([0.4, -0.2]), np.ones(3)
    states, drifts = law.stack.states, law.stack.drifts
    for _ in range(5):
        step = np.zeros(3)
        for sample, (state, drift) in enumerate([(z, game.A @ z), *zip(states, drifts, strict=True)]):
            policy = W if sample == 0 else np.ones(3)
            sigma, e = bellman(
                functions.gradient(state)[None], drift[None], np.array([state @ game.Q @ state]), game.S, W, policy
            )
            n = np.sqrt(1.0 + sigma[0] @ sigma[0])
            step += update_direction(Sample(sigma / n, e / n), 0.5, 1.0, 2.0, 0.8)
        rate = game.A @ z - 0.5 * game.S_control @ functions.gradient(z).T @ W
        W, z = W + 0.01 * step, z + 0.01 * rate
    result = learn(game, "published", **{name: getattr(flown, name) for name in flown.__dataclass_fields__})
    assert result.weights[-1] == pytest.approx(W, rel=1e-12)
    assert result.status.startswith("failed: ")
    assert result.diagnostics["alpha2"] == 2.0
    assert result.diagnostics["lambda_0"] == law.theorem.lambda_0
    assert result.times == pytest.approx([0.0, 0.01, 0.02, 0.03, 0.04, 0.05])


def test_history_is_thinned_evenly() -> None:
    chosen: dict[str, Any] = {"basis": "quadratic", "samples": 6, "gains": (1.0, 1.0), "initial_weights": 1.0}
    result = learn(stable_game(), "published", predefined_time=0.25, step=1e-4, gamma=1e-3, **chosen)
    assert len(result.times) == 1001
    assert np.diff(result.times) == pytest.approx(0.25 / 1000, abs=1.0001e-4)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"step": 20.0}, "must not exceed the predefined time"),
        ({"step": -1.0}, "step is -1.0"),
        ({"gamma": 0.0}, "gamma is 0.0"),
        ({"normalisation": "none"}, "normalisation is 'none'; choose one of: root, squared"),
        ({"stack_policies": "live"}, "stack_policies is 'live'"),
        ({"integrator": "rk4"}, "integrator is 'rk4'"),
        ({"coordinates": "polar"}, "coordinates is 'polar'"),
        ({"gains": (1.0,)}, r"gains are \(1.0,\)"),
        ({"gains": (1.0, -2.0)}, "at least 0"),
        ({"flight_start": (1.0, 2.0)}, "flight_start has 2 numbers; the plant has 6 states"),
        ({"samples": 24}, "24 samples cannot determine 25 weights"),
    ],
)
def test_bad_requests_name_the_setting(options: dict[str, Any], message: str) -> None:
    with pytest.raises(BadInputError, match=message):
        learn(published(PUBLISHED[0])[0], "published", **options)


# The table.


def test_study_rows_that_take_seconds() -> None:
    seen: list[float] = []
    explicit, frozen = published_study(
        ("theorem gains, explicit", "learning alone, frozen, implicit"), progress=lambda f, _: seen.append(f)
    )
    assert len(explicit.runs) == 48
    assert explicit.finished == ()
    assert all(run.explicit_step_limit < 1e-10 * run.settings.step for run in explicit.runs)
    assert len(frozen.finished) == len(frozen.runs) == 4
    assert all(0.2 < run.P_error < 0.4 and not run.certified for run in frozen.runs)
    assert all(run.settled <= 0.9 * 10.0 / 2.0 for run in frozen.runs)
    assert seen == sorted(seen)
    assert seen[-1] == 1.0


@pytest.mark.slow
def test_study_rows_that_take_minutes() -> None:
    rows = {row.name: row for row in published_study(tuple(STUDY)[1:])}
    assert not any(run.certified for run in rows["theorem gains, implicit"].runs)
    assert not any(run.stabilizing for run in rows["theorem gains, implicit"].runs)
    for name in ("gains by hand, raw, W(0) = 100", "gains by hand, scaled, W(0) = 100"):
        assert len(rows[name].finished) < len(rows[name].runs)
        assert all(run.P_error > 0.5 for run in rows[name].finished)
    by_hand = rows["gains by hand, scaled, stabilizing W(0)"]
    assert len(by_hand.finished) == len(by_hand.runs)
    assert all(0.1 < run.P_error < 10.0 for run in by_hand.runs)
    rich, poor = (rows[f"learning alone, re-evaluated, implicit{end}"].runs for end in ("", ", poorer stack"))
    assert sum(run.certified for run in rich) >= 10
    assert not any(run.certified for run in poor)


def test_study_refuses_a_reference_without_certificate(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(certify, "CORRECTION_LIMIT", 0.0)
    with pytest.raises(NoSolutionError, match="no certified reference for the study: failed: next Newton correction"):
        published_study(("learning alone, frozen, implicit",))


def test_study_rows_say_what_they_hold() -> None:
    with pytest.raises(BadInputError, match="unknown row 'nothing'; choose from: theorem gains, explicit"):
        published_study(("nothing",))
    empty = StudyRow("x", "why", (StudyRun(15.0, PublishedSettings(), 1e-9, 1.0, 2.0, 1e-5, overflow="lost"),))
    assert np.isnan(empty.span("P_error")[0])
    assert empty.span("alpha2") == (2.0, 2.0)
