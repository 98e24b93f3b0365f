"""Learning in flight: the gain at each tick is the last certified gain, or a baseline gain."""

from __future__ import annotations

import numpy as np

from controller.critic.training_run import TrainingRun
from controller.game.basis import basis
from controller.game.zero_sum import Game, is_semidefinite
from controller.riccati.balancing import is_hurwitz


def certified_gains(
    game: Game, learned: TrainingRun, tick: float, baseline: np.ndarray
) -> tuple[np.ndarray, float]:
    """Return the last certified gain at each tick, (N, m, n), and the time of the first one in s.

    The gain K of a learned P is certified if A - S P and A - B K are Hurwitz and P >= 0. Before the
    first certified gain, the baseline gain is used. The time is inf if no gain is certified. The
    gain at time t depends only on data learned up to t.

    tick: s
    baseline: (m, n)
    """
    functions = basis(learned.basis, len(game.A))
    current = baseline
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
    loop = game.A - game.B @ game.gain(P)
    return bool(
        np.isfinite(loop).all()
        and is_semidefinite(P)
        and is_hurwitz(loop)
        and is_hurwitz(game.A - game.S @ P)
    )
