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
    bits = _bits(left[0].shape[-1])
    of_rows = _slices(left, bits, -1)
    return _summed(of_rows, _slices(right, bits, -2))


def square(left: Pair, signs: np.ndarray) -> Pair:
    """`product` of left, (..., p, n), with diag(signs) left'; signs: (n,), of 1 and -1."""
    of_rows = _slices(left, _bits(len(signs)), -1)
    return _summed(of_rows, [(each * signs).mT for each in of_rows])


def _bits(columns: int) -> int:
    """Return how many bits of a number a slice has, so that sums of products are exact."""
    return (53 - math.ceil(math.log2(SLICES * max(columns, 1)))) // 2


def _summed(of_rows: list[np.ndarray], of_columns: list[np.ndarray]) -> Pair:
    """The product of the sums of these slices, without terms smaller than the last slices."""
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


def remainder(total: np.ndarray, left: np.ndarray, right: np.ndarray) -> np.ndarray:
    """total - left right', (..., p, q), next to which rounding of left is small; of a diagonal
    right without rounding (Dekker's product).

    left: (..., p, n); right: (q, n).
    """
    factors = np.diag(right)
    if np.count_nonzero(right) > np.count_nonzero(factors):
        high, low = product(exact(left), exact(right.T))
        return np.asarray((total - high) - low)
    high, low = _halves(left)
    of_factors = _halves(factors)
    left_over = total - high * of_factors[0] - high * of_factors[1]
    return np.asarray(left_over - low * of_factors[0] - low * of_factors[1])


def _halves(numbers: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Two summands of 26 bits each of every number."""
    scaled = numbers * (2.0**27 + 1.0)
    high = scaled - (scaled - numbers)
    return high, numbers - high


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
