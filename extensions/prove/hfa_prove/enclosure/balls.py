"""Balls of real numbers (python-flint, Arb): a midpoint and a radius that includes all rounding.

A result contains the exact result for all numbers in the arguments. A comparison of balls is true
only if it is true for all of their numbers. Source: Johansson, Arb: efficient arbitrary-precision
midpoint-radius interval arithmetic, IEEE Transactions on Computers 66 (2017).
"""

from __future__ import annotations

from typing import Any

import numpy as np
from flint import arb, arb_mat

import hfa_prove.enclosure.precision  # noqa: F401  # sets the precision of balls

#: Relative radius about a double that contains the decimal from which it was read, also if it was
#: converted from degrees: four units of 2^-53.
READING = 2.0**-51


def exact(value: float) -> arb:
    """Return the ball of radius 0 whose midpoint is a double."""
    return arb(float(value))


def symmetric(radius: Any) -> arb:
    """Return [-r, r], with r an upper bound of the absolute value of a number or ball."""
    bound = abs(arb(radius)).upper()
    return (-bound).union(bound)


def matrix(values: Any) -> arb_mat:
    """Return a matrix of balls that contain given numbers.

    A ball is exact for a double. For a decimal number in a string, the ball encloses the number.
    """
    entries = np.asarray(values)
    rows, columns = entries.shape
    return arb_mat(rows, columns, [arb(entry) for entry in entries.ravel().tolist()])


def doubles(values: arb_mat) -> np.ndarray:
    """Return the midpoints of a matrix of balls as doubles, rounded to nearest."""
    return np.array([[float(entry.mid()) for entry in row] for row in values.tolist()])


def is_positive_definite(values: arb_mat) -> bool:
    """Return whether every symmetric matrix in a matrix of balls is proved positive definite.

    D of L D L' is positive then (Sylvester's law of inertia). Only the lower triangle is read.
    """
    rows = values.tolist()
    for k in range(len(rows)):
        pivot = rows[k][k]
        if not pivot > 0:
            return False
        for i in range(k + 1, len(rows)):
            share = rows[i][k] / pivot
            for j in range(k + 1, i + 1):
                rows[i][j] = rows[i][j] - share * rows[j][k]
    return True
