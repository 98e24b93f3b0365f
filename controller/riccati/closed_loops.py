"""Closed loops in states in which the value of the game is nearly y'y.

There, the entries of a loop have the size of its rates: its poles, gains and margins keep the
digits of doubles, in whatever states and units the user gave the game.
"""

from __future__ import annotations

import math
from contextlib import suppress
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from controller.game.zero_sum import Game
from controller.riccati.balls import (
    ATTEMPTS,
    ROUNDOFF,
    ball_matrix,
    identity,
    midpoints,
    precision,
    scaled,
    symmetric_part,
)
from controller.riccati.enclosure import Enclosure, enclosed_in_bits
from controller.riccati.l2_gain import DisturbedLoop, GainBounds, gain_of
from controller.riccati.lyapunov import (
    FailedError,
    NotProvedError,
    discounted,
    loop_units,
    loop_with,
)
from controller.riccati.rationals import disturbance_costs_nothing
from hfa_support.cached import cached_property
from hfa_support.matrices import spectral_abscissa, spectral_radius
from trim.linear.margins import ClosedLoop, DiskMargin, disk_of, loop_of

if TYPE_CHECKING:
    from flint import arb_mat


#: Bits with which poles are computed: a double has 53.
POLE_BITS = ATTEMPTS[1]


def poles_of(loop: arb_mat) -> np.ndarray:
    """Return the eigenvalues of a loop, (n,) complex, sorted by real, then by imaginary part.

    They are computed with the bits of `precision`, and rounded to doubles. An eigenvalue of the
    multiplicity k has 1/k of these bits; nothing is proved.

    loop: (n, n), balls
    """
    from flint import acb_mat

    units = loop_units(midpoints(loop))
    found: Any = acb_mat(scaled(loop, -units, units)).eig(algorithm="approx")
    values = np.array([complex(value) for value in found])
    values.imag[np.abs(values.imag) <= ROUNDOFF * np.abs(values)] = 0.0
    return np.sort_complex(values)


@dataclass(frozen=True, eq=False)
class ClosedLoops:
    """Loops of a solution in new states y, with the user's inputs and disturbances.

    The new states are those of the proof, in which the value is nearly y'y.

    enclosure: of the solution
    """

    enclosure: Enclosure

    def __reduce__(self) -> tuple[Any, ...]:
        """Return what the loops are of where a result is stored or copied."""
        return ClosedLoops, (self.enclosure,)

    @cached_property
    def changes(self) -> tuple[arb_mat, arb_mat]:
        """Matrix of the change from the user's states to the new ones, and its inverse, (n, n)."""
        T, powers = self.enclosure.units.T, self.enclosure.units.states
        T = identity(len(powers)) if T is None else T
        with precision(self.enclosure.bits):
            return scaled(T, 0 * powers, -powers), scaled(T.inv(), powers, 0 * powers)

    @cached_property
    def worst_loop(self) -> np.ndarray:
        """Loop of both players, A - B K + E L, (n, n), without discount."""
        into, back = self.changes
        with precision(self.enclosure.bits):
            return midpoints(into * _worst_loop(self.enclosure) * back)

    def with_gain(self, K: arb_mat) -> np.ndarray:
        """Return A - B K, (n, n), without discount.

        K: (m, n), balls in the user's units
        """
        into, back = self.changes
        with precision(self.enclosure.bits):
            return midpoints(into * loop_with(self.enclosure.game, K) * back)

    def columns(self, matrix: np.ndarray) -> np.ndarray:
        """Return columns of the user's states in the new states, rounded."""
        with precision(self.enclosure.bits):
            return midpoints(self.changes[0] * ball_matrix(matrix))

    def rows(self, matrix: arb_mat) -> np.ndarray:
        """Return rows for the new states y: times y, they are what the given rows are times z."""
        with precision(self.enclosure.bits):
            return midpoints(matrix * self.changes[1])

    def poles(self, K: np.ndarray | None = None) -> np.ndarray:
        """Return the eigenvalues of A - B K, (n,), by default of the optimal gain (`poles_of`).

        K: (m, n)
        """
        with precision(POLE_BITS):
            gain = self._closer().K if K is None else ball_matrix(K)
            return poles_of(loop_with(self.enclosure.game, gain))

    def worst_poles(self) -> np.ndarray:
        """Return the eigenvalues of A - B K + E L, (n,) (`poles_of`)."""
        with precision(POLE_BITS):
            return poles_of(_worst_loop(self._closer()))

    def _closer(self) -> Enclosure:
        """Return the enclosure with the bits of poles, or the one at hand if that is not proved."""
        with suppress(NotProvedError):
            return enclosed_in_bits(self.enclosure, POLE_BITS)
        return self.enclosure

    def l2_gain(self, K: np.ndarray | None = None) -> GainBounds:
        """Return the L2 gain from d to the cost with u = -K z, by default of the optimal gain.

        In discrete time, signals are weighted by α^(k/2), as their squares are in the cost.

        K: (m, n), for which √α (A - B K) is stable
        """
        game = self.enclosure.game
        if disturbance_costs_nothing(game, K):
            return GainBounds(0.0, 0.0)
        Q, N, R = map(ball_matrix, (game.Q, game.N, game.R))
        # The value at delta proves that the gain is below it. All bounds are proved.
        best = GainBounds(0.0, game.delta if K is None else math.inf)
        for bits in [bits for bits in ATTEMPTS if bits >= self.enclosure.bits][:3]:
            with precision(bits), suppress(FailedError, NotProvedError):
                gain = enclosed_in_bits(self.enclosure, bits).K if K is None else ball_matrix(K)
                crossed = N * gain
                cost = Q + gain.transpose() * R * gain - crossed - crossed.transpose()
                F = discounted(loop_with(game, gain), game)
                E = discounted(ball_matrix(game.E), game)
                loop = DisturbedLoop(F, E, symmetric_part(cost), game.is_discrete)
                low, high = gain_of(loop)
                best = GainBounds(max(best.low, low), min(best.high, high))
            if best.is_narrow:
                break
        return best

    def disk_margin(self, K: np.ndarray) -> DiskMargin | None:
        """Return the disk margin of u = -K z at all inputs, None if unstable as rounded.

        K: (m, n)
        """
        loop = self.at_inputs(ball_matrix(K))
        return None if loop is None else disk_of(loop)

    def at_inputs(self, K: arb_mat) -> ClosedLoop | None:
        """Return M = S - I/2 at all inputs of the closed loop with u = -K z.

        None if the loop is not stable as rounded to doubles.
        """
        game = self.enclosure.game
        return rounded_loop(self.with_gain(K), self.columns(game.B), self.rows(K), game)


def rounded_loop(closed: np.ndarray, B: np.ndarray, K: np.ndarray, game: Game) -> ClosedLoop | None:
    """Return the closed loop M = S - I/2 at all inputs, None if it is not stable as rounded.

    S is the sensitivity. The disk margin is the inverse of the largest μ(M(jω)).

    closed, B, K: A - B K, (n, n), (n, m), and (m, n), in states in which they are accurate
    """
    is_stable = (
        spectral_radius(closed) < 1.0 if game.is_discrete else spectral_abscissa(closed) < 0.0
    )
    with suppress(np.linalg.LinAlgError):  # in discrete time, -1 may be a pole as rounded
        return loop_of(closed, B, -K, game.dt) if is_stable else None
    return None


def _worst_loop(enclosure: Enclosure) -> arb_mat:
    """Return A - B K + E L in balls, in the user's units, (n, n), without discount."""
    game = enclosure.game
    return loop_with(game, enclosure.K) + ball_matrix(game.E) * enclosure.L
