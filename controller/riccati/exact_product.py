"""Products of matrices with twice the digits of double precision, by matrix products of doubles alone.

A number with twice the digits is a pair (high, low) whose sum it is, |low| <= 2^-53 |high|. Each matrix is cut into
slices so short that products of slices are free of rounding, whatever the order of summation.
Source: Ozaki, Ogita, Oishi and Rump, Numerical Algorithms 59 (2012), 95-118.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

#: Of 22 to 25 bits each up to 100 columns: together more than twice the digits of a double.
SLICES = 5

Pair = tuple[Any, Any]


def product(left: Pair, right: Pair) -> Pair:
    """left right, (p, n) (n, q), to about 2^-105 of the largest entry of the row times that of the column."""
    bits = (53 - math.ceil(math.log2(SLICES * max(left[0].shape[1], 1)))) // 2
    rows, columns = _slices(left, bits, 1), _slices(right, bits, 0)
    total = np.zeros((len(left[0]), right[0].shape[1])), 0.0
    for order in range(SLICES, 0, -1):  # all products of slices of one size at once, the smallest first
        part = np.concatenate(rows[:order], axis=1) @ np.concatenate(columns[order - 1 :: -1])
        total = add((part, 0.0), total)
    return total


def add(left: Pair, right: Pair) -> Pair:
    """left + right to about 2^-104 of the larger one (Knuth's sum without error, of the high parts)."""
    high = left[0] + right[0]
    back = high - left[0]
    low = (left[0] - (high - back)) + (right[0] - back) + (left[1] + right[1])
    both = high + low
    return both, low - (both - high)


def exact(matrix: np.ndarray) -> Pair:
    """The doubles themselves."""
    return matrix, 0.0


def _slices(pair: Pair, bits: int, axis: int) -> list[np.ndarray]:
    """Slices of so many bits, whose sum is the pair but for what lies below the last one; one scale a row or column."""
    rest, low = pair
    exponent = np.frexp(np.abs(rest).max(axis=axis, keepdims=True, initial=0.0))[1]
    slices = []
    for number in range(1, SLICES + 1):
        if number in (3, SLICES):  # the low part begins below two slices
            rest, low = add((rest, 0.0), (low, 0.0))
        # Beside this number a double has no bits below the slice.
        shift = np.ldexp(1.5, exponent + (52 - number * bits))
        slices.append((rest + shift) - shift)
        rest = rest - slices[-1]
    return slices
