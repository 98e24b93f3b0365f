"""Does P mean what the value of the game means? One call for every test that simulates or analyses its policies."""

from __future__ import annotations

import numpy as np

from controller.game.zero_sum import Game
from hfa_model.reporting.checks import Check
from verification.meaning.saddle import cost_checks, saddle_checks
from verification.riccati.l2_gain import gain_checks


def meaning_checks(game: Game, P: np.ndarray, initial: np.ndarray) -> tuple[Check, ...]:
    """Cost of the policies equals z0'P z0, neither player gains by deviating, and the L2 gain is below delta.

    P: (n, n), exact or learned; initial z0: (n,).  With delta = inf (no disturbance) the gain is not limited. A game
    of value 0 has no costs to compare, and no saddle checks.
    """
    return (
        *cost_checks(game, P, initial),
        *(saddle_checks(game, P, initial) if game.Q.any() or P.any() else ()),
        *gain_checks(game, game.gain(P)),
    )
