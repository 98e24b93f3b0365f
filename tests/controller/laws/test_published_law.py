"""The paper's update law, Eq. (46), as printed: where it ends."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from learning_samples import PUBLISHED, QUADRATIC, published, stable_game
from reference_riccati import reference_solution, relative_error

from controller import PublishedSettings, basis, learn
from controller.laws.published_equations import (
    Sample,
    bellman,
    update_direction,
)
from controller.laws.published_law import published_law
from hfa_model.printed_matrices import published_data
from hfa_support import BadInputError, NoSolutionError


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
    result = learn(published("published-15")[0], "published", initial_weights=1e60, step=0.1, **options)
    assert result.residual_norm[-1] == np.inf
    assert result.settling_time == np.inf
    assert result.outcome.startswith("failed: ")


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
    assert result.outcome.startswith("failed: ")
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
        ({"normalisation": "none"}, "normalisation is 'none'; choose from root, squared"),
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
