"""Integral reinforcement learning: recorded integrals, policy evaluation and requirements."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from learning_samples import QUADRATIC, lq, published, stable_game
from reference_riccati import relative_error

import hfa
from controller import basis
from controller.learning.integral_rl import (
    IntegralLearning,
    IrlSettings,
    baseline_weights,
    probing_flight,
)
from controller.riccati.balancing import is_hurwitz
from hfa import BadInputError, NoSolutionError


def stable_learning(**changes: Any) -> IntegralLearning:
    return IntegralLearning(
        stable_game(), basis("quadratic", 2), IrlSettings(intervals=8, **changes), seed=3
    )


def test_recorded_integrals_agree_with_simpsons_rule() -> None:
    """The recorded integrals of a flight agree with Simpson's rule on a fine grid."""
    from scipy.integrate import simpson

    law = stable_learning()
    game = law.game
    s = law.settings
    data = law.record
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


@pytest.mark.parametrize("seed", range(2))
def test_a_stable_plant_is_learned_from_zero(seed: int) -> None:
    """For a stable plant, learning from zero weights converges to the exact P and K."""
    game, exact = published("published-5")
    result = hfa.learn(game, "integral-rl", seed)
    assert result.outcome == "settled"
    assert relative_error(result.P, exact.P) < 1e-9
    assert relative_error(result.K, exact.K) < 1e-9
    errors = [relative_error(QUADRATIC.matrix(w), exact.P) for w in result.weights]
    assert 15 <= int(np.flatnonzero(np.array(errors) < 1e-3)[0]) <= 25
    assert result.diagnostics["iterations_to_1e-3"] <= 26
    assert result.time[0] == pytest.approx(8.0)


def test_an_unstable_plant_needs_a_stabilizing_start() -> None:
    """For the unstable aircraft at 15 deg, learning converges only from a stabilizing policy."""
    game, exact = published("published-15")
    from_nothing = hfa.learn(game, "integral-rl")
    assert not is_hurwitz(game.A - game.S @ from_nothing.P)
    assert relative_error(from_nothing.P, exact.P) > 0.05
    learned = hfa.learn(game, "integral-rl", initial_weights=baseline_weights(game))
    assert learned.settled
    assert relative_error(learned.K, exact.K) < 1e-5


@pytest.mark.parametrize("form", ["game", "lqr"])
def test_an_unmeasured_disturbance_biases_the_gain(form: str) -> None:
    """A disturbance that is not measured causes an error of the learned gain."""
    game, _ = published("published-5")
    exact = published("published-5")[1] if form == "game" else lq("published-5")[1]
    assert hfa.learn(game, "integral-rl", form=form).settled
    biased = hfa.learn(game, "integral-rl", form=form, disturbance_measured=False)
    assert not biased.settled
    assert relative_error(biased.K, exact.K) > 0.3
    assert hfa.learn(
        game, "integral-rl", form=form, disturbance_measured=False, disturbance=0.0
    ).settled


def test_data_without_a_result_are_refused() -> None:
    """Data of low rank, an overflowing flight and a policy without a value raise errors."""
    game, _ = published("published-5")
    with pytest.raises(BadInputError, match=r"rank of the flight is \d+ of 21"):
        hfa.learn(game, "integral-rl", intervals=21, interval=1e-4)
    with pytest.raises(BadInputError, match=r"grows beyond 1e\+100; make interval"):
        hfa.learn(published("published-15")[0], "integral-rl", interval=1000.0)
    law = stable_learning()
    memory = law.start() | {
        "weights": np.array([1e200, 0.0, 1e200])
    }  # the cost of their policies overflows
    with pytest.raises(
        NoSolutionError, match="broke down at iteration 8: the policy it evaluates has no value"
    ):
        law.advance(7, memory)


def test_the_probing_flight_agrees_with_dop853() -> None:
    """The probing flight agrees with SciPy's DOP853 for z' = A z + B u(t) + E d(t)."""
    from scipy.integrate import solve_ivp

    game = stable_game()
    times = np.linspace(0.0, 1.0, 6)
    z, u, d = probing_flight(game, 7, times, (0.3, 0.2))

    def rate(t: float, state: np.ndarray) -> np.ndarray:
        _, inputs, disturbances = probing_flight(game, 7, np.array([t]), (0.3, 0.2))
        return game.A @ state + game.B @ inputs[0] + game.E @ disturbances[0]

    flown = solve_ivp(
        rate, (0.0, 1.0), z[0], method="DOP853", t_eval=times, rtol=1e-9, atol=1e-12
    ).y.T
    assert np.abs(flown - z).max() < 1e-8
    assert 0.0 < np.abs(u).max() <= 0.3
    assert 0.0 < np.abs(d).max() <= 0.2
