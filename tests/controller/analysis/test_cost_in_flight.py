"""What a critic costs in flight, against costs that are computed in another way."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from game_samples import game_models

from controller import Game
from controller.analysis.cost import flight_cost, loss_matrix
from verification import bounded_real_gain, check_critic, from_value, solve_game

GAME = game_models()["published-15"]
EXACT = solve_game(GAME)
NOISE = np.random.default_rng(0).standard_normal(EXACT.K.shape)


@pytest.mark.parametrize("size", [1e-3, 1e-1, 0.3])
@pytest.mark.parametrize("delta", [200.0, math.inf])
def test_the_loss_is_that_of_the_cost_equation_of_the_gain(size: float, delta: float) -> None:
    """P* + D is the value of the game in which the control is fixed to -K z and only the disturbance plays."""
    game = GAME.with_delta(delta)
    exact = solve_game(game)
    K = exact.K * (1.0 + size * NOISE)
    D = loss_matrix(game, exact, K)
    assert D is not None
    fixed = replace(game, A=game.A - game.B @ K, B=0.0 * game.B, Q=game.Q + K.T @ game.R @ K)
    residual = fixed.residual(exact.P + D)
    assert np.abs(residual).max() <= 1e-9 * np.abs(fixed.Q).max()
    assert np.linalg.eigvalsh(D)[0] >= -1e-10 * np.abs(D).max()


def test_the_loss_grows_with_the_square_of_the_error() -> None:
    one, ten = (flight_cost(GAME, EXACT, EXACT.K * (1.0 + size * NOISE)) for size in (1e-4, 1e-3))
    assert ten.worst / one.worst == pytest.approx(100.0, rel=0.05)
    assert 0.0 < one.mean < one.worst
    assert one.within(one.worst)
    assert not one.within(0.5 * one.worst)


def test_a_start_is_found_that_costs_what_is_said() -> None:
    K = EXACT.K * (1.0 + 0.1 * NOISE)
    D, found = loss_matrix(GAME, EXACT, K), flight_cost(GAME, EXACT, K)
    assert D is not None
    starts = np.random.default_rng(1).standard_normal((4000, 6)) @ np.linalg.inv(np.linalg.cholesky(EXACT.P))
    lost = 100.0 * np.einsum("ni,ij,nj->n", starts, D, starts) / np.einsum("ni,ij,nj->n", starts, EXACT.P, starts)
    assert lost.max() <= found.worst * (1.0 + 1e-9)
    assert lost.max() >= 0.8 * found.worst
    assert lost.mean() == pytest.approx(found.mean, rel=0.1)


def test_the_exact_critic_costs_nothing() -> None:
    found = flight_cost(GAME, EXACT, EXACT.K)
    assert (found.worst, found.mean) == (0.0, 0.0)
    assert found.gain == found.exact_gain == bounded_real_gain(GAME, EXACT.K)
    assert found.distance == found.exact_distance > 0.0


def test_a_gain_beyond_delta_or_unstable_costs_without_bound() -> None:
    tight = GAME.with_delta(151.0)
    loose = flight_cost(tight, solve_game(tight), 0.3 * solve_game(tight).K)
    assert loose.worst == loose.mean == math.inf
    for K in (-EXACT.K, np.full_like(EXACT.K, np.nan)):
        lost = flight_cost(GAME, EXACT, K)
        assert (lost.worst, lost.gain, lost.distance) == (math.inf, math.inf, 0.0)
        assert lost.to_dict()["cost_lost_worst_percent"] is None


def test_a_game_that_costs_nothing() -> None:
    game = Game(-np.eye(2), np.eye(2), np.eye(2), np.zeros((2, 2)), np.eye(2), 5.0)
    assert flight_cost(game, solve_game(game), np.zeros((2, 2))).worst == 0.0


def test_an_indefinite_value_within_the_allowed_error_passes() -> None:
    """The second state costs nothing: its value 0 may be off by what the limit allows, and not by more."""
    game = Game(-np.eye(2), np.eye(2), np.eye(2), np.diag([1.0, 0.0]), np.eye(2), 5.0)
    P = solve_game(game).P - np.diag([0.0, 1e-8])
    sign = {limit: check_critic(game, from_value(game, P), limit=limit) for limit in (1e-6, 1e-2)}
    named = {limit: {row.name: row.ok for row in check.checks} for limit, check in sign.items()}
    assert named[1e-6]["P_smallest_eigenvalue"] is False
    assert named[1e-2]["P_smallest_eigenvalue"] is True
    assert sign[1e-2].ok
