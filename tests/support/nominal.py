"""The game with the default weights of the commands, 1/nominal² of each state and input."""

from __future__ import annotations

import hfa
from controller.game.weights import nominal_weights


def nominal_game(linear: hfa.LinearModel) -> hfa.Game:
    """Return the game on a linear model with the weights diag(1/nominal²)."""
    Q = nominal_weights(linear.model, linear.states)
    R = nominal_weights(linear.model, linear.inputs)
    return hfa.game(linear, Q, R)
