"""Learning in flight: the last gain that was certified by each tick, a baseline before the
first."""

from __future__ import annotations

import numpy as np

from controller import Game, basis
from controller.game.learning_result import LearningResult
from controller.learning.certify import abscissa, positivity
from controller.learning.recording import natural_spread
from studies.update_law.integral_rl import baseline_gain


def certified_gains(game: Game, learned: LearningResult, tick: float) -> tuple[np.ndarray, float]:
    """In each tick of `tick` seconds the last gain that was certified by then, (N, m, n), and from
    when on, s.

    A value counts when A - S P and A - B K are Hurwitz and P is positive (`certify.positivity`);
    until there is one, the baseline is used. What has been learned at t is known at t: nothing of
    the later run is used."""
    functions = basis(learned.basis, len(game.A))
    current, first, scales = baseline_gain(game), np.inf, natural_spread(game)
    gains, row = [], 0
    for index in range(int(np.ceil(learned.times[-1] / tick - 1e-9)) + 1):
        while row < len(learned.times) and learned.times[row] <= index * tick + 1e-9:
            P = functions.matrix(learned.weights[row])
            if _is_value(game, P, scales):
                current, first = game.gain(P), min(first, index * tick)
            row += 1
        gains.append(current)
    return np.array(gains), first


def _is_value(game: Game, P: np.ndarray, scales: np.ndarray) -> bool:
    loops = (game.A - game.S @ P, game.A - game.B @ game.gain(P))
    return positivity(game, P, scales).ok and all(abscissa(loop) < 0.0 for loop in loops)
