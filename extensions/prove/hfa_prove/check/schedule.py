"""Proof of a statement about a gain schedule, by bisection of the scheduling interval.

On each piece s = s0 + t, |t| <= h, the trim is proved (`trims.py`), and the closed loop C = A - B K
at the trim is enclosed as C0 + C1 t + R, with R a box of matrices. Two inequalities are proved for
t = ±h, and hold between because they are affine in t:

- decay: -(C'P + P C) - 2 a P > 0 with P = T⁻'T⁻¹ > 0, T a real basis of the modes at the center
- motion: -(C'P + P C) ∓ r dP/ds > 0 with P of the certificate, linear in s, r the rate

The mean of the motion for both signs is -(C'P + P C) > 0, which implies P > 0 (Lyapunov), as all
eigenvalues of C have negative real parts.

Of the witness, the proof uses P of the motion, and the number of pieces after which it stops.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import NamedTuple

import casadi as ca
import numpy as np
from flint import arb, arb_mat, ctx

from controller.riccati.balls import ball_matrix, identity, is_positive_definite, midpoints
from hfa_prove.check.trims import SteadyFlight, TrimPiece
from hfa_prove.enclosure.ball_function import BallFunction, Undecided, about_zero, exact
from hfa_prove.enclosure.precision import PRECISION
from hfa_prove.fields import Rejected
from hfa_prove.statements.schedule import SAME_TRIM, ScheduleStatement, ScheduleWitness
from hfa_support.progress import Progress

#: Least length of a piece, relative to the interval.
_NARROWEST = 2.0**-24


@ctx.workprec(PRECISION)
def check_schedule(
    statement: ScheduleStatement, witness: ScheduleWitness, progress: Progress | None = None
) -> int:
    """Prove a statement about a gain schedule and return the number of pieces of the proof.

    The interval is halved until every piece is proved, in ascending order.

    Raises Rejected if the statement is not proved, with the place and the claim that is open.
    """
    proof = ScheduleProof(statement, witness)
    if statement.scheduled_rate == math.inf and len(witness.P) != 1:
        raise Rejected("a motion at any rate requires a constant P")
    low, high = statement.flight.range
    waiting = proof.parts()[::-1]
    before: TrimPiece | None = None
    tried = proved = 0
    while waiting:
        piece = waiting.pop()
        tried += 1
        try:
            before = proof.piece(*piece, before)
            proved += 1
        except (Undecided, Rejected, ZeroDivisionError) as error:
            middle = 0.5 * (piece[0] + piece[1])
            is_last = tried >= witness.pieces or piece[1] - piece[0] < _NARROWEST * (high - low)
            if is_last or isinstance(error, RefutedError):
                unit = statement.flight.model.schedule_unit
                raise Rejected(
                    f"open at {statement.flight.model.schedule} {middle:.6g} {unit}: {error}"
                ) from error
            waiting += [(middle, piece[1]), (piece[0], middle)]
        if progress is not None and tried % 8 == 0:
            progress(piece[0] - low, high - low, f"{proved} pieces")
    return proved


class _Loops(NamedTuple):
    """Closed loop C = A - B (K + (s - origin) slope), functions of (w, s, constants, K, slope,
    origin).

    doubles, balls: C, column by column
    derivatives: C, and its derivatives in w and in s
    """

    doubles: ca.Function
    balls: BallFunction
    derivatives: BallFunction


class RefutedError(Rejected):
    """Raised if a claim is false at a scheduling value, in double precision."""


@dataclass(frozen=True, eq=False)
class ScheduleProof:
    """The inequalities of a statement on a piece of the scheduling interval.

    statement: the claim
    witness: P of the motion
    """

    statement: ScheduleStatement
    witness: ScheduleWitness

    @cached_property
    def flight(self) -> SteadyFlight:
        """The trim equations."""
        return SteadyFlight(self.statement.flight)

    @cached_property
    def _loops(self) -> _Loops:
        """The closed loop A - B K(s) at a trim, and its derivatives."""
        trim = self.flight.expressions
        m, n = self.statement.gains.K.shape[1:]
        K, slope, origin = ca.SX.sym("K", m, n), ca.SX.sym("slope", m, n), ca.SX.sym("origin")
        loop = ca.vec(trim.A - trim.B @ (K + (trim.s - origin) * slope))
        gain = [ca.vec(K), ca.vec(slope), origin]
        derivatives = [loop, ca.jacobian(loop, trim.w), ca.jacobian(loop, trim.s)]
        return _Loops(
            ca.Function("loop", [trim.w, trim.s, trim.constants, *gain], [ca.densify(loop)]),
            self.flight.balls("loop", [loop], *gain),
            self.flight.balls("derivatives", derivatives, *gain),
        )

    def parts(self) -> list[tuple[float, float]]:
        """Return the parts of the interval between breakpoints of the gains and of P."""
        low, high = self.statement.flight.range
        parts = self.statement.gains.pieces(low, high)
        of_P = self.witness.breakpoints.tolist()
        if len(of_P) > 1 and not (of_P[0] <= low and high <= of_P[-1]):
            raise Rejected("P of the motion is not given on the whole interval")
        cuts = sorted({end for part in parts for end in part} | set(of_P))
        return list(pairwise(cut for cut in cuts if low <= cut <= high))

    def piece(self, low: float, high: float, before: TrimPiece | None) -> TrimPiece:
        """Return the trims of a piece, on which every claim is proved.

        before: the piece that ends at `low`, or None for the first piece

        Raises Undecided or Rejected if a claim is not proved.
        """
        trims = self.flight.trims(low, high, self._guess(0.5 * (low + high), before))
        self._check_branch(trims, before)
        loop = self.loop(trims)
        self._check_decay(loop, trims)
        rate = self.statement.scheduled_rate
        if rate is not None:
            self._check_motion(loop, trims, rate)
        return trims

    @cached_property
    def _first(self) -> np.ndarray:
        """The stated first trim, (f,)."""
        return np.array(list(self.statement.flight.first.values()))

    def _guess(self, s: float, before: TrimPiece | None) -> np.ndarray:
        """Return an estimate (f,) of the trim at s, on which no proof depends."""
        if before is None:
            return self._first
        return before.estimate + before.slope * (s - 0.5 * (before.low + before.high))

    def _check_branch(self, trims: TrimPiece, before: TrimPiece | None) -> None:
        """Raise Rejected unless the trims continue those before, or begin at the stated trim."""
        if before is not None:
            if not trims.continues(before):
                raise Rejected("the trims are not proved to be on one branch")
            return
        at_low = trims.at(trims.low, trims.offset)
        for ball, stated, nominal in zip(
            at_low, self._first.tolist(), self.flight.nominal, strict=True
        ):
            if not abs(ball - exact(stated)) <= exact(SAME_TRIM * nominal):
                raise Rejected("the first trim differs from the stated one")

    def _gain(self, s: float) -> LinearPart:
        """Return the gains on the part of the table that begins at or before s."""
        return linear_part(self.statement.gains.breakpoints, self.statement.gains.K, s)

    def loop_at(self, w: np.ndarray, s: float) -> np.ndarray:
        """Return the closed loop C (n, n) at a trim w (f,) in doubles."""
        K = self._gain(s)
        # In CasADi's order, column by column.
        value, slope = (midpoints(entries).ravel(order="F") for entries in (K.value, K.slope))
        values = self._loops.doubles(w, s, self.flight.doubles, value, slope, K.origin)
        n = K.value.ncols()
        return np.array(values).reshape(n, n, order="F")

    def loop(self, trims: TrimPiece) -> LinearInPosition:
        """Return the closed loop C(w, s) at the trims of a piece, as C0 + C1 t + R.

        With s = s0 + t and the trims w = v + v' t + e, e in `trims.offset`, the mean value theorem
        gives C(w, s) = C(v, s0) + (C_s + C_w v') t + C_w e, where C_s and C_w are enclosed at all
        points between (v, s0) and (w, s). C1 is the center of C_s + C_w v', and R has the rest.

        Raises Undecided if the loop switches on the piece, which its derivatives do not contain.
        """
        K = self._gain(trims.low)
        gain = [K.value.transpose().entries(), K.slope.transpose().entries(), [exact(K.origin)]]
        n = K.value.ncols()
        estimate = [exact(value) for value in trims.estimate.tolist()]
        (C0,) = self._loops.balls(estimate, [trims.middle], self.flight.constants, *gain)
        s = trims.middle + about_zero(trims.half_width)
        # e and 0: all points between the estimate at the center and the trims
        around = trims.along([offset.union(exact(0.0)) for offset in trims.offset])
        _, by_w, by_s = self._loops.derivatives(around, [s], self.flight.constants, *gain)
        f = len(estimate)
        C_w = arb_mat(f, n * n, by_w).transpose()
        along = arb_mat(n * n, 1, by_s) + C_w * ball_matrix(trims.slope[:, None])
        C1 = along.mid()
        R = (along - C1) * about_zero(trims.half_width) + C_w * arb_mat(f, 1, list(trims.offset))
        columns = (C0, C1.entries(), R.entries())
        return LinearInPosition(*(arb_mat(n, n, list(column)).transpose() for column in columns))

    def _check_decay(self, loop: LinearInPosition, trims: TrimPiece) -> None:
        """Raise Rejected unless Re λ < -a is proved for all eigenvalues of C and the decay rate a.

        It follows from -(S + S') - 2 a > 0 with S = T⁻¹ C T, which is affine in t: at both ends.
        """
        n = loop.centre.nrows()
        values, vectors = np.linalg.eig(midpoints(loop.centre))
        largest = float(values.real.max())
        rate = self.statement.decay_rate
        if not largest < -rate:
            raise RefutedError(
                f"A - B K has an eigenvalue with the real part {largest:.6g} 1/s, not below -"
                f"{rate:.6g} 1/s"
            )
        T = ball_matrix(real_basis(values, vectors))
        T_inverse = T.inv()
        twice_rate = 2 * exact(rate) * identity(n)
        for t in (-trims.half_width, trims.half_width):
            S = T_inverse * loop.at(t) * T
            if not is_positive_definite(-(S + S.transpose()) - twice_rate):
                raise Rejected(f"the decay rate {rate:.6g} 1/s is not proved")

    def _check_motion(self, loop: LinearInPosition, trims: TrimPiece, rate: float) -> None:
        """Raise Rejected unless V = x'P x decreases on a piece for every motion |ds/dt| <= rate.

        It decreases if -(C'P + P C) ∓ rate dP/ds > 0, which is proved in the basis T of P = T⁻'T⁻¹.
        P is that of the witness.
        """
        table = linear_part(self.witness.breakpoints, self.witness.P, trims.low)
        P, slope = table.at(trims.middle), table.slope
        h = trims.half_width
        is_constant = len(self.witness.P) == 1
        P_rate = 0 * slope if is_constant else slope * exact(rate)  # the rate may be infinite
        # C'P is quadratic in t: the line between its ends, minus (h² - t²) C1'dP/ds.
        C1_slope = loop.slope.transpose() * slope
        above_line = (C1_slope + C1_slope.transpose()) * arb(0).union(h * h)
        try:
            T = ball_matrix(np.linalg.inv(np.linalg.cholesky(midpoints(P))).T)
        except np.linalg.LinAlgError as error:
            raise Rejected("P of the motion is not positive definite") from error
        for t in (-h, h):
            product = loop.at(t).transpose() * (P + slope * t)
            S = above_line - (product + product.transpose())
            for change in (P_rate, -P_rate):
                if not is_positive_definite(T.transpose() * (S + change) * T):
                    raise Rejected("the motion of the scheduling variable is not proved stable")


class LinearPart(NamedTuple):
    """A matrix that is linear in the scheduling value s: value + slope (s - origin)."""

    value: arb_mat
    slope: arb_mat
    origin: float

    def at(self, s: arb) -> arb_mat:
        """Return the matrix at a scheduling value."""
        return self.value + self.slope * (s - exact(self.origin))


def linear_part(breakpoints: np.ndarray, values: np.ndarray, s: float) -> LinearPart:
    """Return a table on its part between two breakpoints that begins at or before s.

    breakpoints: (g,), increasing. With one breakpoint, the matrix is constant.
    values: matrices at the breakpoints, (g, rows, columns)
    """
    if len(breakpoints) == 1:
        zero = ball_matrix(np.zeros(values[0].shape))
        return LinearPart(ball_matrix(values[0]), slope=zero, origin=0.0)
    k = int(np.searchsorted(breakpoints, s, "right")) - 1
    k = min(max(k, 0), len(breakpoints) - 2)
    first, last = breakpoints[k : k + 2].tolist()
    slope = (ball_matrix(values[k + 1]) - ball_matrix(values[k])) / (exact(last) - exact(first))
    return LinearPart(ball_matrix(values[k]), slope, origin=first)


@dataclass(frozen=True, eq=False)
class LinearInPosition:
    """Matrix C on a piece: C0 + C1 t + R for some R in a box, at every position t.

    centre: C0
    slope: C1, without radius
    rest: R, as balls
    """

    centre: arb_mat
    slope: arb_mat
    rest: arb_mat

    def at(self, t: arb) -> arb_mat:
        """Return the balls of C at a position."""
        return self.centre + self.slope * t + self.rest


def real_basis(values: np.ndarray, vectors: np.ndarray) -> np.ndarray:
    """Return a real basis (n, n) of the modes of a matrix: columns Re v and Im v of each pair.

    values, vectors: eigenvalues and eigenvectors of a real matrix
    """
    columns = []
    for value, vector in zip(values, vectors.T, strict=True):
        if value.imag == 0.0:
            columns.append(vector.real)
        elif value.imag > 0.0:
            columns += [vector.real, vector.imag]
    return np.array(columns).T
