"""The linear-quadratic regulator, as the exact solution of a game without disturbance."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from controller.game.linear_game import game
from controller.game.zero_sum import Game
from controller.riccati.gare import Solution, solve
from hfa_support.arguments import ArrayLike
from hfa_support.errors import BadInputError
from trim.linear.linear_model import LinearModel, is_state_space

if TYPE_CHECKING:
    import control


def lqr(
    A: ArrayLike | LinearModel | control.StateSpace,
    B: ArrayLike | None = None,
    Q: ArrayLike | None = None,
    R: ArrayLike | None = None,
    N: ArrayLike | None = None,
) -> Solution:
    """Return the linear-quadratic regulator u = -K z of z' = A z + B u.

    The regulator minimizes ∫ z'Qz + 2z'Nu + u'Ru. It is the solution of the game without
    disturbance. As in python-control, write lqr(A, B, Q, R) or lqr(linear, Q, R).

    A: (n, n); or a linear model, in place of A and B
    B: (n, m)
    Q: (n, n), symmetric positive semidefinite; or its diagonal, (n,)
    R: (m, m), symmetric positive definite; or its diagonal, (m,)
    N: (n, m), cross weights; by default 0

    Raises BadInputError if a matrix is missing or does not fit, and NoSolutionError if there is no
    certified solution.

    >>> import hfa
    >>> hfa.lqr([[0.0, 1.0], [0.0, 0.0]], [[0.0], [1.0]], [1.0, 0.0], [1.0]).K.round(4).tolist()
    [[1.0, 1.4142]]
    """
    if isinstance(A, LinearModel) or is_state_space(A):
        of_linear = [weight for weight in (B, Q, R) if weight is not None]
        if len(of_linear) not in (2, 3):
            raise BadInputError("lqr: Q or R is missing; write lqr(linear, Q, R)")
        Q, R, *crossed = of_linear
        return solve(game(A, Q=Q, R=R, delta=math.inf, N=crossed[0] if crossed else N))
    if B is None or Q is None or R is None:
        raise BadInputError("lqr: a matrix is missing; write lqr(A, B, Q, R) or lqr(linear, Q, R)")
    return solve(Game(A=A, B=B, Q=Q, R=R, N=N))
