"""The linear-quadratic regulator, as the exact solution of a game without disturbance."""

from __future__ import annotations

from typing import Any

import numpy as np

from controller.game.linear_game import game as game_on
from controller.riccati.gare import Solution, solve
from hfa_support.arguments import ArrayLike, checks_arguments
from hfa_support.errors import BadInputError
from trim.linear.linear_model import LinearModel


@checks_arguments
def lqr(linear: LinearModel | ArrayLike, *more: Any, **weights: Any) -> Solution:
    """Return the linear-quadratic regulator u = -K z of a linear model, or of A and B.

    The function is called as lqr(linear, Q, R) or lqr(A, B, Q, R), with the cross weights N as a
    further argument if the cost contains 2z'Nu. The regulator is the solution of the game without
    disturbance, `hfa.game(linear, Q, R, N=N)`.

    linear: the linear model, or A
    more: B after A, then Q, R and N, as for `hfa.game`
    weights: Q, R and N as keyword arguments

    Raises BadInputError if B is missing or a weight does not fit, and NoSolutionError if there is
    no certified solution.

    >>> import hfa
    >>> model = hfa.aircraft()
    >>> hfa.lqr(hfa.linearize(model, hfa.trim(model))).K.shape
    (5, 6)
    """
    if not isinstance(linear, LinearModel):
        if not more:
            raise BadInputError("lqr: B is missing; call lqr(A, B, Q, R) or lqr(A, B, Q, R, N)")
        linear = LinearModel(np.asarray(linear), more[0])
        more = more[1:]
    return regulator(linear, *more, **weights)


@checks_arguments
def regulator(linear: LinearModel, Q: Any = None, R: Any = None, N: Any = None) -> Solution:
    """Return the linear-quadratic regulator of a linear model with A and B, as an exact solution.

    Q, R, N: as for `hfa.game`
    """
    return solve(game_on(linear, Q, R, N=N))
