"""Kinks of the equations: points at which the slopes on both sides differ.

A kink is the knot of a table, or the switching point of |x|, min, max, sign or a comparison. At a
kink, the affected entries of A and B are the means of the slopes on both sides.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from hfa_aircraft.linearization import Linearization
from hfa_aircraft.model import Model
from trim.linear.switches import near_switches


class Smoothed(NamedTuple):
    """A and B at N points, with mean slopes at kinks.

    A: (N, n, n)
    B: (N, n, m)
    notes: index of a point -> a sentence for each entry of A or B at a kink or a jump
    """

    A: np.ndarray
    B: np.ndarray
    notes: dict[int, tuple[str, ...]]


def with_means_at_kinks(
    model: Model, x: np.ndarray, u: np.ndarray, p: np.ndarray, A: np.ndarray, B: np.ndarray
) -> Smoothed:
    """Return A and B at N points, with the mean of the slopes on both sides in each entry at a
    kink.

    x: (N, n), states
    u: (N, m), inputs
    p: (N, k), parameters
    A: (N, n, n), derivatives of the rates with respect to the states
    B: (N, n, m), derivatives of the rates with respect to the inputs

    An entry is at a kink if the finite-difference slopes are constant on each side, but differ from
    the derivative on at least one side. If the rate itself jumps, the entry is unchanged and gets a
    note. Points without a trim (nan) are skipped.
    """
    near, columns = near_switches(model, x, u, p)
    if not near.size:
        return Smoothed(A, B, {})
    from trim.linear.slopes import correct, slopes_around

    jacobian = np.concatenate([A, B], axis=2)
    z = np.concatenate([x[near], u[near]], axis=1)
    notes = {}
    around = slopes_around(model, z, p[near], columns)
    for place, (point, slopes) in enumerate(zip(near.tolist(), around, strict=True)):
        words = correct(model, z[place], p[point], slopes, jacobian[point], columns)
        if words:
            notes[point] = words
    n = len(model.states)
    return Smoothed(jacobian[:, :, :n], jacobian[:, :, n:], notes)


def linearization_at(
    model: Model,
    x: np.ndarray,
    u: np.ndarray,
    outputs: Sequence[str] = (),
    disturbances: Sequence[str] = (),
) -> tuple[Linearization, tuple[str, ...]]:
    """Return the derivatives of a model at a point, with mean slopes at kinks, and notes on the
    kinks.

    x: (n,), state
    u: (m,), input
    outputs, disturbances: names of outputs and disturbances

    Raises BadInputError and FloatingPointError as `Model.at` does.
    """
    exact = model.at(x, u, outputs, disturbances)
    X, U = (np.asarray(vector, dtype=float)[None] for vector in (x, u))
    smoothed = with_means_at_kinks(model, X, U, model.p[None], exact.A[None], exact.B[None])
    if not smoothed.notes:
        return exact, ()
    return exact._replace(A=smoothed.A[0], B=smoothed.B[0]), smoothed.notes[0]
