"""L2 gain of a stable loop z' = F z + E d to a cost z'C z, proved from both sides.

The loop is a game whose input moves nothing (B = 0): its L2 gain is the smallest δ with a value. It
is at least the gain of any one disturbance at any one frequency.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from controller.riccati.balls import ball_matrix, identity, midpoints, norm, scaled
from controller.riccati.candidate import (
    MOST_CHANGES,
    MOST_STATES_IN_BITS,
    candidate_in_bits,
    corrections,
    disturbance_units,
    proposed,
)
from controller.riccati.enclosure import Enclosure, enclosure_of
from controller.riccati.equation import Equation, LoopGame, Units
from controller.riccati.lyapunov import FailedError, NotProvedError, loop_units
from controller.riccati.refusal import between_eigenvalues, half_plane_eigenvalues
from controller.riccati.smallest_delta import TOLERANCE
from hfa_support.cached import cached_property
from hfa_support.errors import BadInputError

if TYPE_CHECKING:
    from flint import arb_mat


#: Largest number of steps to the largest gain, each of which doubles its digits.
MOST_STEPS = 12
#: Fraction of a scale where the search begins if no gain is found at the poles.
LEAST_CLIMBED = 1e-6
#: Factors of the lower bound at which the upper one is tried, and of a scale if the lower one is 0.
ABOVE = 1.0 + np.array([0.9 * TOLERANCE, 1e-4, 1e-2, 1.0])
NEARLY_0 = np.array([1e-24, 1e-12, 1.0])


@dataclass(frozen=True, eq=False)
class DisturbedLoop:
    """Stable loop z' = F z + E d with the cost z'C z, in discrete time z⁺ = F z + E d, in balls.

    F, E, C: (n, n), (n, k), (n, n), symmetric
    """

    F: arb_mat
    E: arb_mat
    C: arb_mat
    is_discrete: bool

    def value(self, delta: float) -> Enclosure:
        """Return the enclosure of D, as P of the game, which proves that F is stable and that the
        gain is below δ.

        Raises FailedError or NotProvedError.
        """
        game, units = self.game, self.units(delta)
        for changes in (0, MOST_CHANGES):  # states in which D is nearly 1 are seldom needed
            with suppress(FailedError, NotProvedError):
                equation, X = proposed(game, delta, units, changes)
                for candidate in corrections(equation, X):
                    with suppress(NotProvedError):
                        return enclosure_of(candidate)
        return enclosure_of(candidate_in_bits(game, delta))

    @cached_property
    def game(self) -> LoopGame:
        """The loop as a game whose input moves nothing (B = 0).

        Raises FailedError.
        """
        F, E, C = map(midpoints, (self.F, self.E, self.C))
        if not E.any() and not all(entry == 0 for entry in self.E.entries()):
            raise FailedError("the disturbance may be 0")
        zero, one = np.zeros((len(F), 1)), np.eye(1)
        none = ball_matrix(zero)
        balls = (self.F, none, self.E, self.C, identity(1), none)
        dt = True if self.is_discrete else None
        try:
            return LoopGame(F, zero, E=E, Q=(C + C.T) / 2.0, R=one, dt=dt, balls=balls)
        except BadInputError as error:
            raise FailedError(str(error)) from None

    def units(self, delta: float) -> Units:
        """Return units in which F is balanced, and the cost has the size of F."""
        states = loop_units(midpoints(self.F))
        size = float(norm(scaled(self.C, states, states)))
        power = int(np.round(0.5 * np.log2(size))) if size > 0.0 else 0
        return Units(states - power, np.zeros(1, dtype=int), disturbance_units(self.game, delta))

    @cached_property
    def scale(self) -> float:
        """A gain of the size of the entries, in units of the loop."""
        near = Equation(self.game, self.units(math.inf), math.inf).in_doubles
        return float(math.sqrt(near.Q.size) * near.E.size / near.A.size)

    def gain_at(self, frequencies: Sequence[float] | np.ndarray) -> float:
        """Return the gain of one disturbance at one of these frequencies, rounded down; 0 without
        proof.

        Doubles propose the frequency and the disturbance.

        frequencies: rad/s, in discrete time rad/step
        """
        from flint import acb, acb_mat

        F, E, C = map(midpoints, (self.F, self.E, self.C))
        rates = 1j * np.asarray(frequencies)[:, None, None]
        s = np.exp(rates) if self.is_discrete else rates
        try:
            with np.errstate(all="ignore"):
                responses = np.linalg.solve(s * np.eye(len(F)) - F, E)
                costs, vectors = np.linalg.eigh(responses.conj().swapaxes(1, 2) @ C @ responses)
            best = int(np.argmax(np.nan_to_num(costs[:, -1], nan=-math.inf)))
            d = acb_mat([[complex(entry)] for entry in vectors[best, :, -1]])
            rate = acb(0, float(frequencies[best]))
            z_rate = rate.exp() if self.is_discrete else rate
            z = (acb_mat(identity(len(F))) * z_rate - acb_mat(self.F)).solve(acb_mat(self.E) * d)
        except (np.linalg.LinAlgError, ZeroDivisionError, ValueError):
            return 0.0
        z_adjoint, d_adjoint = z.conjugate().transpose(), d.conjugate().transpose()
        square = (z_adjoint * acb_mat(self.C) * z)[0, 0].real / (d_adjoint * d)[0, 0].real
        return math.nextafter(float(square.sqrt().lower()), 0.0) if square > 0 else 0.0


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
    try:
        poles = np.linalg.eigvals(loop.game.A)
    except FailedError:
        return GainBounds(0.0, math.inf)
    at_poles = (np.angle(poles), [math.pi]) if loop.is_discrete else (np.abs(poles), poles.imag)
    low, high = loop.gain_at(np.unique(np.abs(np.concatenate([[0.0], *at_poles])))), math.inf
    for in_bits in (False, True)[: 2 if len(poles) <= MOST_STATES_IN_BITS else 1]:
        low = _climbed(loop, low, in_bits=in_bits)
        for bound in (low or loop.scale) * (ABOVE if low else NEARLY_0):
            with suppress(FailedError, NotProvedError):
                if low < bound < high and loop.value(bound):  # a value at δ = bound is the proof
                    high = float(bound)
                    break
        if GainBounds(low, high).is_narrow:
            break
    return GainBounds(low, high)


def _climbed(loop: DisturbedLoop, low: float, *, in_bits: bool) -> float:
    """Return the largest gain found at frequencies between those at which a gain is `low`, then the
    largest one, and so on.

    in_bits: whether these are computed with the bits of `precision`

    Source: Bruinsma and Steinbuch, Systems & Control Letters 14 (1990), 287-293.
    """
    level = low or LEAST_CLIMBED * loop.scale
    for _ in range(MOST_STEPS if level else 0):
        with np.errstate(all="ignore"):
            equation = Equation(loop.game, loop.units(level), level)
            values = half_plane_eigenvalues(equation, in_bits=in_bits)
        found = loop.gain_at(between_eigenvalues(values, is_discrete=loop.is_discrete))
        low, before = max(low, found), low
        if low <= before * (1.0 + 0.01 * TOLERANCE):
            break
        level = low
    return low
