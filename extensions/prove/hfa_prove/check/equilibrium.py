"""Enclosure of the equilibrium of an aircraft."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np
from flint import arb, arb_mat

from hfa_prove.fields import Rejected
from hfa_prove.statements.plant import SAME_TRIM, Plant
from verification.enclosure.balls import matrix, norm
from verification.enclosure.program import Program
from verification.enclosure.slopes import Intervals, jacobian

#: Largest error of a few sums and products of doubles, relative to the sizes of the terms.
ROUNDING = 1e-12
#: Number of Newton steps.
_STEPS = 20
#: Largest number of doublings of the radius of the equilibrium.
_DOUBLINGS = 30


@dataclass(frozen=True, eq=False)
class Equilibrium:
    """Enclosure of an equilibrium.

    The box x ± radius contains exactly one equilibrium. The arrays hold the states, or the states
    and inputs.

    x: center, (n,) or (n + m,)
    radius: half-widths, 0 for entries that are not unknowns
    """

    x: np.ndarray
    radius: np.ndarray


def zero_near(
    program: Program, x: np.ndarray, nominal: np.ndarray, solved: Sequence[int]
) -> Equilibrium:
    """Return an enclosure of a zero of a program F near x.

    The enclosure is proved by Krawczyk's test (1969): |C F(x)| + |1 - C F'| r < r with a radius r,
    at the point x to which Newton's method converges. C is an approximate inverse of F'.

    x: first values of the inputs of the program, (k,)
    nominal: nominal values of the inputs, (k,)
    solved: indices of the unknown inputs, as many as the program has outputs

    Raises Rejected if no zero is proved.
    """
    point = np.array(x, dtype=float)
    columns = list(solved)
    none = np.zeros_like(point)
    for _ in range(_STEPS):
        at = jacobian(program, Intervals(point, none))
        slopes = at.slopes.middle[:, columns]
        if not np.all(np.isfinite(slopes)):
            break
        try:
            step = np.linalg.solve(slopes, at.values.middle)
        except np.linalg.LinAlgError:
            break
        point[columns] -= step
    at = jacobian(program, Intervals(point, none))
    try:
        C = np.linalg.inv(at.slopes.middle[:, columns])
    except np.linalg.LinAlgError as error:
        raise Rejected(
            "no equilibrium is enclosed near the trim: the Jacobian is singular"
        ) from error
    radius = np.zeros_like(point)
    moved = _moved(C, at.values)
    radius[columns] = 2.0 * moved + 1e-14 * (np.abs(point) + nominal)[columns]
    for _ in range(_DOUBLINGS):
        J = jacobian(program, Intervals(point, radius)).slopes
        J = Intervals(J.middle[:, columns], J.radius[:, columns])
        spread = np.abs(np.eye(len(C)) - C @ J.middle) + np.abs(C) @ J.radius
        spread += ROUNDING * (np.abs(C) @ np.abs(J.middle))
        reach = (moved + spread @ radius[columns]) * (1.0 + ROUNDING)
        if np.all(reach < radius[columns]):
            return Equilibrium(point, radius)
        radius = 2.0 * radius
    raise Rejected("no equilibrium is enclosed near the trim")


def _moved(C: np.ndarray, residual: Intervals) -> np.ndarray:
    sizes = np.abs(residual.middle) + residual.radius
    exact_part = np.abs(C @ residual.middle) + np.abs(C) @ residual.radius
    return np.asarray(exact_part + ROUNDING * (np.abs(C) @ sizes))


def check_near(at: Equilibrium, stated: np.ndarray, nominal: np.ndarray, what: str) -> None:
    """Raise Rejected unless an enclosed equilibrium is near stated values.

    The largest permitted difference is `SAME_TRIM` nominal values.

    at: enclosure of the equilibrium
    stated: stated values, in the order of the enclosure
    nominal: nominal values, in the same order
    what: name of the stated values in the message
    """
    distance = np.abs(at.x - stated) + at.radius
    if not np.all(distance <= SAME_TRIM * nominal):
        raise Rejected(f"the equilibrium differs from {what}")


def open_rates(plant: Plant) -> Program:
    """Return the program (x, u) -> rates of the moving states, for a plant without feedback."""
    n = len(plant.states)
    both = ca.SX.sym("x", n + len(plant.inputs))
    rates, _ = plant.rates_at(both[:n], both[n:])
    return Program(ca.Function("rates", [both], [rates]), plant.model.name)


def root_offsets(residual: arb_mat, J: arb_mat, radii: list[arb]) -> arb_mat:
    """Return an enclosure of w - x̂, a column (n, 1), for the only root w of F near x̂.

    residual: F at x̂, a column (n, 1)
    J: Jacobian F' for |w_i - x̂_i| <= r_i, (n, n)
    radii: radii r_i

    Raises Rejected if Krawczyk's test does not prove a root. Raises ZeroDivisionError if the
    midpoint of J is singular.
    """
    n = len(radii)
    C = J.mid().inv().mid()
    step = C * residual
    slope = matrix(np.eye(n)) - C * J
    distance = norm(step[i, 0] / radii[i] for i in range(n))
    scaled = (slope[i, j] * radii[j] / radii[i] for i in range(n) for j in range(n))
    contraction = norm(scaled)
    if not distance + contraction < 1:
        raise Rejected("a root of the equations is not proved to exist")
    rows = [[arb(0, 1) * contraction * radius - step[i, 0]] for i, radius in enumerate(radii)]
    return arb_mat(rows)
