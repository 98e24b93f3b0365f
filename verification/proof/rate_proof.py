"""How fast the scheduling variable may move: a Lyapunov function of it, proved to decrease at every place and rate."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import partial
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from flint import arb_mat

from controller.policy.gain_table import GainTable
from hfa_support.progress import Progress, told
from hfa_support.reporting.fields import Shown
from verification.arithmetic.ball_function import Undecided
from verification.arithmetic.balls import doubles, exact, is_positive_definite, matrix
from verification.arithmetic.taylor_model import TaylorModel
from verification.enclosures.eigenvalue_signs import roomy
from verification.enclosures.place_box import PlaceBox, bisected
from verification.enclosures.trim_branch import Family, TrimBranch
from verification.proof.scheduled_loop import LoopTable, closed_loop, segments
from verification.proof.stated_model import StatedModel, stated

#: Largest distance between two places at which P is given, in steps of the family.
_STEP = 0.125
#: Parts of the rate that points suggest, tried until one is proved on the whole interval.
_SHARES = (0.95, 0.9, 0.8, 0.6, 0.4, 0.2)
#: Narrower boxes are not tried, likewise.
_NARROWEST = 2.0**-6
#: Steps of the search for W, which goes from place to place at most this many of them apart ..
_TRIES, _STRIDE = 16, 8
#: .. and how much the place that allows least counts.
_POWER = 8

Rows = np.ndarray


class MotionBox(NamedTuple):
    """A box on which V is proved to decrease, its trims, and the coordinates, (n, n), in which it is proved."""

    box: PlaceBox
    model: StatedModel
    turn: np.ndarray


@dataclass(frozen=True, eq=False, repr=False)
class RateProof(Shown):
    """The closed loop is stable for every motion of η in the interval with |η'| <= rate, per second; 0 when open.

    places: (G,), P: (G, n, n): V = ζ'P(η)ζ with P linear between these places decreases on every such motion.
    """

    rate: float
    places: np.ndarray
    P: np.ndarray
    boxes: tuple[MotionBox, ...] = ()


def _decreases(loop: TaylorModel, P: TaylorModel, motion: arb_mat) -> np.ndarray | None:
    """Coordinates in which -(A_c'P + P A_c ± motion) is proved positive definite; None when it is not."""
    half = -(loop.transpose() * P)
    decrease = half + half.transpose()
    try:
        turn = np.linalg.inv(np.linalg.cholesky(doubles(decrease.parts[0]))).T
    except np.linalg.LinAlgError:
        return None
    T = matrix(turn)
    turned, moved = decrease.map(lambda part: T.transpose() * part * T), T.transpose() * motion * T
    corners = [each for corner in roomy(turned).corners() for each in (corner + moved, corner - moved)]
    return turn if all(map(is_positive_definite, corners)) else None


def prove_rate(
    family: Family,
    table: GainTable | LoopTable,
    low: float,
    high: float,
    *,
    progress: Progress | None = None,
) -> RateProof:
    """V' = z'(A_c'P + P A_c + η' dP/dη) z < 0 for both signs of η' = ± rate, hence for all rates between.

    P solves A_c'P + P A_c = -W at some places, with one W for all, and is linear between: V is continuous, its
    derivative is the above where η is inside a piece, and P is as smooth as A_c, whatever its modes do.
    """
    branch, table = TrimBranch(family), LoopTable.of(table)
    places = _places(segments(table, low, high), _STEP * family.step)
    boxes = [PlaceBox(a, b) for a, b in pairwise(places)]
    nothing = RateProof(0.0, np.array(places), np.zeros(0))
    try:
        loops = [closed_loop(table, branch.forms(box)) for box in boxes]
    except Undecided:
        return nothing
    scales = [1.0 / float(box.radius) for box in boxes]
    points = [(doubles(each.parts[0]), doubles(each.parts[1]) * s) for each, s in zip(loops, scales, strict=True)]
    if max(np.linalg.eigvals(A).real.max() for A, _ in points) >= 0.0:
        return nothing
    suggested, W = _weight([*points[::_STRIDE], points[-1]])
    last = loops[-1].parts
    ends = [doubles(c0 - c1 + c2) for c0, c1, c2, *_ in (loop.parts for loop in loops)]
    ends += [doubles(last[0] + last[1] + last[2])]
    P = np.array([_lyapunov(A, W) for A in ends])

    def proved_box(rate: float, index: int, box: PlaceBox) -> MotionBox | None:
        forms = branch.forms(box)
        first, width = exact(places[index]), exact(places[index + 1]) - exact(places[index])
        rise = (matrix(P[index + 1]) - matrix(P[index])) * (1 / width)
        value = matrix(P[index]) + (box.middle - first) * rise
        turn = _decreases(closed_loop(table, forms), TaylorModel(value, rise * box.radius), exact(rate) * rise)
        return None if turn is None else MotionBox(box, stated(forms, family), turn)

    def proved_boxes(rate: float) -> tuple[MotionBox, ...]:
        """The boxes on which the rate is proved; none when it is not on all of them."""
        found: list[MotionBox] = []
        for index, whole in told(list(enumerate(boxes)), progress):
            for _, proved in bisected([whole], partial(proved_box, rate, index), _NARROWEST * family.step):
                if proved is None:
                    return ()
                found.append(proved)
        return tuple(found)

    if all(is_positive_definite(matrix(each)) for each in P):
        for share in _SHARES:
            rate = _two_digits(share * suggested)
            found = proved_boxes(rate)
            if found:
                return RateProof(rate, np.array(places), P, found)
    return nothing


def _two_digits(rate: float) -> float:
    """A rate, rounded down: what the search found beyond is not worth stating."""
    unit = math.floor(math.log10(rate)) - 1
    return float(f"{math.floor(rate / 10.0**unit)}e{unit}")


def _places(parts: list[PlaceBox], step: float) -> list[float]:
    """The ends of the parts, and between them places at most a step apart."""
    cuts = [np.linspace(s.low, s.high, math.ceil((s.high - s.low) / step) + 1)[:-1] for s in parts]
    return [*np.concatenate(cuts).tolist(), parts[-1].high]


def _lyapunov(A: Rows, W: Rows) -> Rows:
    """P of A'P + P A = -W."""
    from scipy.linalg import solve_continuous_lyapunov

    found = solve_continuous_lyapunov(A.T, -W)
    return np.asarray((found + found.T) / 2)


def _weight(points: list[tuple[Rows, Rows]]) -> tuple[float, Rows]:
    """The rate that W allows at all of the points A, dA/dη, and W > 0 which allows much.

    At a rate W + η' dP/dη > 0 is asked. W begins so that P is the identity in the modes of the middle point, and is
    then moved, step by step, towards Σ |dP/dη|^p, a sum over the points in units of W, where the largest counts most.
    """
    A = points[len(points) // 2][0]
    values, vectors = np.linalg.eig(A)
    best, W = (0.0, np.eye(len(A))), np.eye(len(A))
    try:
        inverse = np.linalg.inv(vectors)
        W = (inverse.conj().T @ (-values.real[:, None] * inverse)).real
        np.linalg.cholesky(W)
    except np.linalg.LinAlgError:  # dependent modes
        W = np.eye(len(A))
    for _ in range(_TRIES):
        try:
            root = np.linalg.cholesky(W)
        except np.linalg.LinAlgError:
            break
        inverse, total, largest = np.linalg.inv(root), np.zeros_like(W), 0.0
        for A, slope in points:
            half = _lyapunov(A, W) @ slope
            sizes, axes = np.linalg.eigh(inverse @ _lyapunov(A, half + half.T) @ inverse.T)
            largest = max(largest, float(np.abs(sizes).max()))
            total += (axes * np.abs(sizes) ** _POWER) @ axes.T
        best = max(best, (1.0 / largest, W), key=lambda each: each[0])
        sizes, axes = np.linalg.eigh(total)
        sizes = (sizes / sizes.max()).clip(0.0) ** (1.0 / _POWER)
        W = root @ ((axes * (1.0 + sizes)) @ axes.T) @ root.T / 2
    return best
