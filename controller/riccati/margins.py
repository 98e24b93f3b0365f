"""Stability margins of a gain of a linear model or of a game."""

from __future__ import annotations

import numpy as np

from controller.game.zero_sum import Game
from controller.riccati.balls import BITS, ball_matrix, midpoints, precision
from controller.riccati.poles import poles_of
from controller.riccati.stability import loop_with, stabilizes
from hfa_support.arguments import ArrayLike
from hfa_support.errors import NoSolutionError
from trim.linear.linear_model import LinearModel
from trim.linear.margins import LoopMargin, loop_of, single_margin


def margins(linear: LinearModel | Game, K: ArrayLike) -> dict[str, LoopMargin]:
    """Return the stability margins of u = -K x at each input, with the other loops closed.

    linear: the linear model or the game, with A and B
    K: (m, n)

    Returns input -> `LoopMargin`.

    Raises BadInputError if K is not m x n, and NoSolutionError if A - B K is not Hurwitz.

    >>> import hfa
    >>> linear = hfa.LinearModel.of([[0.0]], [[1.0]])
    >>> round(hfa.margins(linear, [[2.0]])["u1"].phase, 4)
    90.0
    """
    if isinstance(linear, Game):
        plant, inputs = linear, linear.names.inputs
    else:
        n, m = linear.B.shape
        plant, inputs = Game(linear.A, linear.B, Q=np.eye(n), R=np.eye(m)), linear.inputs
    K = plant.checked_gain(K)
    if not stabilizes(plant, K):
        raise NoSolutionError(f"{_unstable(plant, K)} and no margins; give a stabilizing gain")
    with precision(BITS):
        closed = midpoints(loop_with(plant, ball_matrix(K)))
    loop = loop_of(closed, plant.B, -K, plant.dt)
    return {name: single_margin(loop, i) for i, name in enumerate(inputs)}


def _unstable(plant: Game, K: np.ndarray) -> str:
    """Return a clause on the pole that is not stable."""
    poles = poles_of(lambda _: loop_with(plant, ball_matrix(K)), is_discrete=plant.is_discrete)
    if plant.is_discrete:
        return f"the loop has the spectral radius {poles.spectral_radius:.4g}"
    return f"the loop has a pole at {poles.abscissa:+.4g} 1/s"
