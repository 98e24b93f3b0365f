"""Loops with a disturbance, as games whose input does nothing.

With the largest cost z'D z of a stable loop z' = F z + E d, beyond δ² d'd, D is the stabilizing
solution of

  F'D + D F + C + D E E'D / δ² = 0,

in discrete time of F'D F - D + C + F'D E (δ² - E'D E)⁻¹ E'D F = 0. It exists if the gain from d to
the cost z'C z is below δ.

Source: Zhou, Doyle and Glover, Robust and Optimal Control, Theorems 4.5, 13.7 and 21.12.
"""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from controller.game.zero_sum import Game
from controller.riccati.balls import Balls, DoubleBalls, bits, midpoints, norm, scaled_balls
from controller.riccati.candidate import (
    Candidate,
    candidate_in_bits,
    candidate_in_doubles,
    corrected_in_bits,
)
from controller.riccati.enclosure import Enclosure, proved_ball
from controller.riccati.equation import Entries, users_units
from controller.riccati.lyapunov import FailedError, NotProvedError, loop_units
from hfa_support.errors import BadInputError

if TYPE_CHECKING:
    from flint import arb_mat


@dataclass(frozen=True, eq=False, repr=False)
class LoopGame(Game):
    """Game whose matrices are balls, and here rounded to doubles.

    balls: of all matrices
    """

    balls: Entries | None = None


class LoopValue(NamedTuple):
    """Enclosed D, (n, n), and the gain of the worst disturbance d = L z, (k, n), balls."""

    D: arb_mat
    L: arb_mat


class DisturbedLoop(NamedTuple):
    """Stable loop z' = F z + E d with the cost z'C z, in discrete time z⁺ = F z + E d, in balls.

    F, E, C: (n, n), (n, k), (n, n), symmetric
    """

    F: arb_mat
    E: arb_mat
    C: arb_mat
    is_discrete: bool

    def value(self, delta: float) -> LoopValue:
        """Return the enclosure of D, which proves that F is stable and that the gain is below δ.

        It is sought in units in which F is balanced, and the cost is divided by its size.

        Raises FailedError or NotProvedError.
        """
        k = self.E.ncols()
        units = loop_units(midpoints(self.F))
        size = float(norm(scaled_balls(self.C, units, units)))
        power = int(np.round(0.5 * np.log2(size))) if size > 0.0 else 0
        states, inputs = units - power, np.full(k, power)
        scaled = self._replace(
            F=scaled_balls(self.F, -units, units),
            E=scaled_balls(self.E, -units, inputs),
            C=scaled_balls(self.C, states, states),
        )
        found = scaled._enclosed(delta)
        D = scaled_balls(found.P, -states, -states)
        return LoopValue(D, scaled_balls(found.L, inputs, -units))

    def _enclosed(self, delta: float) -> Enclosure:
        """Return the enclosure of D as the value of a game."""
        F, E, C = map(midpoints, (self.F, self.E, self.C))
        zero = np.zeros((len(F), 1))
        balls = Entries(self.F, zero, self.E, self.C, np.eye(1), zero)
        dt = True if self.is_discrete else None
        try:
            game = LoopGame(
                F, zero, E=E, Q=(C + C.T) / 2.0, R=np.eye(1), delta=delta, dt=dt, balls=balls
            )
        except BadInputError as error:
            raise FailedError(str(error)) from None
        if not E.any() and not all(entry == 0 for entry in self.E.entries()):
            raise FailedError("the disturbance may be 0")
        units = users_units(game)
        candidates = (
            lambda: candidate_in_doubles(game, delta, units, turns=0),
            lambda: candidate_in_doubles(game, delta, units),
            lambda: candidate_in_bits(game, delta),
        )
        for candidate_of in candidates:
            with suppress(FailedError, NotProvedError):
                return _enclosure_of(candidate_of())
        raise NotProvedError("the value of the loop")


def _enclosure_of(candidate: Candidate) -> Enclosure:
    """Return what a candidate proves, by bounds in doubles or in balls.

    Raises FailedError or NotProvedError.
    """
    with suppress(NotProvedError):
        return Enclosure(proved_ball(candidate, DoubleBalls), bits())
    return Enclosure(proved_ball(corrected_in_bits(candidate), Balls), bits())
