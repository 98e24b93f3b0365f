"""Slopes of the rates to both sides of a point, and their means in A and B at a kink."""

from __future__ import annotations

import numpy as np

from hfa_aircraft.model import Model
from trim.linear.switches import STEP, rates_of, steps_of

#: How far slopes may differ, of 1 + |derivative|, in scaled units.
_APART = 1e-4
#: As a share of that: a difference in a column where another entry is at a kink.
_FELT = 1e-2


def slopes_around(model: Model, z: np.ndarray, p: np.ndarray, columns: np.ndarray) -> np.ndarray:
    """Slopes of the rates between seven places along some states and inputs, (N, 6, n, columns).

    z: (N, n + m), the states and inputs.
    columns: numbers of those that are moved.
    The places lie -3, ..., 3 steps away.
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


def correct(
    model: Model, slopes: np.ndarray, jacobian: np.ndarray, columns: np.ndarray
) -> tuple[str, ...]:
    """Put the means of both slopes into the entries of (n, n + m) `jacobian` at a kink; a sentence
    for each, and for each that the rate jumps over.

    slopes: (6, n, columns), of `slopes_around`. They are extrapolated from where they are clear of
        a kink within a step, so that the mean is right for a trim that hits a knot up to rounding.
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
    # Across a kink the two middle slopes lie between those to the sides, or are mixed of them.
    across = np.abs(slopes[2] + slopes[3] - below - above)
    jumps = smooth_below & smooth_above & (across > 2 * np.abs(above - below) + allowed)
    kinks = smooth_below & smooth_above & differs & ~jumps
    # What one rate feels of a kink the others do too, even where it is small to them.
    felt = np.abs(above - below) > _FELT * allowed
    kinks |= kinks.any(axis=0) & smooth_below & smooth_above & felt & ~jumps
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
