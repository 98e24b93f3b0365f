"""Q-learning from recorded steps: convergence to the exact value, and refusal of bad input."""

from dataclasses import replace

import numpy as np
import pytest

from controller import minimum_delta
from controller.game.q_function import of_q_function, q_function
from controller.learning.q_learning import QLearner, random_steps
from controller.learning.recording import natural_spread
from hfa import Game, NoSolutionError, learn, solve
from tests.support.steps_of import in_steps


def _problem(seed: int, delta: float = np.inf, discount: float = 0.97) -> Game:
    rng = np.random.default_rng(seed)
    n = int(rng.integers(2, 6))
    A, B, E = (rng.standard_normal((n, size)) for size in (n, 2, 1))
    step = Game(1.3 * A / np.abs(np.linalg.eigvals(A)).max(), B, E, np.eye(n), np.eye(2), delta)
    return in_steps(replace(step, N=0.1 * rng.standard_normal((n, 2))), discount)


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
        problem = _problem(seed, margin * minimum_delta(problem).value)
    exact = solve(problem)
    run = learn(problem, seed=seed)
    H = run.H
    assert np.abs(run.P - exact.P).max() <= 1e-9 * np.abs(exact.P).max()
    assert np.abs(H - exact.H).max() <= 1e-9 * np.abs(exact.H).max()
    assert run.settled


def test_games_without_a_solution_are_refused():
    """A delta below the smallest, and a plant that no input reaches, have no solution."""
    smallest = minimum_delta(_problem(2)).value
    with pytest.raises(NoSolutionError, match="delta"):
        learn(_problem(2, 0.9 * smallest))
    unreached = in_steps(Game([[1.2]], [[0.0]], [[1.0]], [[1.0]], [[1.0]], np.inf))
    with pytest.raises(NoSolutionError, match="Q-learning diverges"):
        learn(unreached)


@pytest.mark.parametrize("price", [1.0, 1e4])
def test_random_steps_move_and_cost_no_more_than_the_states(price):
    """One input or disturbance moves no state by more than its spread, and costs no more.

    If inputs are cheap, the spread of the states limits them, otherwise their cost.
    """
    problem = _problem(1, 5.0)
    units = np.arange(1.0, 1.0 + len(problem.A))  # the spread of the states differs
    step = replace(problem, Q=np.diag(units), R=price * np.eye(2), delta=5.0 * price)
    problem = step
    begins, ends = random_steps(problem, 3)
    n, m = step.B.shape
    states, inputs, disturbances = np.split(begins, [n, n + m], axis=1)
    spread = natural_spread(step)
    budget = float(np.diag(step.Q) @ spread**2)
    for moved, matrix, prices in (
        (inputs, step.B, np.diag(step.R)),
        (disturbances, step.E, np.full(step.E.shape[1], step.delta**2)),
    ):
        most = np.abs(moved).max(axis=0)
        reached = np.maximum(
            (np.abs(matrix) * most / spread[:, None]).max(axis=0),
            np.sqrt(prices * most**2 / budget),
        )
        assert (reached <= 1.0).all()
        assert (reached >= 0.8).all()
    assert (np.abs(states).max(axis=0) <= spread).all()
    assert (np.abs(states).max(axis=0) >= 0.8 * spread).all()
    expected = states @ step.A.T + inputs @ step.B.T + disturbances @ step.E.T
    np.testing.assert_allclose(ends, expected, rtol=1e-9, atol=1e-12 * np.abs(ends).max())


def test_only_the_exact_q_function_is_settled():
    """H is settled if it is a fixed point, has a saddle, and stabilizes with and without L."""
    free = _problem(0)
    problem = _problem(0, 1.1 * minimum_delta(free).value)
    exact = solve(problem)
    learner = QLearner(problem, random_steps(problem, 1))
    H = exact.H
    assert learner.is_settled(H, H)
    np.testing.assert_allclose(learner.policy_iteration(H), H, atol=1e-8 * np.abs(H).max())
    np.testing.assert_allclose(learner.value_iteration(exact.P), H, atol=1e-8 * np.abs(H).max())
    assert not learner.is_settled((1.0 + 1e-5) * H, H)
    n, m = problem.B.shape
    for block, factor in ((slice(n, n + m), -1.0), (slice(n + m, None), -1.0)):
        other = H.copy()
        other[block, block] *= factor
        assert not learner.has_saddle(other)
        assert not learner.is_settled(other, other)
    still = H.copy()
    still[:n, n:] = still[n:, :n] = 0.0  # K = 0 and L = 0 leave an unstable plant
    assert not learner.is_settled(still, still)
    pushed = H.copy()  # K is exact, and the disturbance d = L x alone destabilizes
    L = 30.0 * np.ones((1, n))
    pushed[n : n + m, n + m :] = pushed[n + m :, n : n + m] = 0.0
    pushed[n : n + m, :n] = H[n : n + m, n : n + m] @ exact.K
    pushed[n + m :, :n] = -H[n + m :, n + m :] @ L
    pushed[:n, n:] = pushed[n:, :n].T
    policies = of_q_function(problem, pushed)
    step = problem
    root = np.sqrt(problem.discount)
    loop = step.A - step.B @ policies["K"]
    radii = [
        np.abs(np.linalg.eigvals(root * each)).max()
        for each in (loop, loop + step.E @ policies["L"])
    ]
    assert radii[0] < 1.0 < radii[1]
    assert not learner.is_settled(pushed, pushed)
    x, after = learner.steps
    wrong = 1.1 * H
    values = np.einsum("ji,ik,jk->j", x, wrong, x)
    costs = np.einsum("ji,ik,jk->j", x, q_function(problem, np.zeros((n, n))), x)
    P = of_q_function(problem, wrong)["P"]
    next_values = problem.discount * np.einsum("ji,ik,jk->j", after, P, after)
    error = np.linalg.norm(values - costs - next_values)
    terms = np.linalg.norm(np.abs(values) + np.abs(costs) + np.abs(next_values))
    assert learner.residuals(wrong) == pytest.approx((error / np.linalg.norm(costs), error / terms))
    assert learner.residuals(H)[1] < 1e-9
