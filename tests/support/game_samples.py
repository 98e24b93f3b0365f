"""Games for tests of the exact solution: games of the aircraft, and random games."""

from __future__ import annotations

import math
from collections.abc import Iterable

import numpy as np
import pytest
from known_models import game_at

from hfa import Game, solve
from hfa.extend import Check
from hfa.paper import published_game
from hfa_model import VARIANTS, published_models

#: The initial state of the paper's experiments (Section 5.1).
INITIAL = np.array([5.0, 0.05, 0.0, 0.0, 0.0, 0.0])
#: Dihedral angles of the regenerated models, degrees.
ANGLES = (0, 5, 10, 15, 20)


def game_models() -> dict[str, Game]:
    """Return the games of the two printed linear models, by name."""
    return {
        f"published-{model.dihedral_deg:g}": published_game(model.A, model.B)
        for model in published_models()
    }


def regenerated_models() -> dict[str, Game]:
    """Return the games of every variant of the HFA dynamics at the dihedral angles `ANGLES`, by
    name.
    """
    return {
        f"regenerated-{dynamics}-{angle}": game_at(float(angle), dynamics)
        for dynamics in VARIANTS
        for angle in ANGLES
    }


def random_game(rng: np.random.Generator, *, scaled: bool) -> Game:
    """Return a random game with six states.

    The game has one to five inputs and one to six disturbances. Q has rank one to six, and delta is
    between 0.3 and 30.

    scaled: whether the states are in units that differ by factors of up to 1e8
    """
    n = 6
    m = int(rng.integers(1, 6))
    k = int(rng.integers(1, 7))
    rank = int(rng.integers(1, 7))
    A = rng.standard_normal((n, n))
    B = rng.standard_normal((n, m))
    E = rng.standard_normal((n, k)) if rng.random() < 0.5 else np.eye(n)
    C = rng.standard_normal((rank, n))
    root = rng.standard_normal((m, m))
    delta = math.exp(rng.uniform(math.log(0.3), math.log(30.0)))
    if scaled:
        units = 10.0 ** rng.uniform(-4.0, 4.0, n)
        A = A * units[:, None] / units
        B = B * units[:, None]
        E = E * units[:, None]
        C = C / units
    Q = C.T @ C
    R = root @ root.T + 0.1 * np.eye(m)
    return Game(A, B, E, (Q + Q.T) / 2.0, (R + R.T) / 2.0, delta)


def failed_names(checks: Iterable[Check]) -> set[str]:
    """Return the names of the checks that fail."""
    return {check.name for check in checks if not check.ok}


@pytest.fixture(
    params=["published-15", pytest.param("published-5", marks=pytest.mark.slow)],
)
def game(request: pytest.FixtureRequest) -> Game:
    return game_models()[request.param]


@pytest.fixture(scope="session")
def first() -> tuple[Game, np.ndarray]:
    """Return the game of the printed model at 15 deg, and its solution P."""
    game = game_models()["published-15"]
    return game, solve(game).P


def game_in(state: float, of_input: float = 1.0) -> Game:
    """Return a game with two states and two inputs, the second of which have other units.

    state, of_input: scale of the second state and the second input
    """
    u = np.array([1.0, state])
    v = np.array([1.0, of_input])
    A = np.array([[-1.0, 0.2], [0.1, -1.0]])
    weights = np.diag(u**-2), np.diag(v**-2)
    return Game(A * u[:, None] / u, np.diag(u / v), np.diag(u), *weights, 5.0)
