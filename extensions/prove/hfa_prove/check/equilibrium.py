"""Enclosure of the equilibrium of a closed loop."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from flint import arb, arb_mat

from hfa_prove.enclosure.ball_function import BallFunction
from hfa_prove.enclosure.balls import exact, hull, matrix, norm
from hfa_prove.enclosure.slopes import Intervals, jacobian
from hfa_prove.fields import Rejected
from hfa_prove.statements.loop import Loop
from hfa_prove.statements.plant import SAME_TRIM

#: Number of Newton steps.
_STEPS = 20
#: Largest number of doublings of the radius of the equilibrium.
_DOUBLINGS = 30
_NOT_ENCLOSED = (
    "no equilibrium is enclosed near the trim: it does not exist, the rates have a kink there, or "
    "an input is at its limit"
)


@dataclass(frozen=True, eq=False)
class Equilibrium:
    """Enclosure of an equilibrium.

    The box x ± radius of states contains exactly one equilibrium.

    x: center, (n,)
    radius: half-widths, (n,)
    """

    x: np.ndarray
    radius: np.ndarray


def equilibrium_near(loop: Loop, x: np.ndarray) -> Equilibrium:
    """Return an enclosure of an equilibrium near x.

    Newton's method in doubles is followed by Krawczyk's test (`check_root`) of the rates in balls
    and of the Jacobian in doubles, which contains Clarke's generalized gradients.

    x: first values of the states, (n,)

    Raises Rejected if no equilibrium is proved, or Undecided if a comparison is not decided at it.
    """
    program = loop.program
    point = np.array(x, dtype=float)
    still = np.zeros_like(point)
    step = np.zeros_like(point)
    for _ in range(_STEPS):
        at = jacobian(program, Intervals(point, still))
        if not (at.values.is_bounded and at.slopes.is_bounded):
            raise Rejected(_NOT_ENCLOSED)
        try:
            step = np.linalg.solve(at.slopes.middle, at.values.middle)
        except np.linalg.LinAlgError:
            break
        point -= step
    exact_point = [exact(value) for value in point.tolist()]
    (rates,) = BallFunction(loop.rate_function, loop.model.name)(exact_point)
    column = arb_mat([[rate] for rate in rates])
    radius = 2.0 * np.abs(step) + 1e-14 * (np.abs(point) + loop.nominal)
    for _ in range(_DOUBLINGS):
        around = jacobian(program, Intervals(point, radius)).slopes
        if not around.is_bounded:
            break
        J = hull(around.low, around.high)
        try:
            check_root(column, J, [exact(each) for each in radius.tolist()])
        except ZeroDivisionError as error:
            raise Rejected(
                "no equilibrium is enclosed near the trim: the Jacobian is singular"
            ) from error
        except Rejected:
            radius = 2.0 * radius
            continue
        return Equilibrium(point, radius)
    raise Rejected(_NOT_ENCLOSED)


def check_near(at: Equilibrium, loop: Loop, stated: Mapping[str, float]) -> None:
    """Raise Rejected unless an enclosed equilibrium is within `SAME_TRIM` nominal values of the
    stated one, state -> value.
    """
    distances = np.abs(at.x - np.array(list(stated.values()))) + at.radius
    for name, distance, nominal in zip(stated, distances, loop.nominal, strict=True):
        if not distance <= SAME_TRIM * nominal:
            raise Rejected(f"{name} at the equilibrium differs from the stated one")


def check_root(residual: arb_mat, J: arb_mat, radii: list[arb]) -> None:
    """Prove that F has exactly one root w with |w_i - x̂_i| <= r_i, by Krawczyk's test.

    residual: F at x̂, a column (n, 1)
    J: Jacobian F' for |w_i - x̂_i| <= r_i, (n, n)
    radii: radii r_i

    Raises Rejected if the test does not prove the root. Raises ZeroDivisionError if the midpoint of
    J is singular.
    """
    n = len(radii)
    C = J.mid().inv().mid()
    step = C * residual
    slope = matrix(np.eye(n)) - C * J
    distance = norm(step[i, 0] / radii[i] for i in range(n))
    contraction = norm(slope[i, j] * radii[j] / radii[i] for i in range(n) for j in range(n))
    if not distance + contraction < 1:
        raise Rejected("a root of the equations is not proved to exist")
