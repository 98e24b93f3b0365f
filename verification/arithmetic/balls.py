"""Balls of real numbers (python-flint, Arb): a midpoint and a radius that holds every rounding on the way.

Every value is an enclosure: what is computed with balls contains what exact arithmetic would give for any numbers in
the arguments. A comparison of balls is true only when it holds for all of their numbers.
Source: Johansson, Arb: efficient arbitrary-precision midpoint-radius interval arithmetic, IEEE Transactions on
Computers 66 (2017).
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
from flint import arb, arb_mat

#: Relative radius that holds the decimal from which a double was read, also by way of degrees: four units of 2^-53.
READING = 2.0**-51


def exact(value: float) -> arb:
    """The ball of radius 0 at a double."""
    return arb(float(value))


def as_read(value: float) -> arb:
    """A ball about a double that also holds the decimal, or the degrees, that it was read from."""
    return arb(float(value), abs(float(value)) * READING)


def interval(low: Any, high: Any) -> arb:
    """The ball that holds everything between two numbers or balls."""
    return arb(low).union(arb(high))


def symmetric(radius: Any) -> arb:
    """[-r, r] with r the largest absolute value of a number or ball."""
    bound = abs(arb(radius)).upper()
    return interval(-bound, bound)


def matrix(values: Any) -> arb_mat:
    """A matrix of doubles as exact balls; of decimals in strings as balls that hold them."""
    return arb_mat([[arb(entry) for entry in row] for row in np.asarray(values).tolist()])


def doubles(values: arb_mat) -> np.ndarray:
    """Midpoints rounded to doubles: for searching, never for proving."""
    return np.array([[float(entry.mid()) for entry in row] for row in values.tolist()])


def radii(values: arb_mat) -> np.ndarray:
    """Radii rounded to doubles: for searching, never for proving."""
    return np.array([[float(entry.rad()) for entry in row] for row in values.tolist()])


def inside(inner: Sequence[arb], outer: Sequence[arb]) -> bool:
    """Each ball lies in the interior of its partner, for certain."""
    return all(one.is_finite() and other.contains_interior(one) for one, other in zip(inner, outer, strict=True))


def norm(entries: Iterable[arb]) -> arb:
    """sqrt(Σ entry²): of a matrix the Frobenius norm."""
    known = list(entries)
    low, high = (sum((end(entry) ** 2 for entry in known), arb(0)) for end in (arb.abs_lower, arb.abs_upper))
    return low.sqrt().union(high.sqrt())


def pivots(values: arb_mat) -> list[arb] | None:
    """D of L D L' = M for every symmetric M in the matrix of balls; None when a pivot may be 0.

    The signs of D are those of the eigenvalues (Sylvester's law of inertia). Only the lower triangle is read.
    """
    rows = values.tolist()
    found = []
    for k in range(len(rows)):
        pivot = rows[k][k]
        if not (pivot > 0 or pivot < 0):
            return None
        found.append(pivot)
        column = [rows[i][k] for i in range(k + 1, len(rows))]
        shares = [entry / pivot for entry in column]
        for i in range(k + 1, len(rows)):
            for j in range(k + 1, i + 1):
                rows[i][j] = rows[i][j] - shares[i - k - 1] * column[j - k - 1]
    return found


def is_positive_definite(values: arb_mat) -> bool:
    """Every symmetric matrix in the matrix of balls is positive definite, for certain."""
    found = pivots(values)
    return found is not None and all(pivot > 0 for pivot in found)
