"""L2 gain of a stable loop z' = F z + E d to a cost z'C z, proved from both sides.

The loop is a game whose input moves nothing (B = 0): its L2 gain is the smallest δ with a value. It
is at least the gain of any one disturbance at any one frequency.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from contextlib import suppress
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from controller.game.zero_sum import Game
from controller.riccati.balls import ball_matrix, identity, midpoints, norm, scaled_balls
from controller.riccati.candidate import (
    MOST_CHANGES,
    MOST_STATES_IN_BITS,
    candidate_in_bits,
    corrected,
    disturbance_units,
    proposed,
)
from controller.riccati.enclosure import Enclosure, enclosure_of, proved_in_doubles
from controller.riccati.equation import Entries, LoopGame, Units, equation_of
from controller.riccati.lyapunov import FailedError, Lyapunov, NotProvedError, loop_units
from controller.riccati.refusal import between_eigenvalues, half_plane_eigenvalues, stabilizing
from controller.riccati.smallest_delta import TOLERANCE, Search, estimate
from hfa_support.errors import BadInputError

if TYPE_CHECKING:
    from flint import arb_mat


#: Largest number of steps to the largest gain, each of which doubles its digits.
MOST_STEPS = 8
#: Relative distances from the lower bound at which the upper one is tried.
ABOVE = 0.9 * TOLERANCE * np.array([1.0, 1e2, 1e4])


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

        Raises FailedError or NotProvedError.
        """
        game = self.game()
        found = self._enclosed(game, delta)
        return LoopValue(found.P, found.L)

    def _enclosed(self, game: LoopGame, delta: float) -> Enclosure:
        """Return the enclosure of D as the value of the game.

        Raises FailedError or NotProvedError.
        """
        units = self.units(game, delta)
        for changes in (0, MOST_CHANGES):  # states in which D is nearly 1 are seldom needed
            with suppress(FailedError, NotProvedError):
                proposal = proposed(game, delta, units, changes)
                if found := proved_in_doubles(proposal):
                    return found
                candidate = corrected(proposal.equation, ball_matrix(proposal.X))
                return enclosure_of(stabilizing(candidate))
        return enclosure_of(stabilizing(candidate_in_bits(game, delta)))

    def game(self) -> LoopGame:
        """Return the loop as a game whose input moves nothing (B = 0).

        Raises FailedError.
        """
        F, E, C = map(midpoints, (self.F, self.E, self.C))
        if not E.any() and not all(entry == 0 for entry in self.E.entries()):
            raise FailedError("the disturbance may be 0")
        zero, one = np.zeros((len(F), 1)), np.eye(1)
        none = ball_matrix(zero)
        balls = Entries(self.F, none, self.E, self.C, identity(1), none)
        dt = True if self.is_discrete else None
        try:
            return LoopGame(F, zero, E=E, Q=(C + C.T) / 2.0, R=one, dt=dt, balls=balls)
        except BadInputError as error:
            raise FailedError(str(error)) from None

    def units(self, game: Game, delta: float) -> Units:
        """Return units in which F is balanced, and the cost has the size of F."""
        states = loop_units(midpoints(self.F))
        size = float(norm(scaled_balls(self.C, states, states)))
        power = int(np.round(0.5 * np.log2(size))) if size > 0.0 else 0
        return Units(states - power, np.zeros(1, dtype=int), disturbance_units(game, delta))

    def gain_at(self, frequencies: Iterable[float]) -> float:
        """Return the gain of one disturbance at one of these frequencies, rounded down; 0 without
        proof.

        Doubles propose the frequency and the disturbance.

        frequencies: rad/s, in discrete time rad/step
        """
        from flint import acb, acb_mat

        F, E, C = map(midpoints, (self.F, self.E, self.C))
        best, of_best, worst = -math.inf, 0.0, np.zeros(0)
        for frequency in frequencies:
            s = np.exp(1j * frequency) if self.is_discrete else 1j * frequency
            with suppress(np.linalg.LinAlgError), np.errstate(all="ignore"):
                response = np.linalg.solve(s * np.eye(len(F)) - F, E)
                costs, disturbances = np.linalg.eigh(response.conj().T @ C @ response)
                if costs[-1] > best:
                    best, of_best, worst = costs[-1], frequency, disturbances[:, -1]
        d = acb_mat([[complex(entry)] for entry in worst])
        z_rate = acb(0, of_best).exp() if self.is_discrete else acb(0, of_best)
        try:
            z = (acb_mat(identity(len(F))) * z_rate - acb_mat(self.F)).solve(acb_mat(self.E) * d)
        except (ZeroDivisionError, ValueError):
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
        game = loop.game()
        equation = equation_of(game, loop.units(game, math.inf), math.inf)
        F, C = midpoints(equation.A), midpoints(equation.Q)
        search = Search(equation, Lyapunov(F, is_discrete=loop.is_discrete).solve(-C), F)
    except FailedError:
        return GainBounds(0.0, math.inf)
    guess = estimate(search)
    proposed = guess.w**-0.5
    low, high = 0.0 if guess.frequency is None else loop.gain_at([guess.frequency]), math.inf
    for in_bits in (False, True)[: 2 if len(F) <= MOST_STATES_IN_BITS else 1]:
        if in_bits or not low * (1.0 + TOLERANCE) >= proposed:
            low = max(low, _climbed(loop, search, low or proposed, in_bits=in_bits))
        for bound in (*(low * (1.0 + ABOVE)).tolist(), 2.0 * proposed):
            if low < bound < high and is_below(loop, bound):
                high = bound
                break
        if GainBounds(low, high).is_narrow:
            break
    return GainBounds(low, high)


def _climbed(loop: DisturbedLoop, search: Search, level: float, *, in_bits: bool) -> float:
    """Return the largest gain found at frequencies between those at which a gain is `level`.

    in_bits: whether these are computed with the bits of `precision`

    Source: Bruinsma and Steinbuch, Systems & Control Letters 14 (1990), 287-293.
    """
    best = 0.0
    for _ in range(MOST_STEPS):
        with suppress(np.linalg.LinAlgError), np.errstate(all="ignore"):
            if in_bits:
                units = loop.units(search.game, level)
                values = half_plane_eigenvalues(
                    equation_of(search.game, units, level), in_bits=True
                )
            else:
                values = np.linalg.eigvals(search.half_plane(level**-2.0))
            found = loop.gain_at(between_eigenvalues(values, is_discrete=loop.is_discrete))
            best, before = max(best, found), best
            if best <= before * (1.0 + 0.01 * TOLERANCE):
                break
            level = best
    return best


def is_below(loop: DisturbedLoop, bound: float) -> bool:
    """Return whether the gain is proved to be below a bound."""
    try:
        loop.value(bound)  # a value at δ = bound is the proof
    except (FailedError, NotProvedError):
        return False
    return True
