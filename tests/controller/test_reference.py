"""Exact feedforward of a game for a reference."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

pytest.importorskip("hfa_flight")

from typing import Any

from game_samples import game_models

from hfa import Game, LinearModel, solve, track

#: Constant, ramp and two sinusoids in several states.
COMMAND = {
    "x1": "7+0.01t+2sin(0.5t)",
    "x2": "0.1+0.03cos(1.3t)",
    "x3": "0.002t+0.02sin(1.3t)",
    "x5": "0.5+0.1sin(1.3t)",
}


def exact_feedforward(game: Game) -> Any:
    """Return the exact feedforward of a game for the command."""
    linear = LinearModel.of(game.A, game.B)
    own = Game(game.A, game.B, game.E, game.Q, game.R, game.delta, game.N)
    return track(linear, solve(own), COMMAND).exact


@pytest.fixture(params=["plain", "cross weights"])
def game(request: pytest.FixtureRequest) -> Game:
    """The paper's game at 5 deg, also with cross weights N."""
    found = game_models()[min(game_models())]
    if request.param == "plain":
        return found
    N = 0.1 * np.random.default_rng(3).standard_normal((6, 5))
    return replace(found, Q=found.Q + np.eye(6), R=found.R + np.eye(5), N=N)


def test_feedforward_satisfies_its_differential_equation(game: Game) -> None:
    """The costate s(t) satisfies -s' = (A - S P)'s + P r, with derivatives by central differences."""
    P = solve(game).P
    exact = exact_feedforward(game)
    s, reference = exact.costate, exact.reference
    plain = game.without_cross_weights
    loop = plain.A - plain.S @ P
    step = 1e-3
    weights = np.array([1.0, -8.0, 8.0, -1.0]) / 12e-3
    for t in (0.0, 3.0, 17.0):
        around = [t + k * step for k in (-2, -1, 1, 2)]
        r = game.A @ reference.at(t) - weights @ np.array([reference.at(each) for each in around])
        rate = weights @ np.array([s.at(each) for each in around])
        assert np.abs(rate + loop.T @ s.at(t) + P @ r).max() < 1e-9 * np.abs(P @ r).max()
