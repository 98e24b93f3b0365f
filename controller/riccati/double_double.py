"""Sums and products of matrices with twice the digits of double precision, by doubles alone.

Such a number is a pair (high, low) whose sum it is, |low| <= 2^-53 |high|. Each matrix is cut into
slices so short that products of slices are free of rounding, whatever the order of summation. All
functions take one matrix or stacks (..., n, m).
Source: Ozaki, Ogita, Oishi and Rump, Numerical Algorithms 59 (2012), 95-118."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

#: Of 22 to 25 bits each up to 100 columns: together more than twice the digits of a double.
SLICES = 5

#: (high, low), arrays of one shape; low may be 0.0.
Pair = tuple[Any, Any]


def exact(matrix: np.ndarray) -> Pair:
    """The doubles themselves as a pair."""
    return matrix, 0.0


def add(left: Pair, right: Pair) -> Pair:
    """left + right to about 2^-104 of the larger one (Knuth's sum without error of the highs)."""
    high = left[0] + right[0]
    back = high - left[0]
    low = (left[0] - (high - back)) + (right[0] - back) + (left[1] + right[1])
    total = high + low
    return total, low - (total - high)


def product(left: Pair, right: Pair) -> Pair:
    """left right to about 2^-105 of the largest entry of the row times that of the column.

    left: (..., p, n); right: (..., n, q).
    """
    columns = left[0].shape[-1]
    bits = (53 - math.ceil(math.log2(SLICES * max(columns, 1)))) // 2
    of_rows = _slices(left, bits, -1)
    of_columns = _slices(right, bits, -2)
    parts = [  # products of slices of one size at once, largest first
        np.concatenate(of_rows[:order], axis=-1)
        @ np.concatenate(of_columns[order - 1 :: -1], axis=-2)
        for order in range(1, SLICES + 1)
    ]
    total = exact(parts.pop() + parts.pop())  # rounded below the digits of the result
    while parts:
        total = add(exact(parts.pop()), total)
    return total


def transposed(pair: Pair) -> Pair:
    """Return the transpose of a matrix or of a stack."""
    high, low = pair
    return high.mT, low if np.ndim(low) == 0 else low.mT


def _slices(pair: Pair, bits: int, axis: int) -> list[np.ndarray]:
    """Return slices of a number of bits whose sum is the pair, but for bits below the last slice.

    Each row (axis -1) or column (axis -2) has one scale.
    """
    remainder, low = pair
    has_low_part = np.ndim(low) > 0
    largest = np.abs(remainder).max(axis=axis, keepdims=True, initial=0.0)
    # Beside this number a double has no bits below the first slice.
    shift = np.ldexp(1.5, np.frexp(largest)[1] + (52 - bits))
    slices = []
    for number in range(1, SLICES + 1):
        if has_low_part and number in (3, SLICES):  # the low part begins below two slices
            remainder, low = add((remainder, 0.0), (low, 0.0))
        piece = (remainder + shift) - shift
        slices.append(piece)
        remainder = remainder - piece
        shift = shift * 2.0**-bits
    return slices
