"""Proof of a statement about a gain schedule, by bisection of the scheduling interval.

On each piece s = s0 + t, |t| <= h, the trim is proved (`trims.py`), and the closed loop C = A - B K
at the trim is enclosed as C0 + C1 t + R, with R a box of matrices. Two inequalities are proved for
t = ±h, and hold between because they are affine in t:

- decay: -(C'P + P C) - 2 a P > 0 with P = T⁻'T⁻¹ > 0, T a real basis of the modes at the center
- motion: -(C'P + P C) ∓ r dP/ds > 0 with P > 0 of the certificate, linear in s, r the rate

Of the witness, the proof uses P of the motion, and the number of pieces after which it stops.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import casadi as ca
import numpy as np
from flint import arb, arb_mat, ctx

from hfa_prove.check.trims import SteadyFlight, TrimPiece
from hfa_prove.enclosure.ball_function import BallFunction, Undecided
from hfa_prove.enclosure.balls import exact, is_positive_definite, matrix, symmetric
from hfa_prove.enclosure.precision import PRECISION
from hfa_prove.fields import Rejected
from hfa_prove.statements.plant import SAME_TRIM
from hfa_prove.statements.schedule import ScheduleStatement, ScheduleWitness
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
    if not all(is_positive_definite(matrix(P)) for P in witness.P):
        raise Rejected("P of the motion is not proved positive definite")
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
    def _loops(self) -> tuple[ca.Function, BallFunction, BallFunction]:
        """The closed loop C (n n,) in doubles and in balls, and its derivatives in w and s."""
        w, s, numbers, *_, A, B = self.flight.expressions
        m, n = self.statement.gains.K.shape[1:]
        K, slope, origin = ca.SX.sym("K", m, n), ca.SX.sym("slope", m, n), ca.SX.sym("origin")
        loop = ca.vec(A - B @ (K + (s - origin) * slope))
        more = [ca.vec(K), ca.vec(slope), origin]
        of_loop = ca.Function("loop", [w, s, numbers, *more], [ca.densify(loop)])
        balls = self.flight.balls("loop", [loop], *more)
        derivatives = [ca.jacobian(loop, w), ca.jacobian(loop, s)]
        return of_loop, balls, self.flight.balls("derivatives", derivatives, *more)

    def parts(self) -> list[tuple[float, float]]:
        """Return the parts of the interval between breakpoints of the gains and of P."""
        parts = self.statement.gains.pieces(*self.statement.flight.range)
        inner = self.witness.breakpoints.tolist()
        cuts = sorted({end for part in parts for end in part} | set(inner))
        low, high = self.statement.flight.range
        if len(inner) > 1 and not (inner[0] <= low and high <= inner[-1]):
            raise Rejected("P of the motion is not given on the whole interval")
        kept = [cut for cut in cuts if low <= cut <= high]
        return list(pairwise(kept))

    def piece(self, low: float, high: float, before: TrimPiece | None) -> TrimPiece:
        """Return the trims of a piece, on which every claim is proved.

        before: the piece that ends at `low`, or None for the first piece

        Raises Undecided or Rejected if a claim is not proved.
        """
        stated = np.array(list(self.statement.flight.first.values()))
        guess = stated
        if before is not None:
            middle = 0.5 * (before.low + before.high)
            guess = before.estimate + before.slope * (0.5 * (low + high) - middle)
        trims = self.flight.trims(low, high, guess)
        if before is not None:
            if not trims.continues(before):
                raise Rejected("the trims are not proved to be on one branch")
        elif not all(
            abs(ball - exact(value)) <= exact(SAME_TRIM * nominal)
            for ball, value, nominal in zip(
                trims.at(low, trims.offset), stated.tolist(), self.flight.nominal, strict=True
            )
        ):
            raise Rejected("the first trim differs from the stated one")
        loop = self.loop(trims)
        self._check_decay(loop, trims)
        if self.statement.scheduled_rate is not None:
            self._check_motion(loop, trims)
        return trims

    def _gain(self, low: float) -> tuple[np.ndarray, arb_mat, float]:
        """Return K at the breakpoint below a piece, the slope of K after it, and the breakpoint."""
        breakpoints, K = self.statement.gains.breakpoints, self.statement.gains.K
        if len(breakpoints) == 1:
            return K[0], matrix(np.zeros(K[0].shape)), 0.0
        k = max(0, min(int(np.searchsorted(breakpoints, low, "right")) - 1, len(K) - 2))
        run = exact(breakpoints[k + 1]) - exact(breakpoints[k])
        return K[k], (matrix(K[k + 1]) - matrix(K[k])) / run, float(breakpoints[k])

    def loop_at(self, w: np.ndarray, s: float) -> np.ndarray:
        """Return the closed loop C (n, n) at a trim w (f,) in doubles."""
        K, slope, origin = self._gain(s)
        slopes = [float(each.mid()) for each in slope.transpose().entries()]
        values = self._loops[0](w, s, self.flight.doubles, K.ravel(order="F"), slopes, origin)
        return np.array(values).reshape(K.shape[1], K.shape[1], order="F")

    def loop(self, trims: TrimPiece) -> LinearInPosition:
        """Return the closed loop on a piece."""
        K, slope, origin = self._gain(trims.low)
        gain = [matrix(K).transpose().entries(), slope.transpose().entries(), [exact(origin)]]
        n = K.shape[1]
        _, loop, derivatives = self._loops
        at = [exact(value) for value in trims.estimate.tolist()]
        (at_centre,) = loop(at, [trims.middle], self.flight.numbers, *gain)
        s = trims.middle + symmetric(trims.half_width)
        around = trims.along(trims.offset)
        by_w, by_s = derivatives(around, [s], self.flight.numbers, *gain)
        f = len(at)
        by_free = arb_mat(f, n * n, by_w).transpose()
        along = arb_mat(n * n, 1, by_s) + by_free * matrix(trims.slope[:, None])
        middle = along.mid()
        rest = (along - middle) * symmetric(trims.half_width)
        rest += by_free * arb_mat(f, 1, list(trims.offset))
        columns = (at_centre, middle.entries(), rest.entries())
        return LinearInPosition(*(arb_mat(n, n, list(each)).transpose() for each in columns))

    def _check_decay(self, loop: LinearInPosition, trims: TrimPiece) -> None:
        """Raise Rejected unless the decay rate is proved on a piece."""
        n = loop.centre.nrows()
        values, vectors = np.linalg.eig(loop.in_doubles())
        largest = float(values.real.max())
        rate = self.statement.decay_rate
        if not largest < -rate:
            raise RefutedError(
                f"A - B K has an eigenvalue with the real part {largest:.6g} 1/s, not below -"
                f"{rate:.6g} 1/s"
            )
        T = matrix(real_basis(values, vectors))
        back = T.inv()
        for t in (-trims.half_width, trims.half_width):
            S = back * loop.at(t) * T
            if not is_positive_definite(-(S + S.transpose()) - 2 * exact(rate) * matrix(np.eye(n))):
                raise Rejected(f"the decay rate {rate:.6g} 1/s is not proved")

    def _check_motion(self, loop: LinearInPosition, trims: TrimPiece) -> None:
        """Raise Rejected unless V = x'P x decreases on every motion within the rate on a piece.

        With P = P0 + P1 t, the inequality has the further term (C1'P1 + P1 C1)(h² - t²).
        """
        P, slope = self._P(trims)
        half = trims.half_width
        rate = self.statement.scheduled_rate
        moved = slope * exact(rate) if rate is not None and len(self.witness.P) > 1 else 0 * slope
        bend = loop.slope.transpose() * slope
        bend = (bend + bend.transpose()) * arb(0).union(half * half)
        try:
            T = matrix(np.linalg.inv(np.linalg.cholesky(_mid(P))).T)
        except np.linalg.LinAlgError as error:
            raise Rejected("P of the motion is nearly singular") from error
        for t in (-half, half):
            product = loop.at(t).transpose() * (P + slope * t)
            S = bend - (product + product.transpose())
            for side in (moved, -moved):
                if not is_positive_definite(T.transpose() * (S + side) * T):
                    raise Rejected("the motion of the scheduling variable is not proved stable")

    def _P(self, trims: TrimPiece) -> tuple[arb_mat, arb_mat]:
        """Return P at the center of a piece and its derivative in s."""
        nodes, P = self.witness.breakpoints, self.witness.P
        if len(nodes) == 1:
            return matrix(P[0]), matrix(np.zeros(P[0].shape))
        k = min(int(np.searchsorted(nodes, trims.low, "right")) - 1, len(nodes) - 2)
        slope = (matrix(P[k + 1]) - matrix(P[k])) / (exact(nodes[k + 1]) - exact(nodes[k]))
        return matrix(P[k]) + slope * (trims.middle - exact(nodes[k])), slope


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

    def in_doubles(self) -> np.ndarray:
        """Return C0 in doubles."""
        return _mid(self.centre)


def _mid(values: arb_mat) -> np.ndarray:
    return np.array([[float(entry.mid()) for entry in row] for row in values.tolist()])


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
