"""Games, exact solutions and initial weights for tests of the learning laws."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache

import numpy as np
from game_samples import game_models
from reference_riccati import Reference, reference_solution, relative_error
from scipy.linalg import solve_continuous_lyapunov

from controller import basis, random_pool
from controller.critic.training_run import TrainingRun
from controller.game.basis import Basis
from controller.learning.bellman_equations import StackEquations
from hfa import Game

QUADRATIC = basis("quadratic", 6)
#: Typical magnitudes of the six states, ft/s, rad and rad/s.
_SIZES = (7.0, 0.1, 0.1, 0.1, 0.1, 0.1)
PUBLISHED = tuple(game_models())


@cache
def published(name: str) -> tuple[Game, Reference]:
    """Return the game on a printed linear model and its 60-digit solution."""
    game = game_models()[name]
    return game, reference_solution(game)


@cache
def lq(name: str) -> tuple[Game, Reference]:
    """Return the LQ problem (delta = inf) on a printed linear model and its 60-digit solution."""
    game = game_models()[name].with_delta(np.inf)
    return game, reference_solution(game)


def stable_game(delta: float = 3.0) -> Game:
    """Return a game with a stable A, two states, one input and one disturbance."""
    return Game(
        A=[[-0.2, 1.0], [-2.0, -0.3]],
        B=[[0.0], [1.0]],
        E=[[1.0], [0.5]],
        Q=np.diag([2.0, 1.0]),
        R=[[0.5]],
        delta=delta,
    )


def random_start(
    index: int,
    game: Game,
    exact: np.ndarray,
    functions: Basis = QUADRATIC,
    sizes: Sequence[float] = _SIZES,
) -> np.ndarray:
    """Return random initial weights far from the solution.

    Depending on index modulo 4, the matrix is indefinite, a multiple of the solution plus noise,
    positive semidefinite, or random without scaling. The magnitude of the matrix varies over
    several decades.

    exact: solution P, (n, n)
    sizes: typical magnitudes of the states, (n,)
    """
    rng = np.random.default_rng(index)
    units = np.array(sizes)
    scaled = exact * np.outer(units, units)
    noise = rng.normal(size=exact.shape)
    noise = (noise + noise.T) / 2.0 * np.linalg.norm(scaled)
    if index % 4 == 0:
        start = noise * 10.0 ** rng.uniform(-6.0, 3.0)
    elif index % 4 == 1:
        start = scaled * 10.0 ** rng.uniform(-1.0, 2.0) + noise * 10.0 ** rng.uniform(-6.0, 1.0)
    elif index % 4 == 2:
        start = noise @ noise / np.linalg.norm(scaled) * 10.0 ** rng.uniform(-6.0, 3.0)
    else:
        return rng.normal(size=functions.size) * 10.0 ** rng.uniform(-3.0, 5.0)
    return functions.weights(start / np.outer(units, units))


def value_of_policies(game: Game, P: np.ndarray) -> np.ndarray:
    """Return the matrix V of the value of the policies u = -R⁻¹B'P z and d = δ⁻²E'P z.

    V solves (A - S P)'V + V (A - S P) + Q + P S P = 0.
    """
    return solve_continuous_lyapunov((game.A - game.S @ P).T, -(game.Q + P @ game.S @ P))


def abscissa(matrix: np.ndarray) -> float:
    return float(np.linalg.eigvals(matrix).real.max())


def start_at_the_edge(game: Game, exact: np.ndarray, seed: int, margin: float) -> np.ndarray:
    """Return initial weights with which the closed loop has a stability margin of about `margin`
    1/s.

    The weights are far larger than those of the solution.

    exact: solution P, (n, n)
    """
    rng = np.random.default_rng(seed)
    units = np.array(_SIZES)
    scaled = exact * np.outer(units, units)
    while True:
        noise = rng.normal(size=exact.shape)
        noise = (noise + noise.T) / 2.0 * np.linalg.norm(scaled) * 10.0
        inside = exact
        outside = exact + noise / np.outer(units, units)
        if abscissa(game.A - game.S_control @ outside) > 0.0:
            break
    low = 0.0
    high = 1.0
    for _ in range(200):
        middle = 0.5 * (low + high)
        if abscissa(game.A - game.S_control @ (inside + middle * (outside - inside))) < -margin:
            low = middle
        else:
            high = middle
    return QUADRATIC.weights(inside + low * (outside - inside))


def build(game: Game, name: str = "quadratic", samples: int = 60, seed: int = 0) -> StackEquations:
    stack = random_pool(game, samples, seed)
    return StackEquations.build(game, basis(name, len(game.A)), stack, stack.channel_scales())


def assert_exact(result: TrainingRun, exact: Reference, limit: float = 1e-9) -> None:
    assert result.outcome == "settled"
    assert relative_error(result.P, exact.P) <= limit
    assert relative_error(result.K, exact.K) <= limit
    assert result.settling_time <= result.settings["predefined_time"]
