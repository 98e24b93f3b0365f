"""Costs of policies and their excess over the optimum, each computed by a second method."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from game_samples import INITIAL, game_models
from tolerances import FEW_ROUNDINGS

from controller.riccati.cost import flight_cost, loss_matrix
from controller.riccati.meaning import cost_check, cost_matrix
from hfa import Game, NoSolutionError, solve


def test_cost_is_exact_to_1e12(game: Game) -> None:
    """The value z'Pz equals the cost computed from the Lyapunov equation to 1e-12."""
    for initial in (INITIAL, np.array([-3.0, 0.1, -0.2, 0.3, 0.05, -0.4])):
        assert cost_check(game, solve(game).P, initial).value < 1e-12


def test_a_value_off_by_a_millionth_fails(
    first: tuple[Game, np.ndarray],
) -> None:
    """A P with a relative error of 1e-6 fails the cost check."""
    game, P = first
    assert not cost_check(game, P * (1.0 + 1e-6), INITIAL).ok


def test_destabilizing_policies_have_no_cost(first: tuple[Game, np.ndarray]) -> None:
    """Policies that do not stabilize fail the cost check, and their cost matrix is refused."""
    game, P = first
    check = cost_check(game, -P, INITIAL)
    assert not check.ok
    assert "are not stabilizing" in check.reason
    with pytest.raises(NoSolutionError, match=r"these policies have infinite cost"):
        cost_matrix(game, -game.gain(P), game.disturbance_gain(P))


def test_scalar_policy_cost_equals_closed_form() -> None:
    """The cost of given policies in a scalar game equals its closed form."""
    game = Game(
        [[-1.0]], [[1.0]], [[1.0]], [[2.0]], [[3.0]], 2.0
    )  # u = -z/2, d = z/4: z' = -1.25 z
    exact = (2.0 + 3.0 / 4.0 - 4.0 / 16.0) / 2.5
    policies = np.array([[0.5]]), np.array([[0.25]])
    assert cost_matrix(game, *policies)[0, 0] == pytest.approx(exact, rel=FEW_ROUNDINGS)


GAME = game_models()["published-15"]
EXACT = solve(GAME)
NOISE = np.random.default_rng(0).standard_normal(EXACT.K.shape)


@pytest.mark.parametrize("size", [1e-3, 1e-1, 0.3])
@pytest.mark.parametrize("delta", [200.0, math.inf])
def test_loss_gives_the_value_of_fixed_gain(size: float, delta: float) -> None:
    """P* + D is the value of the game in which u = -K z is fixed and only the disturbance is free.

    P* is the optimal value, and D the computed loss of K.
    """
    game = GAME.with_delta(delta)
    exact = solve(game)
    K = exact.K * (1.0 + size * NOISE)
    D = loss_matrix(game, exact, K)
    assert D is not None
    fixed = replace(game, A=game.A - game.B @ K, B=0.0 * game.B, Q=game.Q + K.T @ game.R @ K)
    residual = fixed.residual(exact.P + D)
    assert np.abs(residual).max() <= 1e-9 * np.abs(fixed.Q).max()
    assert np.linalg.eigvalsh(D)[0] >= -1e-10 * np.abs(D).max()


def test_no_initial_condition_exceeds_the_reported_cost() -> None:
    """The excess costs of a gain from 4,000 random initial conditions are at most the reported
    worst one.

    The largest is at least 80 % of the worst case, and the mean is within 10 % of the reported
    mean.
    """
    K = EXACT.K * (1.0 + 0.1 * NOISE)
    D = loss_matrix(GAME, EXACT, K)
    cost = flight_cost(GAME, EXACT, K)
    assert D is not None
    starts = np.random.default_rng(1).standard_normal((4000, 6)) @ np.linalg.inv(
        np.linalg.cholesky(EXACT.P)
    )
    lost = (
        100.0
        * np.einsum("ni,ij,nj->n", starts, D, starts)
        / np.einsum("ni,ij,nj->n", starts, EXACT.P, starts)
    )
    assert lost.max() <= cost.worst * (1.0 + 1e-9)
    assert lost.max() >= 0.8 * cost.worst
    assert lost.mean() == pytest.approx(cost.mean, rel=0.1)


def test_gains_and_distances_are_of_both_policies() -> None:
    """The distance is the least σ_min(jω I - A + B K) over ω, relative to the norm of the loop.

    The game is balanced already, and both L2 gains are those on a grid of frequencies.
    """
    game = Game([[-0.3, 1.0], [-1.0, -0.2]], np.eye(2), np.eye(2), np.eye(2), np.eye(2), 4.0)
    exact = solve(game)
    cost = flight_cost(game, exact, 0.2 * exact.K)
    frequencies = np.linspace(0.0, 3.0, 3001)
    for K, distance, gain in (
        (0.2 * exact.K, cost.distance, cost.gain),
        (exact.K, cost.exact_distance, cost.exact_gain),
    ):
        loop = game.A - game.B @ K
        C = np.vstack([np.eye(2), K])
        s = 1j * frequencies[:, None, None] * np.eye(2) - loop
        least = np.linalg.svd(s, compute_uv=False)[:, -1].min()
        assert distance == pytest.approx(least / np.linalg.norm(loop, 2), rel=1e-5)
        largest = np.linalg.svd(C @ np.linalg.inv(s), compute_uv=False).max()
        assert gain == pytest.approx(largest, rel=1e-4)
    assert cost.distance < 0.7 * cost.exact_distance


def test_a_gain_beyond_delta_has_infinite_cost() -> None:
    """The excess cost is infinite if the L2 gain is above delta, if K destabilizes, and if K is
    nan."""
    tight = GAME.with_delta(151.0)
    loose = flight_cost(tight, solve(tight), 0.3 * solve(tight).K)
    assert loose.worst == loose.mean == math.inf
    for K in (-EXACT.K, np.full_like(EXACT.K, np.nan)):
        lost = flight_cost(GAME, EXACT, K)
        assert (lost.worst, lost.gain, lost.distance) == (math.inf, math.inf, 0.0)
        assert lost.to_dict()["cost_lost_worst_percent"] is None


def test_zero_gain_is_optimal_without_state_cost() -> None:
    """In a game without state cost, zero gain is 0 % above the optimum."""
    game = Game(-np.eye(2), np.eye(2), np.eye(2), np.zeros((2, 2)), np.eye(2), 5.0)
    assert flight_cost(game, solve(game), np.zeros((2, 2))).worst == 0.0
