"""Enclosures of the value and the policies of games, proved with as many bits as are needed."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from controller.game.zero_sum import Game
from controller.riccati.balls import (
    BITS,
    Balls,
    DoubleBalls,
    ball_matrix,
    midpoints,
    part,
    precision,
)
from controller.riccati.equation import Matrix, scaled_balls
from controller.riccati.proof import (
    NotProvedError,
    Stabilizing,
    lyapunov_ball,
    prove_value,
    stabilizing,
)
from controller.riccati.proposal import (
    FailedError,
    Proposal,
    in_doubles,
    loop_units,
    lyapunov_in_bits,
    of_control_loop,
    proposal_in_bits,
)

if TYPE_CHECKING:
    from flint import arb, arb_mat

#: Bits of the attempts of a proof.
ATTEMPTS = (BITS, 2 * BITS, 4 * BITS, 8 * BITS)
#: Relative radius of an enclosure whose midpoints are right to the last digit of doubles.
DIGITS = 2.0**-56


@dataclass(frozen=True, eq=False)
class Enclosure:
    """Matrices of balls, in the user's units, that contain the exact solution of a game.

    proved: ball of the stabilizing solution
    bits: of the proof
    """

    proved: Stabilizing[Balls] | Stabilizing[DoubleBalls]
    bits: int

    @cached_property
    def P(self) -> arb_mat:
        """P of the value z'P z, (n, n)."""
        states = self.proved.equation.units.states
        with precision(self.bits):
            return scaled_balls(
                Balls.around(self.proved.X, self.proved.spread).matrix, -states, -states
            )

    @cached_property
    def K(self) -> arb_mat:
        """K of the policy u = -K z, (m, n)."""
        units, gains = self.proved.equation.units, self.proved.gains
        with precision(self.bits):
            return scaled_balls(
                part(gains, slice(len(units.inputs)), slice(None)), units.inputs, -units.states
            )

    @cached_property
    def L(self) -> arb_mat:
        """L of the worst disturbance d = L z, (k, n); 0 without a disturbance."""
        equation = self.proved.equation
        game, units = equation.game, equation.units
        with precision(self.bits):
            if not equation.is_disturbed:
                return ball_matrix(np.zeros(game.E.T.shape))
            if not equation.is_discrete:
                return ball_matrix(game.E).transpose() * self.P * equation.w
            gains = part(self.proved.gains, slice(len(units.inputs), None), slice(None))
            return scaled_balls(-gains, units.disturbances, -units.states)


def enclosed(game: Game, delta: float | None = None) -> Enclosure:
    """Return the proved enclosure of the value and the policies of a game.

    delta: in place of that of the game

    Raises NotProvedError if no proposal with up to 1024 bits proves them.
    """
    delta = game.delta if delta is None else delta
    reason = ""
    with precision(BITS):
        try:
            proposal = in_doubles(game, delta)
            fast = _value(proposal, DoubleBalls)
            if uncertainty(fast, zeros=False) < DIGITS:
                return Enclosure(fast, BITS)
        except (FailedError, NotProvedError) as failure:
            reason = str(failure)
    for attempt in ATTEMPTS:
        with precision(attempt):
            try:
                found = _value(proposal_in_bits(game, delta), Balls)
                if uncertainty(found, zeros=attempt > BITS) < DIGITS:
                    return Enclosure(found, attempt)
                reason = "the digits of K"
            except (FailedError, NotProvedError) as failure:
                reason = str(failure)
    raise NotProvedError(reason)


def _value(proposal: Proposal, arithmetic: type[Matrix]) -> Stabilizing[Matrix]:
    """Return the ball of the stabilizing solution, which is proved to be the value.

    Raises FailedError or NotProvedError.
    """
    found = stabilizing(proposal.equation, proposal.X, proposal.Y, arithmetic)
    try:
        prove_value(found)
    except NotProvedError:
        prove_value(found, of_control_loop(found))
    return found


def uncertainty(found: Stabilizing[Matrix], *, zeros: bool) -> arb:
    """Return the largest relative radius of P and K, infinite if a number is not known.

    P_ij is compared with √(P_ii P_jj), and K_ij with the largest K_ij / √P_jj of its row.

    zeros: whether entries that may be 0 count as known
    """
    from flint import arb

    sizes = [found.X[i, i].sqrt() for i in range(len(found.spread))]
    known = [bool(size > spread) for size, spread in zip(sizes, found.spread, strict=True)]
    if not zeros and not all(known):
        return arb("inf")
    worst = arb(0)
    for is_known, size, spread in zip(known, sizes, found.spread, strict=True):
        if is_known:
            worst = worst.max((spread / size) ** 2)
    for row in found.gains.tolist()[: len(found.equation.units.inputs)]:
        if zeros and all(entry.contains(0) for entry in row):
            continue
        relative = [entry / size for entry, size, ok in zip(row, sizes, known, strict=True) if ok]
        largest = arb(0)
        for entry in relative:
            largest = largest.max(abs(entry.mid()))
        for entry in relative:
            worst = worst.max(entry.rad() / largest if entry.rad() > 0 else arb(0))
    return worst if worst.is_finite() else arb("inf")


def lyapunov_enclosure(loop: arb_mat, C: arb_mat, *, is_discrete: bool) -> arb_mat | None:
    """Return balls that contain the solution D of F'D + D F + C = 0, or None if it is not proved.

    In discrete time, the equation is F'D F - D + C = 0. The number of bits is that of `precision`.
    None also means that F is not proved to be stable.

    loop: F, (n, n), balls
    C: (n, n), symmetric, balls
    """
    units = loop_units(midpoints(loop))
    F, right = scaled_balls(loop, -units, units), scaled_balls(C, units, units)
    try:
        Y = lyapunov_in_bits(F, ball_matrix(np.eye(len(units))), is_discrete=is_discrete)
        D = lyapunov_in_bits(F, right, is_discrete=is_discrete)
        return scaled_balls(lyapunov_ball(F, right, D, Y, is_discrete=is_discrete), -units, -units)
    except (FailedError, NotProvedError):
        return None
