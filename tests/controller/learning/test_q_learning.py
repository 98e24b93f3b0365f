"""Q-learning from recorded steps: convergence to the exact value, and refusal of bad input."""

import numpy as np
import pytest

from controller import minimum_delta
from hfa import Game, NoSolutionError, learn, solve


def _problem(seed, delta=np.inf, discount=0.97):
    """Return a random game in discrete time, with 2 to 5 states, two inputs and cross weights."""
    rng = np.random.default_rng(seed)
    n = int(rng.integers(2, 6))
    A, B, E = (rng.standard_normal((n, size)) for size in (n, 2, 1))
    A *= 1.3 / np.abs(np.linalg.eigvals(A)).max()
    N = 0.1 * rng.standard_normal((n, 2))
    return Game(A, B, E=E, Q=np.eye(n), R=np.eye(2), N=N, delta=delta, dt=True, discount=discount)


@pytest.mark.parametrize(
    "seed", [0, 1, *(pytest.param(seed, marks=pytest.mark.slow) for seed in (2, 3))]
)
@pytest.mark.parametrize("margin", [np.inf, 1.1])
def test_q_learning_finds_the_exact_q_function(seed, margin):
    """Q-learning finds the exact P and H of random plants within 1e-9 of their largest entries.

    No initial policy is given. The delta is infinite, or 1.1 times the smallest one.
    """
    problem = _problem(seed)
    if np.isfinite(margin):
        problem = _problem(seed, margin * minimum_delta(problem).value)
    exact = solve(problem)
    run = learn(problem, seed=seed)
    H = run.H
    assert np.abs(run.P - exact.P).max() <= 1e-9 * np.abs(exact.P).max()
    assert np.abs(H - exact.H).max() <= 1e-9 * np.abs(exact.H).max()
    assert run.outcome == "settled"


def test_games_without_a_solution_are_refused():
    """A random game in discrete time with a delta 10 % below the smallest is refused, and so is an
    unstable plant that no input reaches (B = 0).
    """
    smallest = minimum_delta(_problem(2)).value
    unreached = Game([[1.2]], [[0.0]], E=[[1.0]], Q=[[1.0]], R=[[1.0]], delta=np.inf, dt=True)
    for game, named in (
        (_problem(2, 0.9 * smallest), "choose a larger delta"),
        (unreached, "diverges"),
    ):
        with pytest.raises(NoSolutionError, match=named):
            learn(game)
