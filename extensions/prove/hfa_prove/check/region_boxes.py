"""Checker of a region of attraction, by subdivision into boxes.

Let z be the deviation from the equilibrium without disturbances, y = M z, and S = {V <= rho} within
the cube |y_i| <= 1. Suppose that S meets no face of the cube and that all limits hold in S.

Theorem. If V' < 0 in S except at the equilibrium, every trajectory that begins in S exists for all
time, stays in S and converges to the equilibrium (LaSalle).

Theorem. If V' < 0 where V = rho, for every combination of the extreme values of the disturbances,
every trajectory that begins in S exists for all time and stays in S. The rates are affine in the
disturbances, so V' < 0 follows for all values between.

Where the equations switch, trajectories are Filippov solutions.

Of the search, the checker uses the multipliers of the extents and the number of boxes after which
the checker stops.
"""

from __future__ import annotations

import itertools
from abc import abstractmethod
from dataclasses import dataclass
from functools import cached_property

import casadi as ca
import numpy as np

from hfa_prove.check.cover import Boxes, refute
from hfa_prove.check.equilibrium import Equilibrium, check_near, equilibrium_near
from hfa_prove.check.piece import ROUNDING, OnPiece
from hfa_prove.enclosure.balls import hull, is_positive_definite, matrix
from hfa_prove.enclosure.program import Program
from hfa_prove.enclosure.slopes import Intervals, jacobian
from hfa_prove.enclosure.taylor import TaylorProgram, highest, lowest
from hfa_prove.fields import Rejected
from hfa_prove.statements.loop import Loop
from hfa_prove.statements.piece import Piece
from hfa_prove.statements.region import RegionStatement, RegionWitness
from hfa_support.errors import BadInputError
from hfa_support.progress import Progress

#: Largest k for which the hole |y_i| <= 2^-k is tried.
_SMALLEST_HOLE = 30
#: Exponent of a hole without a point besides the equilibrium.
_NO_HOLE = 2000


def check_region(
    statement: RegionStatement, witness: RegionWitness, progress: Progress | None = None
) -> int:
    """Prove a statement about a region and return the number of boxes that the proof evaluated.

    Raises Rejected if the statement is not proved.
    """
    loop = statement.loop
    stated = statement.equilibrium
    equilibrium = equilibrium_near(loop, np.array(list(stated.values())))
    check_near(equilibrium, loop, stated)
    extents = np.array([statement.extents[name] for name in loop.states])
    claims = claims_of(loop, equilibrium, statement.piece, extents, witness.multipliers)
    return sum(claim.proved(witness.boxes, progress) for claim in claims)


def claims_of(
    loop: Loop, equilibrium: Equilibrium, piece: Piece, extents: np.ndarray, multipliers: np.ndarray
) -> tuple[OnSet, ...]:
    """Return the properties that together prove a region, or an invariant set with disturbances.

    extents: (n, 2), lowest and highest state deviations z in the set
    multipliers: (n, 2), nonnegative factors of c - W in the proofs of the extents

    Raises BadInputError if a rate is not affine in the disturbances.
    """
    of_set = (loop, equilibrium, piece, extents, multipliers)
    if not loop.disturbances:
        return (Decrease(*of_set),)
    refuse_curved(loop)
    return (DecreaseAtEdge(*of_set), Limits(*of_set))


def refuse_curved(loop: Loop) -> None:
    """Raise BadInputError if a rate or an output is not affine in the disturbances.

    Otherwise the worst value of a disturbance might not be an end of its range.
    """
    x = ca.SX.sym("x", len(loop.states))
    w = ca.SX.sym("w", len(loop.disturbances))
    values = ca.densify(ca.vertcat(*loop.disturbed_rates(x, ca.vertsplit(w))))
    curved = ca.which_depends(values, w, 2)
    program = Program(ca.Function("rates", [ca.vertcat(x, w)], [values]), loop.model.name)
    for index, name in enumerate(loop.disturbances):
        if curved[index] or program.switches_on(x.numel() + index):
            raise BadInputError(
                f"{loop.model.name}: the rates are not affine in {name}; such disturbances are not"
                " supported"
            )


@dataclass(frozen=True, eq=False)
class OnSet(OnPiece):
    """Functions that are positive on the set of a piece, as a property that `cover` proves.

    extents: (n, 2), lowest and highest state deviations z in the set
    multipliers: (n, 2), nonnegative factors of c - W in the proofs of the extents
    """

    extents: np.ndarray
    multipliers: np.ndarray

    @property
    def at_once(self) -> int:
        """Largest number of boxes that are evaluated in one batch."""
        return self._functions.at_once

    def check_limits(self) -> None:
        """Raise Rejected unless every state within its extents is within its limits."""
        at = self.equilibrium
        limits = self.loop.ends(self.loop.states)
        for i, name in enumerate(self.loop.states):
            low, high = limits[i]
            least, most = self.extents[i]
            off = at.radius[i] + 1e-15 * abs(at.x[i])
            room = (max(-least, most) + off) * 1e-12 + off
            if not (low <= at.x[i] + least - room and at.x[i] + most + room <= high):
                raise Rejected(f"{name} is not proved to stay within its limits in the set")

    def edges(self, boxes: Boxes) -> np.ndarray:
        """Return for each box the index of the edge to halve, or -1 if the box is proved, (N,).

        Raises RefutedError at a point of the set where one of `_functions` is negative.
        """
        traced = self._functions.traced(*self.symbols_on(boxes))
        models = traced.outputs
        refute(boxes.centres, np.min(models.value + models.radius, axis=0), self.within)
        is_positive = lowest(models, self.n) > 0.0
        is_positive[0] |= boxes.reach <= 2.0**-self.hole
        is_inside = boxes.reach < 1.0
        waiting = np.flatnonzero(~(is_positive.all(axis=0) & is_inside))
        # the first function of each of these boxes that is not yet proved positive is sharpened
        first = np.argmin(is_positive[:, waiting], axis=0)
        sharpened = self._functions.sharpened(traced, first, waiting)
        is_positive[first, waiting] |= sharpened.lowest > 0.0
        edges = np.full(len(boxes.centres), -1)
        edges[waiting] = self.decisive_edges(boxes.part(waiting), sharpened.lowered_by)
        return np.where(is_positive.all(axis=0) & is_inside, -1, edges)

    @property
    def hole(self) -> int:
        """Exponent k of the hole |y_i| <= 2^-k, in which the first function may be 0: no hole."""
        return _NO_HOLE

    @cached_property
    def _functions(self) -> TaylorProgram:
        """Program of the functions that must be positive."""
        return self.taylor(self.functions())

    @abstractmethod
    def functions(self) -> list[ca.SX]:
        """Return the expressions that must be positive."""

    @cached_property
    def rates(self) -> list[tuple[ca.SX, ca.SX]]:
        """Expressions of z' and of the outputs with limits, for all extreme disturbances."""
        x = ca.DM(self.equilibrium.x) + self.symbols.z + self.symbols.e
        sizes = self.loop.disturbances.values()
        ends = itertools.product(*((-size, size) for size in sizes))
        return [self.loop.disturbed_rates(x, each) for each in ends]

    def decreases(self) -> list[ca.SX]:
        """Return -W' for all extreme disturbances."""
        _, slopes = self.piece.W.expressions(self.symbols.y)
        M = ca.DM(self.piece.M)
        return [-ca.dot(slopes, M @ rates) for rates, _ in self.rates]

    def distances(self) -> list[ca.SX]:
        """Return the distances of outputs from their limits, and one function for each extent.

        If h - z_i > k (c - W) with k >= 0, the upper bound h of z_i holds in the set. The lower
        bound is proved in the same way.
        """
        functions = []
        for _, outputs in self.rates:
            for name, output in zip(self.loop.limited_outputs, ca.vertsplit(outputs), strict=True):
                low, high = self.loop.limits[name]
                functions += [output - low] if np.isfinite(low) else []
                functions += [high - output] if np.isfinite(high) else []
        W, _ = self.piece.W.expressions(self.symbols.y)
        room = self.piece.c - W
        for i, ((low, high), (of_low, of_high)) in enumerate(
            zip(self.extents.tolist(), self.multipliers.tolist(), strict=True)
        ):
            z = self.symbols.z[i]
            functions += [z - low - of_low * room, high - z - of_high * room]
        return functions


class Decrease(OnSet):
    """Claims without disturbances: W' < 0 except at the equilibrium, and all limits hold."""

    def functions(self) -> list[ca.SX]:
        """Return -W', and the distances from the limits."""
        return [*self.decreases(), *self.distances()]

    @cached_property
    def hole(self) -> int:
        """Smallest exponent k with W' < 0 proved for 0 < max |y_i| <= 2^-k.

        Raises Rejected if no k is found.
        """
        for k in range(1, _SMALLEST_HOLE + 1):
            if self._decreases_with(self._slopes_within(k)):
                return k
        raise Rejected(
            "V' < 0 is not proved near the equilibrium: V is not a Lyapunov function of the "
            "linearization, or the rates have a kink at the equilibrium"
        )

    def _slopes_within(self, k: int) -> Intervals:
        """Return the slopes of ∂W and the rates, (2 n, 3 n), in (y, z, e) for max |y_i| <= 2^-k."""
        N, off = self.inverse
        reach = 2.0**-k * (np.abs(N) + off).sum(axis=1) * (1.0 + ROUNDING)
        radius = np.concatenate([np.full(self.n, 2.0**-k), reach, self.equilibrium.radius])
        symbols = Intervals(np.zeros(3 * self.n), radius)
        return jacobian(self._gradient_and_rates, symbols).slopes

    @cached_property
    def _gradient_and_rates(self) -> Program:
        """Program of the gradient of W and of the rates."""
        return self.program([self.piece.W.expressions(self.symbols.y)[1], self.rates[0][0]])

    def _decreases_with(self, slopes: Intervals) -> bool:
        """Return whether W' < 0 is proved where the slopes are those of `_slopes_within`.

        The gradient of W is G y and the rates are J z, with G and J within their enclosures. Hence
        W' = y'(S + S') y / 2 with S = G'M J M⁻¹.
        """
        n = self.n
        M = matrix(self.piece.M)
        G = hull(slopes.low[:n, :n], slopes.high[:n, :n])
        J = hull(slopes.low[n:, n : 2 * n], slopes.high[n:, n : 2 * n])
        S = G.transpose() * M * J * M.inv()
        return is_positive_definite(-(S + S.transpose()))


class DecreaseAtEdge(OnSet):
    """Claim with disturbances: W' < 0 where W = c."""

    def functions(self) -> list[ca.SX]:
        """Return -W' for all extreme disturbances."""
        return self.decreases()

    def is_outside(self, boxes: Boxes) -> np.ndarray:
        """Return the mask (N,) of the boxes on which W > c or W < c is proved."""
        level = self._level.over(boxes.centres, boxes.half_widths)
        is_below = highest(level, self.n)[0] < self.piece.c
        return np.asarray(super().is_outside(boxes) | is_below)

    def within(self, places: np.ndarray) -> np.ndarray:
        """Return the mask (N,) of the points on the edge of the set, to rounding."""
        return super().within(places) & (self.piece.W.at(places) >= self.piece.c * (1.0 - 1e-12))


class Limits(OnSet):
    """Claim with disturbances: all limits hold in the set."""

    def functions(self) -> list[ca.SX]:
        """Return the distances from the limits for all extreme disturbances."""
        return self.distances()
