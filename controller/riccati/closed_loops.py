"""Closed loops in states in which the value of the game is nearly y'y.

There, the entries of a loop have the size of its rates: its poles, gains and margins keep the
digits of doubles, in whatever states and units the user gave the game.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from controller.game.zero_sum import Game
from controller.riccati.balls import (
    ATTEMPTS,
    ROUNDOFF,
    above,
    ball_matrix,
    identity,
    midpoints,
    norm,
    precision,
    scaled_balls,
    symmetric_part,
)
from controller.riccati.enclosure import Enclosure, enclosed_in_bits
from controller.riccati.l2_gain import DisturbedLoop, GainBounds, gain_of
from controller.riccati.lyapunov import (
    FailedError,
    NotProvedError,
    discounted,
    half_the_bits,
    loop_units,
    loop_with,
    stabilizes,
)
from controller.riccati.rationals import disturbance_costs_nothing
from hfa_support.cached import cached_property
from hfa_support.matrices import spectral_abscissa, spectral_radius
from trim.linear.margins import ClosedLoop, DiskMargin, disk_of, loop_of, spread

if TYPE_CHECKING:
    from flint import arb_mat


class Poles(NamedTuple):
    """Eigenvalues λ of a loop, in discs |λ - value| <= radius about numbers that `values` round.

    A union of discs that overlap no others contains as many eigenvalues as values.

    values: (n,) complex, sorted by real, then by imaginary part
    radii: (n,)
    """

    values: np.ndarray
    radii: np.ndarray

    @property
    def abscissa(self) -> float:
        """Largest real part of a value."""
        return float(self.values.real.max())

    @property
    def spectral_radius(self) -> float:
        """Largest magnitude of a value."""
        return float(np.abs(self.values).max())


def poles_of(loop: Callable[[int], arb_mat], *, is_discrete: bool) -> Poles:
    """Return the enclosed eigenvalues of a loop, with as many bits as give each digit.

    In continuous time, the digits of the real parts are asked for, in discrete time those of the
    spectral radius. A multiple eigenvalue may remain uncertain.

    loop: bits -> the loop, (n, n), balls
    """
    best: Poles | None = None
    for n_bits in ATTEMPTS:
        with precision(n_bits):
            try:
                poles = enclosed_poles(loop(n_bits))
            except (NotProvedError, ZeroDivisionError):
                continue
        if best is None or poles.radii.max() < best.radii.max():
            best = poles
        sizes = np.abs(best.values) if is_discrete else np.abs(best.values.real)
        if (best.radii <= ROUNDOFF * (sizes.max() if is_discrete else sizes)).all():
            break
    assert best is not None  # with the last bits, the V of `enclosed_poles` is not singular
    return best


def enclosed_poles(loop: arb_mat) -> Poles:
    """Return the enclosed eigenvalues of a loop F, (n, n), balls, with the bits of `precision`.

    The discs of Gershgorin of D = V⁻¹ F V contain the eigenvalues for any V, and are small if the
    columns of V are nearly eigenvectors.
    """
    from flint import acb_mat, arb

    units = loop_units(midpoints(loop))
    F = scaled_balls(loop, -units, units)
    # An approximate V of a multiple eigenvalue may be singular. With a change of F in the last
    # quarter of its digits, the eigenvalues differ.
    changed = (F + ball_matrix(spread(len(units))) * (norm(F) * half_the_bits() ** 1.5)).mid()
    V = acb_mat(changed).eig(right=True, algorithm="approx")[1]
    sizes = np.abs([[complex(entry) for entry in row] for row in V.tolist()]).max(0)
    V = (V * acb_mat(ball_matrix(np.diag(1.0 / sizes)))).mid()
    rows = V.solve(acb_mat(F) * V).tolist()  # of D: discs about its diagonal
    values = np.array([complex(row[i].mid()) for i, row in enumerate(rows)])
    radii = []
    for i, row in enumerate(rows):
        others = [abs(entry) for j, entry in enumerate(row) if j != i]
        radii.append(above(sum(others, row[i].rad() + arb(0))))
    radius = np.array(radii)
    # An isolated disc that meets the real axis contains a real eigenvalue.
    is_real = np.abs(values.imag) <= radius
    radius = np.where(is_real, radius + np.abs(values.imag), radius)
    values.imag[is_real] = 0.0
    order = np.lexsort((values.imag, values.real))
    return Poles(values[order], radius[order])


@dataclass(frozen=True, eq=False)
class ClosedLoops:
    """Loops of a solution in new states y, with the user's inputs and disturbances.

    The new states are those of the proof, in which the value is nearly y'y.

    enclosure: of the solution
    """

    enclosure: Enclosure

    @cached_property
    def changes(self) -> tuple[arb_mat, arb_mat]:
        """Matrix of the change from the user's states to the new ones, and its inverse, (n, n)."""
        T, powers = self.enclosure.units.T, self.enclosure.units.states
        T = identity(len(powers)) if T is None else T
        with precision(self.enclosure.bits):
            return scaled_balls(T, 0 * powers, -powers), scaled_balls(T.inv(), powers, 0 * powers)

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

    def poles(self, K: np.ndarray | None = None) -> Poles:
        """Return the enclosed eigenvalues of A - B K, by default of the optimal gain.

        K: (m, n)
        """

        def loop(bits: int) -> arb_mat:
            gain = enclosed_in_bits(self.enclosure, bits).K if K is None else ball_matrix(K)
            return loop_with(self.enclosure.game, gain)

        return poles_of(loop, is_discrete=self.enclosure.game.is_discrete)

    def worst_poles(self) -> Poles:
        """Return the enclosed eigenvalues of A - B K + E L."""

        def loop(bits: int) -> arb_mat:
            return _worst_loop(enclosed_in_bits(self.enclosure, bits))

        return poles_of(loop, is_discrete=self.enclosure.game.is_discrete)

    def l2_gain(self, K: np.ndarray | None = None) -> GainBounds:
        """Return the L2 gain from d to the cost with u = -K z, by default of the optimal gain.

        In discrete time, signals are weighted by α^(k/2), as their squares are in the cost.

        Both bounds are inf if √α (A - B K) is not proved stable.

        K: (m, n)
        """
        game = self.enclosure.game
        if K is not None and not stabilizes(game, K, is_discounted=True):
            return GainBounds(math.inf, math.inf)
        if disturbance_costs_nothing(game, K):
            return GainBounds(0.0, 0.0)
        Q, N, R = map(ball_matrix, (game.Q, game.N, game.R))
        best = GainBounds(0.0, math.inf)
        # The bounds of each attempt are proved; the next ones are closer.
        for bits in [bits for bits in ATTEMPTS if bits >= self.enclosure.bits][:3]:
            with precision(bits), suppress(FailedError, NotProvedError):
                gain = enclosed_in_bits(self.enclosure, bits).K if K is None else ball_matrix(K)
                crossed = N * gain
                cost = Q + gain.transpose() * R * gain - crossed - crossed.transpose()
                F = discounted(loop_with(game, gain), game)
                E = discounted(ball_matrix(game.E), game)
                loop = DisturbedLoop(F, E, symmetric_part(cost), game.is_discrete)
                best = min(best, gain_of(loop), key=lambda found: (found.high, -found.low))
            if best.is_narrow:
                break
        # The value at delta proves that the gain is below it.
        return best if K is not None else best._replace(high=min(best.high, game.delta))

    def distance(self, K: np.ndarray) -> float:
        """Return the smallest change of A - B K that gives an undamped mode, relative to its norm.

        The distance is 1 / max |(s - A + B K)⁻¹| over the boundary of stability, in balanced units.
        The exact one is proved not to be smaller, and usually at most 1e-6 larger. 0 without a
        proof that the loop is stable.

        K: (m, n)
        """
        game = self.enclosure.game
        if not stabilizes(game, K):
            return 0.0
        with precision(ATTEMPTS[1]):
            loop = loop_with(game, ball_matrix(K))
            units = loop_units(midpoints(loop))
            balanced_loop, one = scaled_balls(loop, -units, units), identity(len(units))
            size = float(np.linalg.norm(midpoints(balanced_loop), 2))
            gain = gain_of(DisturbedLoop(balanced_loop, one, one, game.is_discrete))
        return 1.0 / (gain.high * size) if size else math.inf

    def disk_margin(self, K: np.ndarray) -> DiskMargin | None:
        """Return the disk margin of u = -K z at all inputs, None if A - B K is not proved stable.

        K: (m, n)
        """
        if not stabilizes(self.enclosure.game, K):
            return None
        loop = self.at_inputs(ball_matrix(K))
        return None if loop is None else disk_of(loop)

    def at_inputs(self, K: arb_mat) -> ClosedLoop | None:
        """Return M = S - I/2 at all inputs of the stable closed loop with u = -K z.

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
