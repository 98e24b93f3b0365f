"""Whether linear loops are stable, proved in balls."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from controller.game.zero_sum import Game
from controller.riccati.balls import (
    Balls,
    ball_matrix,
    identity,
    is_positive_definite,
    midpoints,
    norm,
    precision,
    symmetric,
)
from controller.riccati.enclosure import ATTEMPTS
from controller.riccati.equation import change_along, scaled_balls
from controller.riccati.proposal import FailedError, loop_units, lyapunov_in_bits

if TYPE_CHECKING:
    from flint import arb_mat


def stability_of(loop: arb_mat, *, is_discrete: bool) -> bool | None:
    """Return whether a loop F is stable, or None if the bits of `precision` do not prove it.

    Let |F'Y + Y F + 1| < 1, in discrete time |F'Y F - Y + 1| < 1. F is stable if Y > 0, and
    unstable if v'Y v < 0 for a vector v, because Y would be positive definite if F were stable.

    loop: F, (n, n), balls
    """
    units = loop_units(midpoints(loop))
    F, one = scaled_balls(loop, -units, units), identity(loop.nrows())
    try:
        Y = symmetric(lyapunov_in_bits(F, one, is_discrete=is_discrete))
    except FailedError:
        return None
    defect = change_along(Balls(F), Balls(Y), is_discrete=is_discrete).matrix + one
    if not norm(defect) < 1:
        return None
    if is_positive_definite(Y):
        return True
    vector = ball_matrix(np.linalg.eigh(midpoints(Y))[1][:, :1])
    return False if (vector.transpose() * Y * vector)[0, 0] < 0 else None


def loop_with(game: Game, K: arb_mat) -> arb_mat:
    """Return A - B K in balls, (n, n)."""
    return ball_matrix(game.A) - ball_matrix(game.B) * K


def discounted_loop(game: Game, K: arb_mat) -> arb_mat:
    """Return √α (A - B K) in balls, (n, n), on which the cost depends."""
    from flint import arb

    return loop_with(game, K) * arb(game.discount).sqrt()


def stabilizes(game: Game, K: np.ndarray, *, is_discounted: bool = False) -> bool:
    """Return whether A - B K is proved stable, or √α (A - B K); False without a proof.

    K: (m, n)
    is_discounted: whether √α (A - B K) is asked about
    """
    loop_of = discounted_loop if is_discounted else loop_with
    for bits in ATTEMPTS:
        with precision(bits):
            is_stable = stability_of(loop_of(game, ball_matrix(K)), is_discrete=game.is_discrete)
        if is_stable is not None:
            return is_stable
    return False
