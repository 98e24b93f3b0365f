"""The game with the default weights of the commands, 1/nominal² of each state and input."""

import numpy as np

import hfa


def nominal_game(linear):
    """Return the game on a linear model with the weights diag(1/nominal²)."""
    signals = {**linear.model.states, **linear.model.inputs}
    Q, R = (
        np.array([signals[name].nominal for name in names]) ** -2.0
        for names in (linear.states, linear.inputs)
    )
    return hfa.game(linear, Q=Q, R=R)
