"""Matrices of balls whose midpoints are sums of two doubles, by products of doubles alone.

A product is the sum of products of slices: matrices of integers (times powers of two) of so few
bits that doubles hold the sums of their products exactly, in any order of summation.

Sources: Ozaki, Ogita, Oishi and Rump, Numerical Algorithms 59 (2012), 95-118; Knuth, The Art of
Computer Programming 2, Section 4.2.2 (`_sum_and_error`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from controller.riccati.balls import (
    ROUNDOFF,
    UNDERFLOW,
    UP,
    Balls,
    DoubleBalls,
    Exact,
    ball_matrix,
    midpoints,
    radii,
    upper_ends,
)

if TYPE_CHECKING:
    from flint import arb, arb_mat

#: Bits of the significand of a double.
BITS_OF_A_DOUBLE = 53


@dataclass(frozen=True, eq=False)
class Pairs:
    """Matrix of balls about midpoints high + low, of up to 1000 rows.

    high: (n, m), the midpoints as doubles
    low: (n, m), what is missing: |low| <= ROUNDOFF |high|
    radius: (n, m)
    """

    high: np.ndarray
    low: np.ndarray
    radius: np.ndarray

    @classmethod
    def of(cls, matrix: Exact) -> Pairs:
        """Return a matrix that contains the given one, itself if it is of this kind."""
        if isinstance(matrix, Pairs):
            return matrix
        if isinstance(matrix, np.ndarray):
            return cls(matrix, np.zeros_like(matrix), np.zeros_like(matrix))
        balls = Balls.of(matrix).matrix
        middle = midpoints(balls)
        high, low = _sum_and_error(middle, midpoints(balls - ball_matrix(middle)))
        rest = balls - ball_matrix(high) - ball_matrix(low)
        return cls(high, low, UP * (np.abs(midpoints(rest)) + radii(rest)) + UNDERFLOW)

    @property
    def midpoint(self) -> np.ndarray:
        """Midpoints, rounded to doubles."""
        return self.high

    @property
    def matrix(self) -> arb_mat:
        """The matrix in the arithmetic of FLINT."""
        from flint import arb

        errors = ball_matrix([[arb(0, radius) for radius in row] for row in self.radius.tolist()])
        return ball_matrix(self.high) + ball_matrix(self.low) + errors

    @property
    def rows(self) -> int:
        """Number of rows."""
        return len(self.high)

    @property
    def T(self) -> Pairs:
        """The transpose."""
        return Pairs(self.high.T, self.low.T, self.radius.T)

    def mid(self) -> Pairs:
        """Return the exact midpoints, with the radius 0."""
        return Pairs(self.high, self.low, np.zeros_like(self.high))

    def symmetric(self) -> Pairs:
        """Return the exact midpoints of the symmetric part."""
        if (self.high == self.high.T).all() and (self.low == self.low.T).all():
            return self.mid() if self.radius.any() else self
        both = self + self.T
        return Pairs(both.high / 2.0, both.low / 2.0, np.zeros_like(self.high))

    def beside(self, right: Pairs) -> Pairs:
        """Return [self right]."""
        return Pairs(
            np.hstack([self.high, right.high]),
            np.hstack([self.low, right.low]),
            np.hstack([self.radius, right.radius]),
        )

    def block(self, rows: slice, columns: slice) -> Pairs:
        """Return some rows and columns."""
        return Pairs(self.high[rows, columns], self.low[rows, columns], self.radius[rows, columns])

    def __neg__(self) -> Pairs:
        return Pairs(-self.high, -self.low, self.radius)

    def __sub__(self, other: Pairs) -> Pairs:
        return self + -other

    def __add__(self, other: Pairs) -> Pairs:
        high, error = _sum_and_error(self.high, other.high)
        lows = self.low + other.low
        low = error + lows
        rounding = ROUNDOFF * (np.abs(lows) + np.abs(low))
        radius = UP * (self.radius + other.radius + rounding) + UNDERFLOW
        return Pairs(*_sum_and_error(high, low), radius)

    def __matmul__(self, other: Pairs) -> Pairs:
        terms = self.high.shape[1]
        bits = (BITS_OF_A_DOUBLE - (terms - 1).bit_length()) // 2
        left, right = _sliced(self, 1, bits), _sliced(other, 0, bits)
        # The first two products are exact: sums of `terms` products below 2^(2 bits), and of twice
        # as many of half the size, in units of the grids.
        first = left.first @ right.first
        slices = np.concatenate([left.first, left.second, left.rest], 1)
        second = slices[:, : 2 * terms] @ np.concatenate([right.second, right.first])
        third = slices @ np.concatenate([right.rest, right.second + right.rest, other.high])
        high, error = _sum_and_error(first, second)
        low = error + third
        # With sizes a_i, b_j and t = 2^(-2 bits - 1) + ROUNDOFF: |first| <= a, |second| is at most
        # 2^(-bits - 1) a, and |rest| <= t a. The products of `third` are then below t times `sizes`
        # in sum. Their 3 terms sums and products round; both `rest` and second + rest round, and
        # rest other.low is left out, which is 4 terms ROUNDOFF t a b.
        sizes = left.size * (right.sum + (0.6 * terms + 2.0) * right.size) + left.sum * right.size
        rounding = 3.0 * terms * ROUNDOFF * (2.0 ** (-2 * bits - 1) + ROUNDOFF)
        radius = rounding * sizes + ROUNDOFF * np.abs(low)
        if self.radius.any():
            radius = radius + self.radius @ (np.abs(other.high) + other.radius)
        if other.radius.any():
            radius = radius + np.abs(self.high) @ other.radius
        return Pairs(*_sum_and_error(high, low), UP * radius + UNDERFLOW)

    def times(self, factor: arb) -> Pairs:
        """Return the product with a ball, that of a matrix (1, 1) and all entries in one row."""
        row = Pairs(self.high.reshape(1, -1), self.low.reshape(1, -1), self.radius.reshape(1, -1))
        product = Pairs.of(ball_matrix([[factor]])) @ row
        parts = product.high, product.low, product.radius
        return Pairs(*(part.reshape(self.high.shape) for part in parts))

    def solve(self, right: Pairs) -> Pairs:
        """Return M⁻¹ right.

        A solution x in doubles is corrected once, and is then off by M⁻¹ (right - M x).
        """
        inverse, norm_of_inverse = DoubleBalls.of(self).inverse()
        x = Pairs.of(inverse @ right.high)
        x = (x + Pairs.of(inverse @ (right - self @ x).high)).mid()
        residual = DoubleBalls.of(right - self @ x)
        return x.wider(residual.column_norms(norm_of_inverse))

    def wider(self, columns: Sequence[arb]) -> Pairs:
        """Return the matrix with a larger radius in each column."""
        added = UP * upper_ends(columns) + UNDERFLOW
        return Pairs(self.high, self.low, UP * (self.radius + added))


class _Slices(NamedTuple):
    """Matrix as the sum first + second + rest, with the leading and the next bits of each entry.

    The entries of `first` are integers of some bits, times a power of two that each row, or each
    column, has in common; those of `second` likewise.

    size: power of two above the largest entry of each row or column
    sum: of the magnitudes of each row or column
    """

    size: np.ndarray
    sum: np.ndarray
    first: np.ndarray
    second: np.ndarray
    rest: np.ndarray


def _sliced(matrix: Pairs, axis: int, bits: int) -> _Slices:
    """Return the slices of a matrix; only `rest` is rounded.

    axis: 1 if the entries of a row have a power of two in common, 0 for columns
    bits: of the integers
    """
    sizes = np.abs(matrix.high)
    size = np.ldexp(1.0, np.frexp(sizes.max(axis, keepdims=True))[1])
    # The last digit of 1.5 2^p is 2^(p - 52): the sum with it rounds to the grid 2^-bits size.
    rounding = 1.5 * 2.0 ** (BITS_OF_A_DOUBLE - 1 - bits) * size
    first = (matrix.high + rounding) - rounding
    beyond_first = matrix.high - first
    rounding = rounding * 2.0**-bits
    second = (beyond_first + rounding) - rounding
    rest = beyond_first - second + matrix.low
    return _Slices(size, sizes.sum(axis, keepdims=True), first, second, rest)


def _sum_and_error(left: np.ndarray, right: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the sum, rounded, and its exact rounding error."""
    total = left + right
    of_right = total - left
    return total, (left - (total - of_right)) + (right - of_right)
