"""Closed loops in states in which the value of the game is nearly y'y.

There, the entries of a loop have the size of its rates: its poles, gains and margins keep the
digits of doubles, in whatever states and units the user gave the game.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from controller.riccati.balls import Balls, ball_matrix, identity, midpoints, precision
from controller.riccati.bilinear import System
from controller.riccati.equation import scaled_balls
from controller.riccati.frequency_response import loop_gain, scaled_root
from controller.riccati.margins import ClosedLoop, loop_of

if TYPE_CHECKING:
    from flint import arb_mat

    from controller.riccati.enclosure import Enclosure

#: Least eigenvalue of P in the new states, relative to the largest, after which no further change
#: of the states is made,
MODERATE = 1e-3
#: of which there are at most so many; each gains the digits of doubles.
TURNS = 4


@dataclass(frozen=True, eq=False)
class Level:
    """Loops of a solution in the states y = T z, with the user's inputs and disturbances.

    enclosure: of the solution
    to_level: T, (n, n), in the exact units of the enclosure
    from_level: T⁻¹, balls
    """

    enclosure: Enclosure
    to_level: arb_mat
    from_level: arb_mat

    @property
    def into(self) -> np.ndarray:
        """T in the exact units of the enclosure, rounded, (n, n)."""
        return midpoints(self.to_level)

    @property
    def back(self) -> np.ndarray:
        """T⁻¹ in the exact units of the enclosure, rounded, (n, n)."""
        return midpoints(self.from_level)

    @cached_property
    def game_loop(self) -> np.ndarray:
        """Loop of both players, (n, n), with its discount."""
        found = self.enclosure.proved
        with precision(self.enclosure.bits):
            P = Balls.around(found.X, found.spread)
            loop = found.equation.loop(P, Balls(found.gains)).matrix
            return midpoints(self.to_level * loop * self.from_level)

    @cached_property
    def loop(self) -> np.ndarray:
        """A - B K, (n, n), without discount."""
        return self.with_gain(self.enclosure.K)

    @cached_property
    def worst_loop(self) -> np.ndarray:
        """A - B K + E L, (n, n), without discount."""
        return self.game_loop / math.sqrt(self.enclosure.game.discount)

    def with_gain(self, K: arb_mat) -> np.ndarray:
        """Return A - B K of any gain, (n, n), without discount."""
        game, states = self.enclosure.game, self.enclosure.proved.equation.units.states
        with precision(self.enclosure.bits):
            loop = ball_matrix(game.A) - ball_matrix(game.B) * K
            return midpoints(self.to_level * scaled_balls(loop, -states, states) * self.from_level)

    @cached_property
    def inputs(self) -> np.ndarray:
        """B, (n, m)."""
        return self.columns(self.enclosure.game.B)

    @cached_property
    def disturbances(self) -> np.ndarray:
        """E, (n, k)."""
        return self.columns(self.enclosure.game.E)

    def columns(self, matrix: np.ndarray) -> np.ndarray:
        """Return columns in the user's states, such as B, in the new states."""
        states = self.enclosure.proved.equation.units.states
        none = np.zeros(matrix.shape[1], dtype=int)
        with precision(self.enclosure.bits):
            return midpoints(self.to_level * scaled_balls(ball_matrix(matrix), -states, none))

    def rows(self, matrix: arb_mat) -> np.ndarray:
        """Return rows of the user's states, such as K, in the new states."""
        states = self.enclosure.proved.equation.units.states
        none = np.zeros(matrix.nrows(), dtype=int)
        with precision(self.enclosure.bits):
            return midpoints(scaled_balls(matrix, none, states) * self.from_level)

    def l2_gain(self, K: arb_mat) -> float:
        """Return the L2 gain from d to the cost with u = -K z, as `bounded_real_gain` does.

        Raises NoSolutionError as `loop_gain` does.
        """
        game = self.enclosure.game
        root = math.sqrt(game.discount)
        both = np.vstack([self.rows(identity(len(game.A))), -self.rows(K)])
        outputs, E = scaled_root(game.weights).T @ both, root * self.disturbances
        through = np.zeros((len(outputs), E.shape[1]))
        system = System(root * self.with_gain(K), E, outputs, through)
        return loop_gain(system, is_discrete=game.is_discrete).high

    def at_inputs(self, K: arb_mat) -> ClosedLoop:
        """Return M = S - I/2 at all inputs of the closed loop with u = -K z.

        Raises NoSolutionError if a pole is not stable.
        """
        return loop_of(self.with_gain(K), self.inputs, -self.rows(K), self.enclosure.game)


def levelled(enclosure: Enclosure) -> Level:
    """Return the loops of a solution in states in which its value is nearly y'y."""
    found = enclosure.proved
    with precision(enclosure.bits), np.errstate(all="ignore"):
        to_level = from_level = identity(found.equation.n)
        for _ in range(TURNS):
            X = midpoints(from_level.transpose() * found.X * from_level)
            values, vectors = np.linalg.eigh((X + X.T) / 2.0)
            largest = float(values[-1])
            if not largest > 0.0 or values[0] > MODERATE * largest:
                break
            roots = np.sqrt(np.maximum(values, np.finfo(float).eps * largest))
            turn = ball_matrix(roots[:, None] * vectors.T)
            try:
                back = turn.inv()
            except ZeroDivisionError:
                break
            to_level, from_level = (turn * to_level).mid(), from_level * back
        from_level = to_level.inv()
    return Level(enclosure, to_level, from_level)
