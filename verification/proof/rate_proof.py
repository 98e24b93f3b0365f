"""How fast the dihedral may move: a Lyapunov function of it, proved to decrease at every angle and rate."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np

from controller.game.zero_sum import published_game
from controller.policy.gain_table import GainTable
from hfa_model.support.errors import NoSolutionError
from hfa_model.vectors import LINEAR_STATES
from trim.linear.linearize import linearize
from trim.point.solve import find_operating_point
from verification.balls.ball_function import Undecided
from verification.balls.balls import doubles, exact, is_positive_definite, map_entries, matrix, symmetric
from verification.balls.steady_flights import Family
from verification.balls.taylor import DihedralBox, TaylorForm
from verification.balls.trim_branch import ModelForms, TrimBranch
from verification.proof.scheduled_loop import closed_loop, segments
from verification.proof.stated_model import StatedModel, stated
from verification.riccati.gare import solve_game

#: Largest distance between two angles at which P is given, deg; a loop with memory changes faster.
_STEP, _STEP_WITH_MEMORY = 0.5, 0.125
#: Parts of the rate that points suggest, tried until one is proved on the whole interval.
_SHARES = (0.95, 0.9, 0.8, 0.6, 0.4, 0.2)
#: Narrower boxes, deg, are not tried.
_NARROWEST = 2.0**-6


class MotionBox(NamedTuple):
    """A box on which V is proved to decrease, its trims, and the coordinates, (n, n), in which it is proved."""

    box: DihedralBox
    model: StatedModel
    turn: np.ndarray


@dataclass(frozen=True, eq=False)
class RateProof:
    """The closed loop is stable for every motion of η in the interval with |η'| <= rate, deg/s; 0 when open.

    dihedral_deg: (G,), P: (G, n, n): V = ζ'P(η)ζ with P linear between these angles decreases on every such motion.
    """

    rate: float
    dihedral_deg: np.ndarray
    P: np.ndarray
    boxes: tuple[MotionBox, ...] = ()


@dataclass(frozen=True, eq=False)
class _Piece:
    """Between two neighbouring angles: the loop, and P = value + slope τ (1/deg) about the middle of the box."""

    loop: TaylorForm
    errors: list[Any]
    value: Any
    slope: Any

    def decrease(self) -> TaylorForm:
        """-(A_c'P + P A_c), without what the motion and the errors of the parameters add."""
        half = self.loop.map(lambda each: -each.transpose()).times_affine(self.value, self.slope)
        return half + half.map(lambda each: each.transpose())

    def decreases(self, rate: float) -> np.ndarray | None:
        """Coordinates in which -dV/dt is proved positive definite at both signs of the rate; None when it is not."""
        form = self.decrease()
        try:
            turn = np.linalg.inv(np.linalg.cholesky(doubles(form.coefficients[0]))).T
        except np.linalg.LinAlgError:
            return None
        T = matrix(turn)
        turned, P, motion = T.transpose(), self.value + symmetric(form.radius) * self.slope, exact(rate) * self.slope
        rest = 0 * motion
        for each in self.errors:
            half = P * each
            rest += map_entries(symmetric, turned * (half + half.transpose()) * T)
        proved = all(
            is_positive_definite(turned * (corner + sign * motion) * T + rest)
            for corner in form.corners()
            for sign in (1, -1)
        )
        return turn if proved else None


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

    P is given at some angles and linear between: V is continuous, and its derivative is the above where η is inside a
    piece. It is the game's for gains of the states, that of `_loop_P` for a loop with memory. changes: of the
    published game that gives P.
    """
    branch = TrimBranch(family)
    memory = table.K.shape[-1] > len(LINEAR_STATES)
    angles = _angles(segments(table, low, high), _STEP_WITH_MEMORY if memory else _STEP)
    P = np.array(
        [
            _loop_P(_loop_at(branch, table, angle)) if memory else _game_P(family, angle, changes or {})
            for angle in angles
        ]
    )
    boxes = [DihedralBox(a, b) for a, b in pairwise(angles)]

    def piece(index: int, box: DihedralBox) -> tuple[ModelForms, _Piece]:
        forms = branch.forms(box)
        first, width = exact(angles[index]), exact(angles[index + 1]) - exact(angles[index])
        rise = (matrix(P[index + 1]) - matrix(P[index])) * (1 / width)
        value = matrix(P[index]) + (box.middle - first) * rise
        return forms, _Piece(*closed_loop(table, forms), value, rise)

    def proved_boxes(rate: float) -> tuple[MotionBox, ...]:
        """The boxes on which the rate is proved; none when it is not on all of them."""
        found: list[MotionBox] = []
        for index, whole in enumerate(boxes):
            waiting = [whole]
            while waiting:
                box, turn = waiting.pop(), None
                try:
                    forms, own = piece(index, box)
                    turn = own.decreases(rate)
                except Undecided:
                    pass
                if turn is not None:
                    found.append(MotionBox(box, stated(forms, branch.free), turn))
                elif box.high - box.low > _NARROWEST:
                    waiting += box.halves()[::-1]
                else:
                    return ()
            if progress is not None:
                progress(index + 1, len(boxes))
        return tuple(found)

    if not all(is_positive_definite(matrix(each)) for each in P):
        return RateProof(0.0, np.array(angles), P)
    suggested = min(_suggested(piece(index, _narrow(box))[1]) for index, box in enumerate(boxes))
    for share in _SHARES if suggested > 0.0 else ():
        found = proved_boxes(share * suggested)
        if found:
            return RateProof(share * suggested, np.array(angles), P, found)
    return RateProof(0.0, np.array(angles), P)


def _angles(segments: list[DihedralBox], step: float) -> list[float]:
    parts = [np.linspace(s.low, s.high, math.ceil((s.high - s.low) / step) + 1)[:-1] for s in segments]
    return [*np.concatenate(parts).tolist(), segments[-1].high]


def _game_P(family: Family, degrees: float, changes: Mapping[str, Any]) -> np.ndarray:
    model = linearize(family.aircraft, find_operating_point(family.aircraft, family.condition(degrees)))
    return solve_game(published_game(model.A, model.B, **changes)).P


def _loop_at(branch: TrimBranch, table: GainTable, degrees: float) -> np.ndarray:
    """The loop with memory at an angle, in doubles."""
    end = min(degrees, float(table.dihedral_deg[-1]) - _NARROWEST)
    return doubles(closed_loop(table, branch.forms(DihedralBox(end, end + _NARROWEST)))[0].coefficients[0])


def _loop_P(loop: np.ndarray) -> np.ndarray:
    """A_c'P + P A_c = -T⁻ᵀ T⁻¹ with eigenvectors T of norm 1: it changes as smoothly as distinct modes do."""
    from scipy.linalg import solve_continuous_lyapunov

    try:
        inverse = np.linalg.inv(np.linalg.eig(loop)[1])
    except np.linalg.LinAlgError as error:
        raise NoSolutionError("the loop has dependent modes; no rate is proved for it, leave --rate out") from error
    found = solve_continuous_lyapunov(loop.T, -(inverse.conj().T @ inverse).real)
    return np.asarray((found + found.T) / 2)


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
