"""Slopes of the rates on both sides of a kink, and their means as entries of A and B."""

from __future__ import annotations

from functools import lru_cache

import casadi as ca
import numpy as np

from hfa_aircraft.layout import Layout
from hfa_aircraft.model import Model
from trim.linear.switches import STEP, rates_of, steps_of

#: Largest difference of equal slopes, as a fraction of 1 + |derivative|, in scaled units.
_APART = 1e-4
#: Fraction of this difference that is significant in a column with a kink in another entry.
_FELT = 1e-2


def slopes_around(model: Model, z: np.ndarray, p: np.ndarray, columns: np.ndarray) -> np.ndarray:
    """Return the slopes of the rates around N points along some states and inputs, (N, 6, n,
    columns).

    The six slopes are those between adjacent points at -3, -2, ..., 3 finite-difference steps.

    z: (N, n + m), states and inputs
    p: (N, k), parameters
    columns: indices of the states and inputs that are varied
    """
    n = len(model.states)
    count, size = z.shape
    steps = np.array(steps_of(model))
    offsets = np.arange(-3, 4)[:, None, None] * np.diag(steps)[columns]
    places = (z[:, None, None, :] + offsets).reshape(-1, size)
    parameters = np.repeat(p, 7 * len(columns), axis=0)
    rates = np.array(rates_of(model.layout)(places[:, :n].T, places[:, n:].T, parameters.T))
    by_place = rates.reshape(n, count, 7, len(columns)).transpose(1, 2, 0, 3)
    return np.diff(by_place, axis=1) / steps[columns]


def exact_sides(
    model: Model, z: np.ndarray, p: np.ndarray, columns: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return the exact derivatives of the rates just below and just above a kink, (n, columns)
    each.

    The derivatives are extrapolated by 15 J(2 h) - 24 J(2.5 h) + 10 J(3 h) from exact derivatives J
    at multiples of a step h from the point. A kink may be up to one step from the point.
    The error is of the order of h³ J'''.

    z: (n + m,), state and input
    p: (k,), parameters
    columns: indices of the states and inputs at a kink
    """
    n = len(model.states)
    steps = np.array(steps_of(model))
    jacobian = _jacobian_of(model.layout)

    def extrapolated(column: int, step: float) -> np.ndarray:
        """Return the derivatives with respect to one state or input on one side of the point, (n,).

        column: index of the state or input
        step: step away from the point, whose sign selects the side
        """
        slopes = []
        for count in (2.0, 2.5, 3.0):
            place = z.copy()
            place[column] += count * step
            slopes.append(np.array(jacobian(place[:n], place[n:], p))[:, column])
        return 15.0 * slopes[0] - 24.0 * slopes[1] + 10.0 * slopes[2]

    below = [extrapolated(column, -steps[column]) for column in columns.tolist()]
    above = [extrapolated(column, steps[column]) for column in columns.tolist()]
    return np.stack(below, axis=1), np.stack(above, axis=1)


@lru_cache(maxsize=16)
def _jacobian_of(layout: Layout) -> ca.Function:
    """Return the Function (x, u, p) -> Jacobian of the rates by (x, u), (n, n + m)."""
    rates = rates_of(layout)
    x, u, p = rates.sx_in()
    derivatives = ca.jacobian(rates(x, u, p), ca.vertcat(x, u))
    return ca.Function("slopes", [x, u, p], [derivatives])


def correct(
    model: Model,
    z: np.ndarray,
    p: np.ndarray,
    slopes: np.ndarray,
    jacobian: np.ndarray,
    columns: np.ndarray,
) -> tuple[str, ...]:
    """Replace the entries of a Jacobian at a kink by the means of both slopes, and return notes.

    Each note is a sentence on one entry at a kink. An entry at which the rate jumps also gets a
    note, but is not replaced.

    z: (n + m,), state and input
    p: (k,), parameters
    slopes: (6, n, columns), from `slopes_around`, which distinguish a kink from a jump
    jacobian: (n, n + m), changed in place
    columns: indices of the states and inputs at a kink
    """
    n = len(model.states)
    names = (*model.states, *model.inputs)
    derivative = jacobian[:, columns]
    below = 2.5 * slopes[1] - 1.5 * slopes[0]
    above = 2.5 * slopes[4] - 1.5 * slopes[5]
    nominal = np.array(steps_of(model))[columns] / STEP
    scale = nominal / np.array([[model.rate_scale(name)] for name in model.states])
    allowed = _APART * (1 + np.abs(derivative) * scale) / scale
    smooth_below = np.abs(slopes[1] - slopes[0]) <= allowed
    smooth_above = np.abs(slopes[5] - slopes[4]) <= allowed
    differs = np.maximum(np.abs(below - derivative), np.abs(above - derivative)) > allowed
    # Across a kink, the two middle slopes are between the outer ones, or mixtures of them.
    across = np.abs(slopes[2] + slopes[3] - below - above)
    jumps = smooth_below & smooth_above & (across > 2 * np.abs(above - below) + allowed)
    kinks = smooth_below & smooth_above & differs & ~jumps
    # A kink in one rate is also one in other rates, even if its effect on them is small.
    felt = np.abs(above - below) > _FELT * allowed
    kinks |= kinks.any(axis=0) & smooth_below & smooth_above & felt & ~jumps
    if kinks.any():
        below, above = exact_sides(model, z, p, columns)
    notes = []
    for j, i in np.argwhere((kinks | jumps).T).tolist():
        column = int(columns[j])
        entry = f"{'A' if column < n else 'B'}({names[i]}, {names[column]})"
        if jumps[i, j]:
            notes.append(
                f"jump: the rate of {names[i]} jumps as {names[column]} passes its value; {entry} "
                f"is {jacobian[i, column] + 0.0:.5g}, without the jump"
            )
        else:
            jacobian[i, column] = (below[i, j] + above[i, j]) / 2
            notes.append(
                f"kink: {entry} is {jacobian[i, column] + 0.0:.5g}, the mean of the slopes below "
                f"and above, {below[i, j]:.5g} and {above[i, j]:.5g}"
            )
    return tuple(notes)
