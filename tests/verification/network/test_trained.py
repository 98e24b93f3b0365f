"""Networks fitted to the game at 15 deg by examples/train_a_network.py.

trained/: V, gradient and policy are tanh networks 6-32-32-k in float32, which take
z / (7 ft/s, 0.1 rad, 0.1 rad/s).
"""

from __future__ import annotations

from pathlib import Path

import casadi as ca
import numpy as np
import pytest

import hfa
from hfa import Game, from_network, verify
from verification import Scope

TRAINED = Path(__file__).with_name("trained")
BOX = np.array([7.0, *[0.1] * 5])
QUICK = Scope(flights=1)


@pytest.mark.parametrize(
    ("name", "points"),
    [("V", 3), pytest.param("policy", 5, marks=pytest.mark.slow)],
)
def test_the_search_finds_the_errors_of_a_grid(game: Game, name: str, points: int) -> None:
    """The errors that `verify` finds are at least as large as those on a grid of states.

    points: number of values for each state
    """
    exact = hfa.solve(game)
    z = np.array(np.meshgrid(*[np.linspace(-1.0, 1.0, points)] * 6)).reshape(6, -1) * BOX[:, None]
    largest = np.sqrt(game.R.diagonal()) * (np.abs(exact.K) @ BOX)
    sizes = np.maximum(largest, 1e-5 * largest.max()) / np.sqrt(game.R.diagonal())
    critic = from_network(game, TRAINED / f"{name}.npz", activation="tanh", scale=1.0 / BOX)
    verdict = verify(game, critic, scope=QUICK)
    at = ca.SX.sym("z", 6)
    errors = {"policy": (critic.policy(at) + ca.DM(exact.K) @ at) / ca.DM(sizes)}
    if critic.value is not None:
        exact_V = ca.bilin(ca.DM(exact.P), at, at)
        errors["value"] = (critic.value(at) - critic.constant - exact_V) / (
            BOX @ np.abs(exact.P) @ BOX
        )
    for kind, error in errors.items():
        on_grid = np.array(ca.Function(kind, [at], [error])(z))
        found = verdict.value_of(f"searched_{kind}_error")
        assert found * (1.0 + 1e-9) >= np.abs(on_grid).max()
