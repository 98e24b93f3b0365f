"""Which gain flies while a value is being learned."""

from __future__ import annotations

import numpy as np
from reference_riccati import reference_solution, relative_error

from controller.flight.gain_plan import online_plan
from controller.game.zero_sum import Game
from controller.laws.learn import learn


def test_a_value_that_is_zero_for_a_state_without_cost_takes_over_too() -> None:
    """P is singular where Q is; rounding makes its smallest eigenvalue negative in one case of two."""
    rng = np.random.default_rng(18)
    for _ in range(6):
        T = rng.standard_normal((3, 3))
        C = np.linalg.inv(T)[1:]
        A, Q = T @ np.diag([-1.0, -2.0, 0.5]) @ np.linalg.inv(T), C.T @ C
        game = Game(A, rng.standard_normal((3, 1)), np.zeros((3, 1)), (Q + Q.T) / 2.0, [[1.0]], np.inf)
        learned = learn(game, tick=0.1)
        plan = online_plan(game, "certified", learned, 0.1)
        assert plan.certified_from <= 10.0
        K = game.gain(reference_solution(game).P)
        assert relative_error(plan.gains[-1], K) < 1e-9
