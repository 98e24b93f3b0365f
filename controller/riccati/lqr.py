"""The linear-quadratic regulator, as the exact solution of a game without disturbance."""

from __future__ import annotations

from controller.game.zero_sum import Game
from controller.riccati.gare import Solution, solve
from hfa_support.arguments import ArrayLike


def lqr(
    A: ArrayLike, B: ArrayLike, Q: ArrayLike, R: ArrayLike, N: ArrayLike | None = None
) -> Solution:
    """Return the linear-quadratic regulator u = -K z of z' = A z + B u.

    The regulator minimizes ∫ z'Qz + 2z'Nu + u'Ru. It is the solution of the game without
    disturbance. For a linear model, write hfa.solve(hfa.game(linear, Q, R)).

    A: (n, n)
    B: (n, m)
    Q: (n, n), symmetric positive semidefinite; or its diagonal, (n,)
    R: (m, m), symmetric positive definite; or its diagonal, (m,)
    N: (n, m), cross weights; by default 0

    Raises BadInputError if a matrix does not fit, and NoSolutionError if there is no certified
    solution.

    >>> import hfa
    >>> hfa.lqr([[0.0, 1.0], [0.0, 0.0]], [[0.0], [1.0]], [1.0, 0.0], [1.0]).K.round(4).tolist()
    [[1.0, 1.4142]]
    """
    return solve(Game(A=A, B=B, Q=Q, R=R, N=N))
