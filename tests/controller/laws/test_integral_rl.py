"""The integral-learning baseline: exact data, exact policy evaluation, and what it needs."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from learning_samples import PUBLISHED, QUADRATIC, lq, published, stable_game
from reference_riccati import relative_error

from controller import basis, learn, random_pool, run
from controller.laws.integral_rl import IntegralLearning, IrlSettings, integral_learning
from controller.training_data.recording import probing_flight
from hfa_support import BadInputError, NoSolutionError


def stable_learning(**changes: Any) -> IntegralLearning:
    return integral_learning(stable_game(), IrlSettings(intervals=8, **changes), seed=3)


def value_of_policies(game: Any, P: np.ndarray) -> np.ndarray:
    """Value of u = -R⁻¹B'P z, d = δ⁻²E'P z: (A - S P)'V + V (A - S P) + Q + P S P = 0, as linear equations."""
    closed, eye = game.A - game.S @ P, np.eye(len(game.A))
    operator = np.kron(closed.T, eye) + np.kron(eye, closed.T)
    V = np.linalg.solve(operator, -(game.Q + P @ game.S @ P).reshape(-1))
    found: np.ndarray = V.reshape(P.shape)
    return found


def test_integrals_are_those_of_the_flight() -> None:
    """Against Simpson's rule on a fine grid."""
    from scipy.integrate import simpson

    law = stable_learning()
    game, s, data = law.game, law.settings, law.record
    times = np.linspace(0.0, 2 * s.interval, 801)
    z, u, d = probing_flight(game, 3, times, (s.probe, s.disturbance))
    z = z / data.scales
    for interval, rows in ((0, slice(0, 401)), (1, slice(400, 801))):
        for found, other in ((data.zz, z), (data.zu, u), (data.zd, d)):
            exact = simpson(z[rows, :, None] * other[rows, None, :], x=times[rows], axis=0)
            assert found[interval] == pytest.approx(exact, rel=1e-9, abs=1e-12)
    psi = law.basis.psi(z[::400])
    assert data.change[:2] == pytest.approx(np.diff(psi, axis=0), abs=1e-12)
    assert data.states[:2] == pytest.approx(z[[0, 400]], abs=1e-12)


@pytest.mark.parametrize("form", ["game", "lqr"])
def test_each_iteration_is_the_value_of_the_last_policies(form: str) -> None:
    law = stable_learning(form=form, iterations=4)
    weights = run(law).history["weights"]
    matrices = [law.basis.matrix(w) for w in weights]
    for before, after in pairwise(matrices):
        assert relative_error(after, value_of_policies(law.target, before)) < 1e-9


@pytest.mark.parametrize("seed", range(4))
def test_game_of_the_stable_model_from_nothing(seed: int) -> None:
    game, exact = published("published-5")
    result = learn(game, "irl", seed)
    assert result.status == "converged"
    assert relative_error(result.P, exact.P) < 1e-9
    assert relative_error(result.K, exact.K) < 1e-9
    errors = [relative_error(QUADRATIC.matrix(w), exact.P) for w in result.weights]
    assert 15 <= int(np.flatnonzero(np.array(errors) < 1e-3)[0]) <= 25
    assert result.diagnostics["iterations_to_1e-3"] <= 26
    assert result.times[0] == pytest.approx(8.0)


@pytest.mark.parametrize("name", PUBLISHED)
def test_lq_form_ignores_the_disturbance_weight(name: str) -> None:
    game, _ = published(name)
    _, exact = lq(name)
    start = tuple(QUADRATIC.weights(1.5 * exact.P))
    result = learn(game, "irl", form="lqr", initial_weights=start)
    assert result.status == "converged"
    assert relative_error(result.P, exact.P) < 1e-9


def test_an_unstable_plant_needs_a_stabilizing_start() -> None:
    game, exact = published("published-15")
    from_nothing = learn(game, "irl")
    assert from_nothing.outcome.startswith("failed: abscissa of A - S P")
    assert relative_error(from_nothing.P, exact.P) > 0.05
    start = tuple(QUADRATIC.weights(1.5 * lq("published-15")[1].P))
    assert learn(game, "irl", initial_weights=start).converged


@pytest.mark.parametrize("form", ["game", "lqr"])
def test_an_unmeasured_disturbance_biases_it(form: str) -> None:
    game, _ = published("published-5")
    exact = published("published-5")[1] if form == "game" else lq("published-5")[1]
    assert learn(game, "irl", form=form).converged
    biased = learn(game, "irl", form=form, disturbance_measured=False)
    assert biased.outcome.startswith("failed: ")
    assert relative_error(biased.K, exact.K) > 0.3
    assert learn(game, "irl", form=form, disturbance_measured=False, disturbance=0.0).converged


def test_learning_does_not_read_A(monkeypatch: pytest.MonkeyPatch) -> None:
    """With the flight recorded, another A changes no bit of the weights."""
    from dataclasses import replace

    law = stable_learning()
    recorded = law.record
    other = IntegralLearning(replace(law.game, A=-3.0 * np.eye(2)), law.basis, law.settings, law.seed)
    monkeypatch.setitem(other.__dict__, "record", recorded)
    assert np.array_equal(run(other).history["weights"], run(law).history["weights"])


def test_too_poor_a_flight_is_refused() -> None:
    game, _ = published("published-5")
    with pytest.raises(BadInputError, match="20 intervals cannot determine 21 weights"):
        learn(game, "irl", intervals=20)
    with pytest.raises(BadInputError, match=r"the flight has rank \d+ of 21"):
        learn(game, "irl", intervals=21, interval=1e-4)


def test_a_policy_without_value_breaks_down() -> None:
    """Weights that have run away: the cost of their policies overflows."""
    law = stable_learning()
    memory = law.start() | {"weights": np.array([1e200, 0.0, 1e200])}
    with pytest.raises(NoSolutionError, match="broke down at iteration 8: the policy it evaluates has no value"):
        law.advance(7, memory)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"interval": 0.0}, "interval is 0.0"),
        ({"intervals": 2.5}, "intervals is 2.5"),
        ({"iterations": 0}, "iterations is 0"),
        ({"probe": -1.0}, "probe is -1.0"),
        ({"form": "nash"}, "form is 'nash'; choose from game, lqr"),
        ({"disturbance": -0.1}, "disturbance is -0.1"),
        ({"intervals": 10_001}, "intervals is 10001; give a whole number from 1 to 10000"),
        ({"probe": 1e200}, r"the probing flight of 8 s grows beyond 1e\+100"),
        ({"disturbance": 1e150}, r"the probing flight of 8 s grows beyond 1e\+100"),
    ],
)
def test_bad_requests_name_the_setting(options: dict[str, Any], message: str) -> None:
    with pytest.raises(BadInputError, match=message):
        learn(stable_game(), "irl", **options)


def test_a_flight_that_leaves_all_bounds_is_refused() -> None:
    with pytest.raises(BadInputError, match=r"flight of 40000 s grows beyond 1e\+100; make interval"):
        learn(published("published-15")[0], "irl", interval=1000.0)


def test_recorded_pools_are_refused() -> None:
    game = stable_game()
    with pytest.raises(BadInputError, match="'irl' records its own data"):
        learn(game, "irl", pool=random_pool(game, 30, 0))
    assert basis("quadratic", 2).size == 3
