"""Lower bound W on the cost of every flight to the trim, proved box by box.

Let z and v be the deviations of states and inputs from the equilibrium, y = M z, and W(y) a
polynomial without terms of degree 0 and 1. Let D be the set where W <= c within the envelope and
the cube |y_i| <= 1. Two properties are proved. D meets no face of the cube, and

    g(y, v) = grad W · M f(x* + z, u* + v) + z'Q z + v'R v >= 0 in D, for all v within the limits.

Consider flights within the envelope that end at the equilibrium. A flight that begins in D costs at
least W. A flight that begins elsewhere costs at least c, because W = c where the flight enters D
for the last time.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import casadi as ca
import numpy as np

from hfa_prove.check.cover import Boxes, RefutedError, refute
from hfa_prove.check.definite import Ends, Factor, ModelMatrix
from hfa_prove.check.equilibrium import check_near, equilibrium_near
from hfa_prove.check.piece import ROUNDING, OnPiece
from hfa_prove.enclosure.elementary import TINY
from hfa_prove.enclosure.program import Program
from hfa_prove.enclosure.slopes import Intervals, jacobian
from hfa_prove.enclosure.taylor import TaylorProgram, highest, lowest
from hfa_prove.fields import Rejected
from hfa_prove.statements.cost import CostStatement, CostWitness
from hfa_support.errors import BadInputError
from hfa_support.native.bound import RowFunction
from hfa_support.progress import Progress

#: Newton steps that improve an estimate of the best inputs, on which no proof depends.
_STEPS = 12
#: Largest k for which the hole |y_i| <= 2^-k is tried.
_SMALLEST_HOLE = 24


class Guess(NamedTuple):
    """Affine estimates v = value + slopes s of the minimizing input deviations, one for each box.

    s is the position in the box, |s_i| <= 1.

    value: estimates at the centers of the boxes, (boxes, m)
    slopes: (boxes, m, n)
    """

    value: np.ndarray
    slopes: np.ndarray

    def part(self, boxes: np.ndarray) -> Guess:
        """Return the estimates for the boxes with the given indices."""
        return Guess(self.value[boxes], self.slopes[boxes])


@dataclass(frozen=True, eq=False)
class CostInequality(OnPiece):
    """Inequality g >= 0 of a lower bound of the cost, as a property that `cover` proves.

    plant: the aircraft, whose state limits are the envelope
    equilibrium: enclosure of the equilibrium states and inputs
    piece: W and its level c
    Q: (n, n), symmetric, weight of the states
    R: (m, m), symmetric, weight of the inputs
    """

    Q: np.ndarray
    R: np.ndarray

    @property
    def at_once(self) -> int:
        """Largest number of boxes that are evaluated in one batch."""
        return self._values.at_once

    @cached_property
    def ends(self) -> np.ndarray:
        """Lowest and highest input deviations v, (m, 2), rounded outward.

        Raises Rejected if the enclosure of an input at the equilibrium is not within the input's
        limits.
        """
        names = tuple(self.plant.inputs)
        at = self.equilibrium.x[self.n :, None]
        radius = self.equilibrium.radius[self.n :, None]
        limits = self.plant.ends(names)
        for name, (low, high), value, off in zip(
            names, limits, at[:, 0], radius[:, 0], strict=True
        ):
            if not (low <= value - off and value + off <= high):
                raise Rejected(f"{name} is not proved to be within its limits at the equilibrium")
        slack = radius + 1e-15 * (np.abs(at) + np.where(np.isfinite(limits), np.abs(limits), 0.0))
        return np.asarray(limits - at + slack * np.array([-1.0, 1.0]))

    @cached_property
    def _margin(self) -> ca.SX:
        """Expression of g(y, v), the left side of the inequality g >= 0."""
        y, z, v, e = self.symbols
        ends = [0, self.n, self.n + self.m]
        x, u = ca.vertsplit(ca.DM(self.equilibrium.x), ends)
        error_of_x, error_of_u = ca.vertsplit(e, ends)
        rates, _ = self.plant.rates_at(x + z + error_of_x, u + v + error_of_u)
        _, slopes = self.piece.W.expressions(y)
        price = ca.dot(ca.DM(self.Q) @ z, z) + ca.dot(ca.DM(self.R) @ v, v)
        return ca.dot(slopes, ca.DM(self.piece.M) @ rates) + price

    @cached_property
    def _values(self) -> TaylorProgram:
        """Program that computes Taylor models of g."""
        return self.taylor([self._margin])

    @cached_property
    def _slopes(self) -> TaylorProgram:
        """Program that computes Taylor models of the gradient of g in v."""
        return self.taylor([ca.gradient(self._margin, self.symbols.v)])

    @cached_property
    def _bent(self) -> tuple[TaylorProgram, np.ndarray]:
        """Program of the second derivatives of g in v, (m m,), and a mask (m,) of inputs.

        The mask marks each input v_i on which the second derivatives depend.

        Raises BadInputError if a marked input has no limits, or if the rates may have a kink or a
        jump in an input, which the second derivatives do not contain.
        """
        v = self.symbols.v
        second = ca.hessian(self._margin, v)[0]
        taken = np.array(ca.which_depends(ca.densify(ca.vec(second)), v, 1, False), dtype=bool)
        for index, name in enumerate(self.plant.inputs):
            if self.plant.program.switches_on(self.n + index):
                raise BadInputError(
                    f"the rates contain a condition, a kink or a table of {name}; write them as "
                    "smooth functions of this input"
                )
            if taken[index] and not np.all(np.isfinite(self.ends[index])):
                raise BadInputError(
                    f"the rates are not affine in {name}, which has no limits; add min and max to "
                    "this input of the model"
                )
        return self.taylor([ca.vec(second)]), taken

    @cached_property
    def _centre(self) -> RowFunction:
        """Function (z, v) -> gradient of g in v, and its Jacobians in v and z, as doubles."""
        g = self._margin
        y, z, v, e = self.symbols
        here = ca.substitute(g, ca.vertcat(y, e), ca.vertcat(ca.DM(self.piece.M) @ z, 0 * e))
        slope = ca.gradient(here, v)
        outputs = [slope, ca.vec(ca.jacobian(slope, v)), ca.vec(ca.jacobian(slope, z))]
        return RowFunction(ca.Function("centre", [z, v], [ca.densify(each) for each in outputs]))

    def best_inputs(self, z: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return input deviations v that nearly minimize g at z, and their derivatives dv/dz.

        z: deviations of the states from the equilibrium, (N, n)

        The input deviations have shape (N, m) and the derivatives (N, m, n). The derivatives of a
        saturated input are 0. If a value at a point is not finite, all inputs and derivatives at
        this point are 0. No proof depends on these inputs.
        """
        count = len(z)
        n, m = self.n, self.m
        v = np.zeros((count, m))
        slopes = np.zeros((count, m, n))
        if not m:
            return v, slopes
        low, high = self.ends.T
        with np.errstate(all="ignore"):
            for _ in range(_STEPS):
                b, H, cross = self._at_centre(z, v)
                at_low = (v <= low) & (b > 0.0)
                at_high = (v >= high) & (b < 0.0)
                free = ~(at_low | at_high)
                step = solved_for(H, np.where(free, -b, 0.0)[..., None], free)[..., 0]
                new = np.clip(v + step, low, high)
                change = np.abs(new - v)
                v = new
                if np.all(change <= 1e-9 * (np.abs(v) + 1e-9)):
                    break
            slopes = -solved_for(H, np.where(free[..., None], cross, 0.0), free)
        bad = ~np.isfinite(slopes).all(axis=(1, 2)) | ~np.isfinite(v).all(axis=1)
        v[bad] = 0.0
        slopes[bad] = 0.0
        return v, slopes

    def _at_centre(self, z: np.ndarray, v: np.ndarray) -> tuple[np.ndarray, ...]:
        b, H, cross = self._centre(z, v)
        shape = (len(z), self.m, self.m)
        by_column = cross.reshape(len(z), self.n, self.m).transpose(0, 2, 1)
        return b, H.reshape(shape), by_column

    def check_limits(self) -> None:
        """Raise Rejected unless the center of the enclosed equilibrium is within its limits.

        Only limits of states are tested.
        """
        low, high = self.plant.ends(self.plant.states).T
        at = self.equilibrium.x[: self.n]
        if not np.all((low <= at) & (at <= high)):
            raise Rejected("the equilibrium is outside the state limits")

    def is_outside(self, boxes: Boxes) -> np.ndarray:
        """Return the mask (N,) of the boxes that are proved to be outside the state limits."""
        N, off = self.inverse
        centres = boxes.centres @ N.T
        reach = (
            boxes.half_widths @ np.abs(N).T + (np.abs(boxes.centres) + boxes.half_widths) @ off.T
        )
        at = self.equilibrium.x[: self.n]
        reach = reach * (1.0 + ROUNDING) + self.equilibrium.radius[: self.n]
        reach = reach + 1e-14 * (np.abs(centres) + np.abs(at))
        low, high = self.plant.ends(self.plant.states).T
        beyond = (at + centres - reach > high) | (at + centres + reach < low)
        return np.asarray(beyond.any(axis=1))

    def edges(self, boxes: Boxes) -> np.ndarray:
        """Return for each box the index of the edge to halve, or -1 if the box is decided, (N,).

        A box is decided if W > c or g >= 0 is proved on the box.

        Raises RefutedError at a point of the set where g < 0, or at a point of the set on a face of
        the cube.
        """
        edges = np.full(len(boxes.centres), -1)
        meets_set = np.flatnonzero(~super().is_outside(boxes))
        if len(meets_set):
            with np.errstate(all="ignore"):
                edges[meets_set] = self._edges_in_set(boxes.part(meets_set))
        return edges

    def _edges_in_set(self, boxes: Boxes) -> np.ndarray:
        """Return the result of `edges` for boxes that meet the set {W <= c}.

        With a guess v* of the best inputs, g(y, v) >= 0 for all v within the limits follows from

            g(y, v*) > g(y, v*) - min over v of g(y, v)

        The left side is bounded from below by a Taylor model, the right side from above by `_loss`.
        In the hole about the equilibrium, g >= 0 is known. No box may meet a face of the cube.
        """
        guess = self._guess(boxes)
        traced = self._values.traced(*self._inputs(boxes, guess))
        at_guess = traced.outputs
        refute(boxes.centres, at_guess.value[0] + at_guess.radius[0], self.within)
        meets_face = boxes.reach >= 1.0
        self._refute_faces(boxes.part(meets_face))
        every = np.arange(len(boxes.centres))
        sharpened = self._values.sharpened(traced, np.zeros_like(every), every)
        left = sharpened.lowest
        may_be = np.flatnonzero((left > 0.0) & ~meets_face)
        right = np.full(len(left), np.inf)
        right[may_be] = self._loss(boxes.part(may_be), guess.part(may_be))
        in_hole = boxes.reach <= 2.0**-self.hole
        edges = self.decisive_edges(boxes, sharpened.lowered_by)
        return np.where((left > right) | in_hole, -1, edges)

    def _guess(self, boxes: Boxes) -> Guess:
        """Return estimates of the inputs that minimize g on each box."""
        N = self.inverse[0]
        v, slopes = self.best_inputs(boxes.centres @ N.T)
        return Guess(v, np.einsum("bmn,nk,bk->bmk", slopes, N, boxes.half_widths))

    def _refute_faces(self, boxes: Boxes) -> None:
        """Raise RefutedError if a tested point of a face of the cube is in the set.

        For each box the tested point is the point of the face nearest to the center of the box.
        """
        nearest = np.argmax(np.abs(boxes.centres) + boxes.half_widths, axis=1)[:, None]
        points = boxes.centres.copy()
        ends = np.copysign(1.0, np.take_along_axis(points, nearest, axis=1))
        np.put_along_axis(points, nearest, ends, axis=1)
        in_set = points[self.within(points)]
        if len(in_set):
            raise RefutedError("the set {W <= c} extends beyond the boxes of the proof", in_set[0])

    def _inputs(self, boxes: Boxes, guess: Guess) -> tuple[np.ndarray, np.ndarray]:
        """Return Taylor models of the symbols (y, z, v, e) on boxes, with v at the guessed inputs.

        The models are coefficients (symbols, 1 + n, boxes) and radii (symbols, boxes).

        guess: estimates of the minimizing inputs on the boxes
        """
        linear, radius = self.symbols_on(boxes)
        linear[self._of_inputs, 0] = guess.value.T
        linear[self._of_inputs, 1:] = guess.slopes.transpose(1, 2, 0)
        return linear, radius

    @property
    def _of_inputs(self) -> slice:
        """Indices of the inputs v among the symbols (y, z, v, e)."""
        return slice(2 * self.n, 2 * self.n + self.m)

    def _loss(self, boxes: Boxes, guess: Guess) -> np.ndarray:
        """Return upper bounds of g(y, v*) - min over v of g(y, v), (boxes,), for a guess v*.

        For d = v - v*, the gradient b of g in v at v*, and lower bounds λ of the curvature between
        v* and all v within the limits (`_curvature`),

            g(y, v* + d) - g(y, v*) >= Σ_i (b_i d_i + λ_i d_i² / 2)

        The bound is minus the sum of the least terms.
        """
        if not self.m or not len(boxes.centres):
            return np.zeros(len(boxes.centres))
        limits = Ends(*self.ends.T)
        reach = np.abs(guess.slopes).sum(axis=2) * (1.0 + ROUNDING)
        guessed = Ends(guess.value - reach, guess.value + reach)
        d = Ends(limits.low - guessed.high, limits.high - guessed.low)
        gradient = self._slopes.of(*self._inputs(boxes, guess))
        b = Ends(lowest(gradient, self.n).T, highest(gradient, self.n).T)
        curvature = self._curvature(
            boxes, np.minimum(limits.low, guessed.low), np.maximum(limits.high, guessed.high)
        )
        least = np.minimum(_least_change(b, curvature, d), 0.0)
        return np.asarray(-least.sum(axis=1) * (1.0 + ROUNDING) + TINY)

    def _curvature(self, boxes: Boxes, least: np.ndarray, most: np.ndarray) -> np.ndarray:
        """Return bounds λ, (boxes, m), with Σ λ_i d_i² <= d'H d for every d.

        H is the Hessian of g in v. The bounds follow from Gershgorin's theorem.

        least, most: lowest and highest input deviations v, (boxes, m)
        """
        program, taken = self._bent
        n, m = self.n, self.m
        linear, radius = self.symbols_on(boxes)
        middle = np.where(taken, 0.5 * (least + most), 0.0)
        linear[self._of_inputs, 0] = middle.T
        width = np.where(taken, np.maximum(most - middle, middle - least) * (1.0 + ROUNDING), 0.0)
        radius[self._of_inputs] = width.T
        models = program.of(linear, radius)
        low = lowest(models, n).T.reshape(-1, m, m)
        high = highest(models, n).T.reshape(-1, m, m)
        sizes = np.maximum(np.abs(low), np.abs(high))
        diagonal = np.arange(m)
        own = low[:, diagonal, diagonal]
        sizes[:, diagonal, diagonal] = 0.0
        others = sizes.sum(axis=2)
        return np.asarray(own - others - ROUNDING * (np.abs(own) + others))

    @cached_property
    def hole(self) -> int:
        """Smallest exponent k with g >= 0 proved for |y_i| <= 2^-k and all permitted inputs.

        g and its gradient are 0 at the equilibrium. g is convex in v with a curvature of at least
        λ. Therefore the minimizing v satisfies Σ λ_i v_i² <= Σ b_i² / λ_i, with the gradient b of g
        in v at v = 0. The inequality g >= 0 follows if the Hessian of g in (z, v) is positive
        definite for all such v.

        Raises Rejected if no k is found.
        """
        for k in range(1, _SMALLEST_HOLE + 1):
            box = Boxes(np.zeros((1, self.n)), np.full((1, self.n), k))
            radii = self._best_inputs_within(box)
            if radii is not None and self._is_convex(box, radii):
                return k
        raise Rejected(
            "the inequality is not proved near the equilibrium: the rates have a kink, the cost "
            "is not convex in the inputs, or W is too large"
        )

    def _best_inputs_within(self, box: Boxes) -> np.ndarray | None:
        """Return bounds (m,) of |v_i| at the inputs that minimize g on a box about the equilibrium.

        Return None if g is not proved convex in v.
        """
        if not self.m:
            return np.zeros(0)
        curvature = self._curvature(box, self.ends[None, :, 0], self.ends[None, :, 1])[0]
        if not np.all(curvature > 0.0):
            return None
        slopes = self._slopes.of(*self.symbols_on(box))
        b = np.maximum(-lowest(slopes, self.n), highest(slopes, self.n))[:, 0]
        return np.asarray(np.sqrt(np.sum(b**2 / curvature) / curvature) * (1.0 + 1e-9))

    def _is_convex(self, box: Boxes, radii: np.ndarray) -> bool:
        """Return whether g is proved strictly convex in (z, v) on a box.

        The gradient of g has bounded slopes (it does not jump), and the Hessian is positive
        definite.

        box: box about the equilibrium
        radii: (m,), the proof covers all inputs with |v_i| <= radii_i
        """
        lift = np.vstack([np.pad(self.piece.M, ((0, 0), (0, self.m))), np.eye(self.n + self.m)])
        of_zv = Factor.exact(lift)
        return self._has_bounded_slopes(box, radii) and self._hessian_on(box, radii).is_definite(
            of_zv, of_zv
        )

    def _has_bounded_slopes(self, box: Boxes, radii: np.ndarray) -> bool:
        """Return whether the slopes of the gradient of g in (y, z, v) are proved bounded on a box.

        At a kink of the rates they are not.
        """
        linear, radius = self.symbols_on(box)
        reach = np.abs(linear[:, 1:, 0]).sum(axis=1) + radius[:, 0]
        reach[self._of_inputs] = radii
        symbols = Intervals(np.zeros(len(reach)), reach * (1.0 + ROUNDING))
        return jacobian(self._gradient, symbols).slopes.is_bounded

    def _hessian_on(self, box: Boxes, radii: np.ndarray) -> ModelMatrix:
        """Return the Hessian of g in (y, z, v) for y in a box and |v_i| <= radii_i."""
        size = 2 * self.n + self.m
        linear, radius = self.symbols_on(box)
        of_v = np.zeros((len(linear), self.m, 1))
        of_v[self._of_inputs, :, 0] = np.diag(radii)
        models = self._hessian.of(np.concatenate([linear, of_v], axis=1), radius)
        return ModelMatrix.of(models, size, self.n + self.m)

    @cached_property
    def _gradient(self) -> Program:
        """Program of the gradient of g in (y, z, v)."""
        y, z, v, _ = self.symbols
        return self.program([ca.gradient(self._margin, ca.vertcat(y, z, v))])

    @cached_property
    def _hessian(self) -> TaylorProgram:
        """Program of the second derivatives of g in (y, z, v), over boxes of y and v."""
        y, z, v, _ = self.symbols
        second = ca.hessian(self._margin, ca.vertcat(y, z, v))[0]
        return TaylorProgram(self.program([ca.vec(second)]), self.n + self.m)


def _least_change(b: Ends, curvature: np.ndarray, d: Ends) -> np.ndarray:
    """Return a lower bound of b d + curvature d² / 2 over all b and all d within bounds.

    For d >= 0 the lowest b gives the least value, for d <= 0 the highest.
    """
    rising = _least(b.low, curvature, Ends(np.maximum(d.low, 0.0), d.high))
    falling = _least(-b.high, curvature, Ends(np.maximum(-d.high, 0.0), -d.low))
    return np.minimum(rising, falling)


def _least(b: np.ndarray, curvature: np.ndarray, d: Ends) -> np.ndarray:
    """Return a lower bound of b d + curvature d² / 2 over all d within bounds, of which none is
    negative, or 0 if there are none (high < low).
    """
    is_convex = curvature > 0.0
    vertex = np.clip(-b / np.where(is_convex, curvature, 1.0), d.low, d.high)
    at_ends = np.minimum(_parabola(b, curvature, d.low), _parabola(b, curvature, d.high))
    least = np.where(is_convex, _parabola(b, curvature, vertex), at_ends)
    return np.asarray(np.where(d.high < d.low, 0.0, least))


def _parabola(b: np.ndarray, curvature: np.ndarray, d: np.ndarray) -> np.ndarray:
    linear = b * d
    square = 0.5 * curvature * d * d
    return np.asarray(linear + square - 1e-15 * (np.abs(linear) + np.abs(square)))


def solved_for(H: np.ndarray, right: np.ndarray, free: np.ndarray) -> np.ndarray:
    """Return x (N, m, k), the solution of H x = right in the free rows and columns.

    The other entries of x are 0. If the equations of the free entries are singular, x = right.

    H: (N, m, m)
    right: (N, m, k), 0 in the rows that are not free
    free: (N, m), mask of the free rows
    """
    m = H.shape[1]
    both = free[:, :, None] & free[:, None, :]
    kept = np.where(both, H, 0.0)
    kept[:, np.arange(m), np.arange(m)] += np.where(free, 0.0, 1.0)
    singular = ~(np.abs(np.linalg.det(kept)) > 0.0)
    kept[singular] = np.eye(m)
    return np.asarray(np.linalg.solve(kept, right))


def check_cost(
    statement: CostStatement, witness: CostWitness, progress: Progress | None = None
) -> tuple[int, ...]:
    """Prove a lower bound of the cost and return the number of boxes evaluated for each piece.

    Raises Rejected if the statement is not proved, or if the witness does not name as many unknowns
    as there are states.
    """
    plant = statement.plant
    names = (*plant.states, *plant.inputs)
    stated = {name: statement.equilibrium[name] for name in names}
    solved = tuple(names.index(name) for name in witness.solved)
    if len(set(solved)) != len(plant.states):
        raise Rejected(
            f"the numbers of unknowns of the equilibrium ({len(set(solved))}) and of states "
            f"({len(plant.states)}) differ"
        )
    equilibrium = equilibrium_near(plant, np.array(list(stated.values())), solved)
    check_near(equilibrium, plant, stated, "the stated equilibrium")
    check_near(equilibrium, plant, {**plant.trim, **plant.inputs}, "the trim")
    counts = []
    for piece, most in zip(statement.pieces, witness.boxes, strict=True):
        inequality = CostInequality(plant, equilibrium, piece, statement.Q, statement.R)
        counts.append(inequality.proved(most, progress))
    return tuple(counts)
