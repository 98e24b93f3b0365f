"""Q-learning from recorded steps: convergence to the exact value, and refusal of bad input."""

from dataclasses import replace

import numpy as np
import pytest

from controller.discrete.solution import minimum_delta_discrete, solve_discrete
from controller.game.discrete_game import DiscreteGame
from controller.learning.q_learning import Steps, learn_steps, random_steps
from hfa import BadInputError, Game, NoSolutionError


def _problem(seed: int, delta: float = np.inf, discount: float = 0.97) -> DiscreteGame:
    rng = np.random.default_rng(seed)
    n = int(rng.integers(2, 6))
    A, B, E = (rng.standard_normal((n, size)) for size in (n, 2, 1))
    step = Game(1.3 * A / np.abs(np.linalg.eigvals(A)).max(), B, E, np.eye(n), np.eye(2), delta)
    return DiscreteGame(replace(step, N=0.1 * rng.standard_normal((n, 2))), discount)


@pytest.mark.parametrize(
    "seed", [0, 1, *(pytest.param(seed, marks=pytest.mark.slow) for seed in (2, 3))]
)
@pytest.mark.parametrize("margin", [np.inf, 1.1])
def test_q_learning_finds_the_exact_q_function(seed, margin):
    """Q-learning finds the exact P and H of random plants within 1e-9 of their largest entries.

    No initial policy is given.
    """
    problem = _problem(seed)
    if np.isfinite(margin):
        problem = _problem(seed, margin * minimum_delta_discrete(problem).value)
    exact = solve_discrete(problem)
    run, H = learn_steps(problem, seed)
    assert np.abs(run.P - exact.P).max() <= 1e-9 * np.abs(exact.P).max()
    assert np.abs(H - exact.H).max() <= 1e-9 * np.abs(exact.H).max()
    assert run.settled


def test_noise_changes_the_learned_gain_by_little():
    """Relative noise of 1e-3 in the next states changes the learned K by less than 5 %."""
    problem = _problem(1)
    steps = random_steps(problem, 0)
    noise = 1e-3 * np.random.default_rng(5).standard_normal(steps.next_states.shape)
    noisy = Steps(
        steps.states,
        steps.inputs,
        steps.disturbances,
        steps.next_states * (1.0 + noise),
    )
    run, _ = learn_steps(problem, steps=noisy)
    exact = solve_discrete(problem)
    error = np.linalg.norm(run.K - exact.K) / np.linalg.norm(exact.K)
    assert 1e-6 < error < 0.05


def test_unusable_games_and_steps_are_refused():
    """Games without a solution, and recorded steps without excitation or of unequal number, are
    refused.
    """
    problem = _problem(2)
    smallest = minimum_delta_discrete(problem).value
    with pytest.raises(NoSolutionError, match="delta"):
        learn_steps(_problem(2, 0.9 * smallest))
    unreached = DiscreteGame(Game([[1.2]], [[0.0]], [[1.0]], [[1.0]], [[1.0]], np.inf))
    with pytest.raises(NoSolutionError, match="Q-learning diverges"):
        learn_steps(unreached)
    steps = random_steps(problem, 0)
    parts = [steps.states, 0.0 * steps.inputs, steps.disturbances, steps.next_states]
    with pytest.raises(BadInputError, match="is 0 in every step"):
        learn_steps(problem, steps=Steps(*parts))
    parts[1] = steps.states[:, :2]
    with pytest.raises(BadInputError, match="the rank of the recorded steps is"):
        learn_steps(problem, steps=Steps(*parts))
    with pytest.raises(BadInputError, match="recorded inputs has"):
        Steps(steps.states, steps.inputs[:3], steps.disturbances, steps.next_states)
