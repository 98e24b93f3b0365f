"""Costs of policies and their excess over the optimum, each computed by a second method."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from game_samples import game_models
from stored_games import in_units, stored

from hfa import Game, from_gain, solve, verify

GAME = game_models()["published-15"]
EXACT = solve(GAME)
NOISE = np.random.default_rng(0).standard_normal(EXACT.K.shape)


def graded(game: Game, K: np.ndarray) -> dict[str, Any]:
    return verify(game, from_gain(game, K)).to_dict()["graded"]


def loss(game: Game, K: np.ndarray) -> np.ndarray:
    """Return D, with which z'Dz is the cost of u = -K z above the optimum z'Pz.

    Only the disturbance is free, so P + D is the value of the game without an input.
    """
    fixed = replace(game, A=game.A - game.B @ K, B=0.0 * game.B, Q=game.Q + K.T @ game.R @ K)
    return solve(fixed).P - solve(game).P


@pytest.mark.parametrize("delta", [200.0, math.inf])
def test_the_worst_and_mean_costs_are_eigenvalues_of_the_excess(delta: float) -> None:
    """Over initial conditions with z'Pz = 1, z'Dz is at most the largest eigenvalue of P^-1 D, and
    on average their mean.
    """
    game = GAME.with_delta(delta)
    K = solve(game).K * (1.0 + 0.1 * NOISE)
    shares = np.linalg.eigvals(np.linalg.solve(solve(game).P, loss(game, K))).real
    cost = graded(game, K)
    assert cost["cost_lost_worst_percent"] == pytest.approx(100.0 * shares.max(), rel=1e-6)
    assert cost["cost_lost_mean_percent"] == pytest.approx(100.0 * shares.mean(), rel=1e-6)


@pytest.mark.parametrize("is_discrete", [False, True])
def test_gains_and_distances_are_of_both_policies(is_discrete: bool) -> None:
    """The distance is the least σ_min(s I - A + B K) over the boundary of stability, relative to the
    norm of the loop, and both L2 gains are those on a grid. The game is balanced already.
    """
    A, scale, dt = [[-0.3, 1.0], [-1.0, -0.2]], 1.0, None
    if is_discrete:
        A, scale, dt = [[0.6, 0.4], [-0.4, 0.7]], 0.3, 1.0
    game = Game(A, scale * np.eye(2), np.eye(2), np.eye(2), np.eye(2), 9.0, dt=dt)
    exact = solve(game)
    found = graded(game, 0.2 * exact.K)
    s = 1j * np.linspace(0.0, 3.0, 3001)
    s = np.exp(s) if is_discrete else s
    for K, suffix in ((0.2 * exact.K, ""), (exact.K, "_exact")):
        loop = game.A - game.B @ K
        C = np.vstack([np.eye(2), K])
        shifted = s[:, None, None] * np.eye(2) - loop
        least = np.linalg.svd(shifted, compute_uv=False)[:, -1].min()
        distance = found[f"distance_to_instability{suffix}"]
        assert distance == pytest.approx(least / np.linalg.norm(loop, 2), rel=1e-5)
        largest = np.linalg.svd(C @ np.linalg.inv(shifted), compute_uv=False).max()
        assert found[f"l2_gain{suffix}"] == pytest.approx(largest, rel=1e-4)


@pytest.mark.parametrize(
    ("kind", "number", "worst"),
    [
        ("weak", 12, 0.009803929418),
        ("cheap", 148, 0.9858833746),
        ("cheap", 12, 0.009802960217),
        ("cheap", 36, 0.05982619190),
        ("stiff", 144, 4.276762789),
    ],
)
def test_costs_are_finite_where_rounding_hides_digits(kind: str, number: int, worst: float) -> None:
    """A gain that is 1 % too large costs what the same equations give with 60 digits."""
    game = stored(kind, number).game
    cost = graded(game, 1.01 * solve(game).K)
    assert cost["cost_lost_worst_percent"] == pytest.approx(worst, rel=1e-5)


@pytest.mark.parametrize(("kind", "number"), [("discrete", 3), ("discount", 22)])
def test_costs_beside_states_without_cost_do_not_depend_on_units(kind: str, number: int) -> None:
    """R is 0, and the optimum steers some states at no cost: what is lost there does not count."""
    game = stored(kind, number).game.with_delta(math.inf)
    other, units = in_units(game, np.random.default_rng(number), 10.0, 3)
    K = 1.5 * solve(game).K
    found = graded(other, K * units.u[:, None] / units.z)
    cost = graded(game, K)
    for name in ("cost_lost_worst_percent", "cost_lost_mean_percent"):
        assert 0.0 < found[name] == pytest.approx(cost[name], rel=1e-6)


def test_a_gain_beyond_delta_has_infinite_cost() -> None:
    """The excess cost is infinite if the L2 gain is above delta, and if K destabilizes."""
    tight = GAME.with_delta(151.0)
    assert verify(tight, from_gain(tight, 0.3 * solve(tight).K)).cost_lost == math.inf
    assert verify(GAME, from_gain(GAME, -EXACT.K)).cost_lost == math.inf


def test_zero_gain_is_optimal_without_state_cost() -> None:
    """In a game without state cost, zero gain is 0 % above the optimum."""
    game = Game(-np.eye(2), np.eye(2), np.eye(2), np.zeros((2, 2)), np.eye(2), 5.0)
    assert verify(game, from_gain(game, np.zeros((2, 2)))).cost_lost == 0.0
