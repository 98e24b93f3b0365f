"""Matrix sums and products with twice the digits of double precision, computed with doubles.

A number is the sum of a pair (high, low), |low| <= 2^-53 |high|. Each matrix is split into slices
of so few bits that products of slices have no rounding error, in any order of summation. All
functions accept one matrix or stacks (..., n, m).
Source: Ozaki, Ogita, Oishi and Rump, Numerical Algorithms 59 (2012), 95-118.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

#: Number of slices, of 22 to 25 bits each for up to 100 columns. The rounding error of the products
#: with the remainder is smaller than the last digit of a pair.
SLICES = 3


@dataclass(frozen=True, eq=False, slots=True)
class Pair:
    """Matrix high + low, |low| <= 2^-53 |high|, with sums and products of pairs.

    The error of a sum is about 2^-104 of the larger summand, and that of a product about 2^-104 of
    the product of the largest entries of the row and the column.
    """

    high: np.ndarray
    low: np.ndarray

    @property
    def mT(self) -> Pair:
        """The transposed matrix."""
        return Pair(self.high.mT, self.low.mT)

    def __neg__(self) -> Pair:
        return Pair(-self.high, -self.low)

    def __add__(self, other: Pair) -> Pair:
        return _sum(self.high, other.high, self.low + other.low)

    def __matmul__(self, other: Pair) -> Pair:
        mixed = self.high @ other.low + self.low @ other.high
        return product_of_doubles(self.high, other.high) + exact(mixed)


def exact(matrix: np.ndarray) -> Pair:
    """Return a matrix of doubles as a pair with low = 0."""
    return Pair(matrix, np.zeros_like(matrix))


def _sum(left: np.ndarray, right: np.ndarray, low: np.ndarray) -> Pair:
    """Return left + right + low as a pair, for arrays of doubles."""
    high = left + right
    back = high - left
    low = (left - (high - back)) + (right - back) + low
    total = high + low
    return Pair(total, low - (total - high))


def product_of_doubles(left: np.ndarray, right: np.ndarray) -> Pair:
    """Return the matrix product of two matrices of doubles, as accurate as that of pairs."""
    p, n = left.shape[-2:]
    slices, left_over = _slices(np.concatenate([left, right.mT], axis=-2))
    rows = np.concatenate([each[..., :p, :] for each in (*slices, left_over[-1])], axis=-1)
    columns = np.concatenate([each[..., p:, :] for each in slices[::-1]], axis=-1).mT
    remainders = np.concatenate([each[..., p:, :] for each in left_over[::-1]], axis=-1).mT
    # The sums of products of slices of equal size are exact, the first is the largest.
    largest, smaller, smallest = (
        rows[..., : k * n] @ columns[..., (SLICES - k) * n :, :] for k in range(1, SLICES + 1)
    )
    pair = _sum(smaller, smallest, rows @ remainders)
    return _sum(largest, pair.high, pair.low)


def _slices(rows: np.ndarray) -> tuple[list[np.ndarray], list[np.ndarray]]:
    """Return the slices of rows, and the remainders before the first and after each slice."""
    # A slice contains so few bits that sums of products of two slices have no rounding error. All
    # entries of a row have the same scale.
    bits = (53 - (SLICES * rows.shape[-1]).bit_length()) // 2
    largest = np.abs(rows).max(axis=-1, keepdims=True, initial=0.0)
    # A number added to this one keeps only the bits of the first slice.
    shift = np.full_like(rows, np.ldexp(1.5, np.frexp(largest)[1] + (52 - bits)))
    slices = []
    left_over = [rows]
    for _ in range(SLICES):
        slices.append((rows + shift) - shift)
        rows = rows - slices[-1]
        left_over.append(rows)
        shift = shift * 2.0**-bits
    return slices, left_over
