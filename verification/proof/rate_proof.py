"""How fast the scheduling variable may move: a Lyapunov function of it, proved to decrease at every place and rate."""

from __future__ import annotations

import math
from functools import partial
from itertools import pairwise

import numpy as np
from flint import arb_mat

from hfa_support.progress import Progress, told
from verification.arithmetic.ball_function import Undecided
from verification.arithmetic.balls import doubles, exact, is_positive_definite, matrix
from verification.arithmetic.taylor_model import TaylorModel
from verification.enclosures.eigenvalue_signs import roomy
from verification.enclosures.place_box import PlaceBox, bisected
from verification.enclosures.trim_branch import TrimBranch
from verification.proof.certificate import Content, proved_box
from verification.proof.scheduled_loop import LoopTable, closed_loop, segments

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


def proved_motion(
    branch: TrimBranch, table: LoopTable, low: float, high: float, *, progress: Progress | None = None
) -> tuple[Content, list[Content]]:
    """place_rate and lyapunov (places, P) of a statement, and the boxes that prove it; no boxes when none are found.

    V = ζ'P(η)ζ decreases on every motion with |η'| <= place_rate: V' = z'(A_c'P + P A_c + η' dP/dη) z < 0 for both
    signs of η' = ± rate, hence for all rates between. P solves A_c'P + P A_c = -W at some places, with one W for all,
    and is linear between: V is continuous, its derivative is the above where η is inside a piece, and P is as smooth
    as A_c, whatever its modes do.
    """
    family, places = branch.family, list[float]()
    for part in segments(table, low, high):
        pieces = math.ceil((part.high - part.low) / (_STEP * family.step))
        places += np.linspace(part.low, part.high, pieces + 1)[:-1].tolist()
    places.append(high)
    boxes = [PlaceBox(a, b) for a, b in pairwise(places)]
    try:
        loops = [closed_loop(table, branch.forms(box)) for box in boxes]
    except Undecided:
        return {}, []
    scales = [1.0 / float(box.radius) for box in boxes]
    points = [(doubles(each.parts[0]), doubles(each.parts[1]) * s) for each, s in zip(loops, scales, strict=True)]
    if max(np.linalg.eigvals(A).real.max() for A, _ in points) >= 0.0:
        return {}, []
    suggested, W = _weight([*points[::_STRIDE], points[-1]])
    last = loops[-1].parts
    ends = [doubles(c0 - c1 + c2) for c0, c1, c2, *_ in (loop.parts for loop in loops)]
    ends += [doubles(last[0] + last[1] + last[2])]
    P = [_lyapunov(A, W) for A in ends]

    def prove(rate: float, index: int, box: PlaceBox) -> Content | None:
        forms = branch.forms(box)
        first, width = exact(places[index]), exact(places[index + 1]) - exact(places[index])
        rise = (matrix(P[index + 1]) - matrix(P[index])) * (1 / width)
        value = matrix(P[index]) + (box.middle - first) * rise
        turn = _decreases(closed_loop(table, forms), TaylorModel(value, rise * box.radius), exact(rate) * rise)
        return None if turn is None else proved_box(forms, family, turn=turn)

    def proved(rate: float) -> list[Content]:
        """The boxes on which the rate is proved; none when it is not on all of them."""
        found: list[Content] = []
        for index, whole in told(list(enumerate(boxes)), progress):
            for _, box in bisected([whole], partial(prove, rate, index), _NARROWEST * family.step):
                if box is None:
                    return []
                found.append(box)
        return found

    for share in _SHARES if all(is_positive_definite(matrix(each)) for each in P) else ():
        unit = math.floor(math.log10(share * suggested)) - 1  # two digits, rounded down
        rate = float(f"{math.floor(share * suggested / 10.0**unit)}e{unit}")
        if found := proved(rate):
            return {"place_rate": rate, "lyapunov": {"places": places, "P": P}}, found
    return {}, []


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
