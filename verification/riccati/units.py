"""Units of state in which the numbers of a game are of similar size."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from controller.game.zero_sum import Game
from verification.riccati.balance import balanced


def balanced_units(game: Game) -> np.ndarray:
    """Units u, (n,), powers of two: with z_i = u_i y_i the Hamiltonian of the game in y is balanced.

    P in the new units is P_ij u_i u_j. Powers of two make the change of units free of rounding. The units are
    taken from the game rather than from P, so that an entry of P that is zero up to rounding stays small.
    Source: Benner, Symplectic balancing of Hamiltonian matrices, SIAM J. Sci. Comput. 22 (2001).
    """
    n = len(game.A)
    H = np.block([[game.A, -game.S], [-game.Q, -game.A.T]])
    _, scaling = balanced(H)
    return np.exp2(np.round(0.5 * (np.log2(scaling[:n]) - np.log2(scaling[n:]))))


def in_units(game: Game, units: np.ndarray) -> Game:
    """The same game in the state y, z_i = u_i y_i; units: (n,)."""
    return replace(
        game,
        A=game.A * units / units[:, None],
        B=game.B / units[:, None],
        E=game.E / units[:, None],
        Q=game.Q * np.outer(units, units),
    )
