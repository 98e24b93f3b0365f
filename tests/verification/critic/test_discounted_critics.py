"""Verdicts on critics of discounted discrete-time games."""

import math

import numpy as np
import pytest
from game_files import stored
from scipy.linalg import solve_discrete_lyapunov

from controller import critic_in
from hfa import Game, from_gain, solve, verify

pytestmark = pytest.mark.usefixtures("folder")


def test_the_exact_action_value_over_x_and_u_passes(elevator_game):
    """The Q-function over (x, u) for the worst w passes: the Schur complement of the exact H over
    (x, u, w).
    """
    problem = elevator_game.sampled(0.01, 0.99)
    H = solve(problem).H
    size = len(problem.A) + problem.B.shape[1]
    by_worst = H[:size, size:] @ np.linalg.solve(H[size:, size:], H[size:, :size])
    assert verify(problem, critic_in(stored("H.npz", H=H[:size, :size] - by_worst), problem)).ok


@pytest.mark.parametrize("factor", [1.0, 1.5])
def test_a_loop_that_does_not_stabilize_may_have_a_finite_discounted_cost(factor):
    """The cost above the optimum is that of the Lyapunov equation of √α (A - B K), which is stable.

    A - B K is not, with the exact gain (factor 1) or another: the critic fails, and for the exact
    gain the reason says that it is the problem's.
    """
    A, B, Q = np.array([[1.2, 0.1], [0.0, 0.5]]), np.array([[0.0], [1.0]]), np.diag([0.01, 1.0])
    game = Game(A, B, Q=Q, R=np.eye(1), dt=0.1, discount=0.6)
    exact = solve(game)
    K = factor * exact.K
    J = solve_discrete_lyapunov(math.sqrt(0.6) * (A - B @ K).T, Q + K.T @ K)
    verdict = verify(game, from_gain(game, K))
    box = np.outer(verdict.box.half_widths, verdict.box.half_widths)
    above, optimum = (np.linalg.eigvalsh(P * box).max() for P in (J - exact.P, exact.P))
    above = above / optimum
    assert verdict.cost_above_optimum_percent == pytest.approx(100.0 * above, rel=1e-6, abs=1e-9)
    assert not verdict.stabilizing
    assert not verdict.ok
    assert not verdict.holds(limit_cost=10.0)
    assert (
        verdict.value_of("discounted_loop_radius") < 1.0 < verdict.value_of("control_loop_radius")
    )
    assert ("not stabilizing\nexact within 1e-06" in str(verdict)) == (factor == 1.0)
    (reason,) = [check.reason for check in verdict.checks if check.name == "control_loop_radius"]
    of_exact = "the exact solution of this discounted problem does not stabilize either"
    assert (of_exact in reason) == (factor == 1.0)
