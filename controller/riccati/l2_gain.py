"""L2 gain of a stable loop z' = F z + E d to a cost z'C z, proved from both sides.

The gain is below γ if the loop has a value at δ = γ (`DisturbedLoop.value`), and at least the gain
of any one disturbance at any one frequency.
"""

from __future__ import annotations

import math
from contextlib import suppress
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from controller.game.zero_sum import Game
from controller.riccati.balls import ball_matrix, identity, midpoints, norm, scaled_balls
from controller.riccati.candidate import MOST_CHANGES, candidate_in_bits, candidate_in_doubles
from controller.riccati.enclosure import Enclosure, enclosure_of
from controller.riccati.equation import Entries, users_units
from controller.riccati.lyapunov import FailedError, NotProvedError, loop_units
from controller.riccati.refusal import stabilizing
from hfa_support.errors import BadInputError
from trim.linear.frequency_response import (
    System,
    peak_frequency,
    peak_frequency_of_steps,
    scaled_root,
)

if TYPE_CHECKING:
    from flint import arb_mat


@dataclass(frozen=True, eq=False, repr=False)
class LoopGame(Game):
    """Game whose exact matrices are in balls. Its fields A, B, ... are rounded to doubles.

    balls: the exact matrices, from which `Entries.of` makes the Riccati equation
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

        D is sought in units in which F is balanced, and the cost is divided by its size.

        Raises FailedError or NotProvedError.
        """
        units = loop_units(midpoints(self.F))
        size = float(norm(scaled_balls(self.C, units, units)))
        # With the cost divided by 4^power and d in units of 2^power, δ remains.
        power = int(np.round(0.5 * np.log2(size))) if size > 0.0 else 0
        states, disturbances = units - power, np.full(self.E.ncols(), power)
        scaled = self._replace(
            F=scaled_balls(self.F, -units, units),
            E=scaled_balls(self.E, -units, disturbances),
            C=scaled_balls(self.C, states, states),
        )
        found = scaled._enclosed(delta)
        D = scaled_balls(found.P, -states, -states)
        return LoopValue(D, scaled_balls(found.L, disturbances, -units))

    def _enclosed(self, delta: float) -> Enclosure:
        """Return the enclosure of D as the value of a game whose input moves nothing (B = 0).

        Raises FailedError or NotProvedError.
        """
        F, E, C = map(midpoints, (self.F, self.E, self.C))
        zero = np.zeros((len(F), 1))
        none = ball_matrix(zero)
        balls = Entries(self.F, none, self.E, self.C, identity(1), none)
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
        for changes in (0, MOST_CHANGES):  # states in which D is nearly 1 are seldom needed
            with suppress(FailedError, NotProvedError):
                return enclosure_of(stabilizing(candidate_in_doubles(game, delta, units, changes)))
        return enclosure_of(stabilizing(candidate_in_bits(game, delta)))


#: Largest relative difference of the bounds of a gain, if nothing prevents it.
TOLERANCE = 1e-6
#: Relative distances from the lower bound at which the upper one is tried.
ABOVE = 0.9 * TOLERANCE * np.array([1.0, 1e2, 1e4])


class GainBounds(NamedTuple):
    """Proved bounds of an L2 gain: low <= gain <= high, usually 1e-6 apart."""

    low: float
    high: float

    @property
    def is_narrow(self) -> bool:
        """True if the bounds differ by at most 1e-6."""
        return self.high <= self.low * (1.0 + TOLERANCE)


def gain_of(loop: DisturbedLoop) -> GainBounds:
    """Return the bounds of the gain, with the bits of `precision`; high is inf without proof."""
    low = _lower_bound(loop)
    for above in ABOVE:
        high = low * (1.0 + float(above))
        if high > 0.0 and is_below(loop, high):
            return GainBounds(low, high)
    return GainBounds(low, math.inf)


def _lower_bound(loop: DisturbedLoop) -> float:
    """Return the gain of one disturbance at one frequency, rounded down; 0 without proof.

    Doubles propose the frequency of the largest gain, and the disturbance.
    """
    from flint import acb, acb_mat

    F, E, C = map(midpoints, (loop.F, loop.E, loop.C))
    # The largest gain is that to the output z'C z = |root' z|².
    system = System(F, E, scaled_root(C).T, np.zeros((len(C), E.shape[1])))
    try:
        frequency = (peak_frequency_of_steps if loop.is_discrete else peak_frequency)(system)
        s = acb(0, frequency).exp() if loop.is_discrete else acb(0, frequency)
        response = np.linalg.solve(complex(s) * np.eye(len(F)) - F, E)
    except np.linalg.LinAlgError:
        return 0.0
    _, disturbances = np.linalg.eigh(response.conj().T @ C @ response)
    worst = disturbances[:, -1]  # with the largest cost
    d = acb_mat([[complex(entry)] for entry in worst])
    try:
        z = (acb_mat(identity(len(F))) * s - acb_mat(loop.F)).solve(acb_mat(loop.E) * d)
    except ZeroDivisionError:
        return 0.0
    z_adjoint, d_adjoint = z.conjugate().transpose(), d.conjugate().transpose()
    square = (z_adjoint * acb_mat(loop.C) * z)[0, 0].real / (d_adjoint * d)[0, 0].real
    return math.nextafter(float(square.sqrt().lower()), 0.0) if square > 0 else 0.0


def is_below(loop: DisturbedLoop, bound: float) -> bool:
    """Return whether the gain is proved to be below a bound."""
    try:
        loop.value(bound)  # a value at δ = bound is the proof
    except (FailedError, NotProvedError):
        return False
    return True
