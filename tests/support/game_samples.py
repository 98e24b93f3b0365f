"""Games on which the exact solution is tested: games of the aircraft, and random ones."""

from __future__ import annotations

import math
from collections.abc import Iterable

import numpy as np
import pytest
from known_models import game_at

from hfa import Game, solve_game
from hfa.extend import Check
from hfa.paper import published_game
from hfa_model import VARIANTS, published_models

#: The initial state of the paper's experiments (Section 5.1).
INITIAL = np.array([5.0, 0.05, 0.0, 0.0, 0.0, 0.0])
#: Dihedral angles of the regenerated models, degrees.
ANGLES = (0, 5, 10, 15, 20)


def game_models() -> dict[str, Game]:
    """Return the games of the two printed models by name."""
    return {
        f"published-{model.dihedral_deg:g}": published_game(model.A, model.B)
        for model in published_models()
    }


def regenerated_models() -> dict[str, Game]:
    """Return the games of our models between 0 and 20 degrees, for both variants of the equations,
    by name.
    """
    return {
        f"regenerated-{dynamics}-{angle}": game_at(float(angle), dynamics)
        for dynamics in VARIANTS
        for angle in ANGLES
    }


def random_game(rng: np.random.Generator, *, scaled: bool) -> Game:
    """Return a random game with six states.

    It has one to five inputs, one to six disturbances, a Q of rank one to six, and delta from 0.3
    to 30.

    scaled: whether the units of the states differ by up to 1e8
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
    """Return one of the games and its P."""
    game = game_models()["published-15"]
    return game, solve_game(game).P


def game_in(state: float, of_input: float = 1.0) -> Game:
    """Return a plant of two states and two inputs with numbers near 1, the second of each in other
    units.
    """
    u = np.array([1.0, state])
    v = np.array([1.0, of_input])
    A = np.array([[-1.0, 0.2], [0.1, -1.0]])
    weights = np.diag(u**-2), np.diag(v**-2)
    return Game(A * u[:, None] / u, np.diag(u / v), np.diag(u), *weights, 5.0)
