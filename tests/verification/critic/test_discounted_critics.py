"""Verdicts on critics of discounted discrete-time games."""

import math

import numpy as np
import pytest
from game_files import stored
from game_samples import failed_names
from known_models import game_at
from scipy.linalg import block_diag, solve_discrete_lyapunov
from tolerances import SAME_FORMULA

from controller import critic_in
from hfa import Game, from_gain, from_value, solve, verify

pytestmark = pytest.mark.usefixtures("folder")

DISCOUNT = 0.99
DT = 0.01


def test_the_exact_discounted_critic_passes(elevator_game):
    """The exact P, the exact K and the exact H over (x, u) pass."""
    problem = elevator_game.sampled(DT, DISCOUNT)
    exact = solve(problem)
    assert verify(problem, from_value(problem, exact.P)).ok
    assert verify(problem, from_gain(problem, exact.K)).ok
    G = np.hstack([problem.A, problem.B, problem.E])
    no_cost = -(problem.delta**2) * np.eye(problem.E.shape[1])
    H = block_diag(problem.Q, problem.R, no_cost) + DISCOUNT * G.T @ exact.P @ G
    size = len(problem.A) + problem.B.shape[1]
    by_worst = H[:size, size:] @ np.linalg.solve(H[size:, size:], H[size:, :size])
    assert verify(problem, critic_in(stored("H.npz", H=H[:size, :size] - by_worst), problem)).ok


@pytest.mark.parametrize("factor", [1.0, 1.5])
def test_a_loop_that_does_not_stabilize_may_have_a_finite_discounted_cost(factor):
    """The cost is that of the Lyapunov equation of √α (A - B K); the loop fails all the same."""
    A, B, Q = np.array([[1.2, 0.1], [0.0, 0.5]]), np.array([[0.0], [1.0]]), np.diag([0.01, 1.0])
    game = Game(A, B, Q=Q, R=np.eye(1), dt=0.1, discount=0.6)
    exact = solve(game)
    K = factor * exact.K
    J = solve_discrete_lyapunov(math.sqrt(0.6) * (A - B @ K).T, Q + K.T @ K)
    above = np.linalg.eigvals(np.linalg.solve(exact.P, J - exact.P)).real.max()
    verdict = verify(game, from_gain(game, K))
    assert verdict.cost_above_optimum_percent == pytest.approx(100.0 * above, rel=1e-6, abs=1e-9)
    assert [verdict.stabilizing, verdict.ok, verdict.holds(limit_cost=10.0)] == 3 * [False]


def test_an_exact_critic_that_does_not_stabilize_fails():
    """An exact discounted critic that does not stabilize is reported as exact, and fails.

    With discount 0.95 and a step of 5 ms at 20 deg, the spectral radius of A - B K is 1.00003.
    """
    problem = game_at(20.0).sampled(0.005, 0.95)
    exact = solve(problem)
    verdict = verify(problem, from_value(problem, exact.P))
    assert "not stabilizing\nexact within 1e-06" in str(verdict)
    assert failed_names(verdict.checks) == {"control_loop_radius"}
    radius = np.abs(np.linalg.eigvals(problem.A - problem.B @ exact.K)).max()
    assert verdict.value_of("control_loop_radius") == pytest.approx(radius, rel=1e-9)
    assert 1.0 < radius < 1.0001
    assert verdict.value_of("discounted_loop_radius") == pytest.approx(
        math.sqrt(0.95) * verdict.value_of("control_loop_radius"), rel=SAME_FORMULA
    )
    (reason,) = [check.reason for check in verdict.checks if not check.ok]
    assert "the exact solution of this discounted problem does not stabilize either" in reason
