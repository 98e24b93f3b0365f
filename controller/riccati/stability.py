"""Whether policies stabilize a plant, proved in balls."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from controller.game.zero_sum import Game
from controller.riccati.balls import ATTEMPTS, ball_matrix, precision
from controller.riccati.lyapunov import discounted, stability_of

if TYPE_CHECKING:
    from flint import arb_mat


def loop_with(game: Game, K: arb_mat) -> arb_mat:
    """Return A - B K in balls, (n, n)."""
    return ball_matrix(game.A) - ball_matrix(game.B) * K


def discounted_loop(game: Game, K: arb_mat) -> arb_mat:
    """Return √α (A - B K) in balls, (n, n), on which the cost depends."""
    return discounted(loop_with(game, K), game)


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
