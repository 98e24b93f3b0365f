"""How fast the dihedral may move: a Lyapunov function of it, proved to decrease at every angle and rate."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np

from controller.game.zero_sum import published_game
from trim.linear.linearize import linearize
from trim.point.solve import find_operating_point
from verification.proof.ball_function import Undecided
from verification.proof.balls import doubles, exact, is_positive_definite, matrix
from verification.proof.gain_table import GainTable
from verification.proof.taylor import DihedralBox, TaylorForm
from verification.proof.trim_branch import Family, TrimBranch
from verification.riccati.gare import solve_game

#: Largest distance between two angles at which P is given, deg.
_STEP = 0.5
#: Parts of the rate that points suggest, tried until one is proved on the whole interval.
_SHARES = (0.95, 0.9, 0.8, 0.6, 0.4, 0.2)
#: Narrower boxes, deg, are not tried.
_NARROWEST = 2.0**-6


@dataclass(frozen=True, eq=False)
class RateProof:
    """z' = (A(η) - B(η) K(η)) z is stable for every motion of η in the interval with |η'| <= rate, deg/s; 0 when open.

    dihedral_deg: (G,), P: (G, 6, 6): V = z'P(η)z with P linear between these angles decreases on every such motion.
    """

    rate: float
    dihedral_deg: np.ndarray
    P: np.ndarray


@dataclass(frozen=True, eq=False)
class _Piece:
    """Between two neighbouring angles: the loop, and P = value + slope τ (1/deg) about the middle of the box."""

    loop: TaylorForm
    value: Any
    slope: Any

    def decrease(self) -> TaylorForm:
        """-(A_c'P + P A_c), without what the motion adds."""
        half = self.loop.map(lambda each: -each.transpose()).times_affine(self.value, self.slope)
        return half + half.map(lambda each: each.transpose())


def prove_rate(
    family: Family,
    table: GainTable,
    low: float,
    high: float,
    *,
    changes: Mapping[str, Any] | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> RateProof:
    """V' = z'(A_c'P + P A_c + η' dP/dη) z < 0 for both signs of η' = ± rate, hence for all rates between.

    P is the game's at some angles, linear between: V is continuous, and its derivative is the above where η is inside
    a piece. changes: of the published game that gives P.
    """
    branch = TrimBranch(family)
    angles = _angles(table.segments(low, high))
    P = np.array([_game_P(family, angle, changes or {}) for angle in angles])
    boxes = [DihedralBox(a, b) for a, b in pairwise(angles)]

    def piece(index: int, box: DihedralBox) -> _Piece:
        forms = branch.forms(box)
        constant, slope = table.affine_on(box)
        first, width = exact(angles[index]), exact(angles[index + 1]) - exact(angles[index])
        rise = (matrix(P[index + 1]) - matrix(P[index])) * (1 / width)
        value = matrix(P[index]) + (box.middle - first) * rise
        return _Piece(forms.A + forms.B.times_affine(-constant, -slope), value, rise)

    def rate_proved(rate: float) -> bool:
        for index, whole in enumerate(boxes):
            waiting = [whole]
            while waiting:
                box = waiting.pop()
                try:
                    done = _decreases(piece(index, box), rate)
                except Undecided:
                    done = False
                if not done and box.high - box.low <= _NARROWEST:
                    return False
                waiting += [] if done else box.halves()
            if progress is not None:
                progress(index + 1, len(boxes))
        return True

    if not all(is_positive_definite(matrix(each)) for each in P):
        return RateProof(0.0, np.array(angles), P)
    suggested = min(_suggested(piece(index, _narrow(box))) for index, box in enumerate(boxes))
    rates = [share * suggested for share in _SHARES if suggested > 0.0]
    return RateProof(next((rate for rate in rates if rate_proved(rate)), 0.0), np.array(angles), P)


def _angles(segments: list[DihedralBox]) -> list[float]:
    parts = [np.linspace(s.low, s.high, math.ceil((s.high - s.low) / _STEP) + 1)[:-1] for s in segments]
    return [*np.concatenate(parts).tolist(), segments[-1].high]


def _game_P(family: Family, degrees: float, changes: Mapping[str, Any]) -> np.ndarray:
    model = linearize(family.aircraft, find_operating_point(family.aircraft, family.condition(degrees)))
    return solve_game(published_game(model.A, model.B, **changes)).P


def _narrow(box: DihedralBox) -> DihedralBox:
    middle = float(box.middle)
    return DihedralBox(middle - _NARROWEST / 2, middle + _NARROWEST / 2)


def _suggested(piece: _Piece) -> float:
    """The rate at which the decrease at the middle becomes singular, in doubles; 0 when there is none."""
    decrease, slope = doubles(piece.decrease().coefficients[0]), doubles(piece.slope)
    try:
        turn = np.linalg.inv(np.linalg.cholesky(decrease))
    except np.linalg.LinAlgError:
        return 0.0
    return float(1.0 / np.abs(np.linalg.eigvalsh(turn @ slope @ turn.T)).max())


def _decreases(piece: _Piece, rate: float) -> bool:
    form = piece.decrease()
    try:
        T = matrix(np.linalg.inv(np.linalg.cholesky(doubles(form.coefficients[0]))).T)
    except np.linalg.LinAlgError:
        return False
    turned, motion = T.transpose(), exact(rate) * piece.slope
    return all(
        is_positive_definite(turned * (corner + sign * motion) * T) for corner in form.corners() for sign in (1, -1)
    )
