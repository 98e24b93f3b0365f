"""Learning in flight: the gain at each tick is the last certified gain, or a baseline gain."""

from __future__ import annotations

import numpy as np

from controller import basis
from controller.critic.training_run import TrainingRun
from controller.game.zero_sum import is_semidefinite
from controller.learning.integral_rl import baseline_gain
from controller.riccati.balancing import is_hurwitz
from hfa import Game


def certified_gains(game: Game, learned: TrainingRun, tick: float) -> tuple[np.ndarray, float]:
    """Return the last certified gain at each tick, (N, m, n), and the time of the first one in s.

    The gain K of a learned P is certified if A - S P and A - B K are Hurwitz and P >= 0. Before
    the first certified gain, the baseline gain is used. The time is inf if no gain is certified.
    The gain at time t depends only on data learned up to t.
    """
    functions = basis(learned.basis, len(game.A))
    current = baseline_gain(game)
    first = np.inf
    gains = []
    row = 0
    for index in range(int(np.ceil(learned.time[-1] / tick - 1e-9)) + 1):
        while row < len(learned.time) and learned.time[row] <= index * tick + 1e-9:
            P = functions.matrix(learned.weights[row])
            if _is_value(game, P):
                current = game.gain(P)
                first = min(first, index * tick)
            row += 1
        gains.append(current)
    return np.array(gains), first


def _is_value(game: Game, P: np.ndarray) -> bool:
    loops = (game.A - game.S @ P, game.A - game.B @ game.gain(P))
    return is_semidefinite(P) and all(is_hurwitz(loop) for loop in loops)
