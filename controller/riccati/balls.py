"""Matrices of balls, which contain the exact result of each operation.

A ball is an interval, given by its midpoint and its radius (`arb` of FLINT, `arb_mat` for
matrices). The sum or product of two balls is a ball that contains the sums or products of all their
numbers: its radius also covers the rounding. What is true of all matrices in a ball is thereby
proved of the exact one. Comparisons of balls are True only if they are true of all their numbers; a
number that is not finite proves nothing.

Source: Johansson, IEEE Transactions on Computers 66 (2017), 1281-1292 (Arb).
"""

from __future__ import annotations

import math
import os
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import chain
from typing import TYPE_CHECKING, Any

import numpy as np

from hfa_support.cached import cached_property

if TYPE_CHECKING:
    from flint import arb, arb_mat


#: Bits of the first attempt of each proof, and of all attempts. With the last, what is 0 is smaller
#: than the smallest double, 2^-1074.
BITS = 128
ATTEMPTS = (BITS, 2 * BITS, 4 * BITS, 8 * BITS, 16 * BITS)
#: Unit roundoff of doubles.
ROUNDOFF = 2.0**-53
#: Bound of all that underflows in an operation of `Near`, and factor that covers the rounding of
#: its bounds, which are norms of up to 10^8 doubles.
UNDERFLOW, ROUNDED_UP = 2.0**-400, 1.0 + 2.0**-20

_LOCK = threading.RLock()


def _new_lock() -> None:
    """Replace the lock in a forked process, which has none of the threads that may hold it."""
    global _LOCK
    _LOCK = threading.RLock()


if hasattr(os, "register_at_fork"):  # not on Windows
    os.register_at_fork(after_in_child=_new_lock)


@contextmanager
def precision(bits: int) -> Iterator[None]:
    """Compute with balls of this many bits, and restore the former number afterwards.

    The number of bits is one for all threads: another thread waits.
    """
    from flint import ctx

    with _LOCK:
        before = ctx.prec
        ctx.prec = bits
        try:
            yield
        finally:
            ctx.prec = before


def bits() -> int:
    """Return the number of bits of the present `precision`."""
    from flint import ctx

    return int(ctx.prec)


def ball_matrix(matrix: np.ndarray | list[list[arb]] | arb_mat | Near | Pair) -> arb_mat:
    """Return the exact matrix of doubles, or balls that contain all matrices in the given ones."""
    from flint import arb, arb_mat

    if isinstance(matrix, Near):
        rows, columns = matrix.middle.shape
        errors = [arb(0, matrix.error)] * (rows * columns)
        return ball_matrix(matrix.middle) + arb_mat(rows, columns, errors)
    if isinstance(matrix, Pair):
        return ball_matrix(matrix.high) + ball_matrix(Near(matrix.low, matrix.error))

    if isinstance(matrix, np.ndarray):
        rows, columns = matrix.shape
        return arb_mat(rows, columns, matrix.ravel().tolist())
    return arb_mat(matrix)


def scaled(matrix: arb_mat | np.ndarray, rows: np.ndarray, columns: np.ndarray) -> Any:
    """Return 2^rows_i M_ij 2^columns_j: as doubles if those of M stay exact, else in balls, exactly
    if their bits suffice for the entries.

    rows, columns: (n,) and (m,) integers
    """
    from flint import arb

    if not rows.any() and not columns.any():
        return matrix
    if isinstance(matrix, np.ndarray):
        exponents = np.add.outer(rows, columns)
        scaled_doubles = np.ldexp(matrix, exponents)
        if np.array_equal(np.ldexp(scaled_doubles, -exponents), matrix):
            return scaled_doubles
        matrix = ball_matrix(matrix)
    of_rows, of_columns = ([arb(2) ** int(power) for power in powers] for powers in (rows, columns))
    scaled = [
        [entry * of_row * of_column for entry, of_column in zip(row, of_columns, strict=True)]
        for row, of_row in zip(matrix.tolist(), of_rows, strict=True)
    ]
    return ball_matrix(scaled)


def identity(n: int) -> arb_mat:
    """Return the identity, (n, n)."""
    return ball_matrix(np.eye(n))


def midpoints(matrix: arb_mat) -> np.ndarray:
    """Return the midpoints of balls as doubles, (n, m)."""
    entries = np.array([float(entry) for entry in matrix.entries()])
    return entries.reshape(matrix.nrows(), matrix.ncols())


def radii(matrix: arb_mat) -> np.ndarray:
    """Return the radii of balls as doubles, rounded up, (n, m)."""
    entries = matrix.entries()
    rounded = np.nextafter([float(ball.rad()) for ball in entries], math.inf)
    # A radius that rounds to 0 may be 0.
    for place in np.flatnonzero(rounded <= math.nextafter(0.0, 1.0)).tolist():
        rounded[place] *= not entries[place].is_exact()
    return rounded.reshape(matrix.nrows(), matrix.ncols())


def above(number: arb) -> float:
    """Return a double that is not below any number of a ball."""
    return math.nextafter(float(number.upper()), math.inf)


def stacked(blocks: list[list[Any]]) -> Any:
    """Return the matrix [[a, b], [c, d]] of blocks a, b, c and d of one kind."""
    kind: Any = type(blocks[0][0])
    if kind in (Near, Pair):
        names = ("middle",) if kind is Near else ("high", "low")
        tables = [[[vars(block)[name] for block in row] for row in blocks] for name in names]
        middles = [np.concatenate([np.concatenate(row, 1) for row in table]) for table in tables]
        error = sum(block.error for row in blocks for block in row)
        return kind(*middles, error * ROUNDED_UP)
    return ball_matrix(block_entries(blocks))


def block_entries(blocks: list[list[Any]]) -> list[list[Any]]:
    """Return the entries of the matrix of these blocks of FLINT, row by row."""
    rows = []
    for blocks_beside in blocks:
        tables = [block.tolist() for block in blocks_beside]
        rows += [[*chain.from_iterable(parts)] for parts in zip(*tables, strict=True)]
    return rows


def part(matrix: Any, rows: slice, columns: slice = slice(None)) -> Any:
    """Return some rows of a matrix, and some of their columns."""
    if isinstance(matrix, np.ndarray):
        return matrix[rows, columns]
    if isinstance(matrix, Near):
        return Near(matrix.middle[rows, columns], matrix.error)
    if isinstance(matrix, Pair):
        return Pair(matrix.high[rows, columns], matrix.low[rows, columns], matrix.error)
    return ball_matrix([row[columns] for row in matrix.tolist()[rows]])


def symmetric(matrix: arb_mat) -> arb_mat:
    """Return the midpoints of the symmetric part (M + M')/2, exact and exactly symmetric."""
    return symmetric_part(matrix.mid()).mid()


def symmetric_part(matrix: Any) -> Any:
    """Return balls that contain the symmetric part (M + M')/2."""
    return (matrix + matrix.transpose()) * 0.5


@dataclass(frozen=True, eq=False)
class Near:
    """Ball of matrices about one of doubles, in the norm of Frobenius.

    It computes as balls do. A product of doubles differs from A B by at most n u / (1 - n u) |A||B|
    with n columns of A and the roundoff u: in any order of the sums of products A_ij B_jk, also by
    fused operations. Methods with fewer products, as Strassen's, have a larger bound: they are
    assumed not to be those of the BLAS.

    middle: doubles
    error: radius of the ball

    Source: Higham, Accuracy and Stability of Numerical Algorithms, Section 3.5.
    """

    middle: np.ndarray
    error: float = 0.0

    @classmethod
    def of(cls, matrix: Any) -> Near:
        """Return a ball that contains all matrices in the given one, of any kind."""
        if isinstance(matrix, Near):
            return matrix
        if isinstance(matrix, np.ndarray):
            return Near(matrix)
        if isinstance(matrix, Pair):
            return _near(matrix.high, matrix.error + _size(matrix.low))
        middle, radius = midpoints(matrix), above(norm(matrix - matrix.mid()))
        return _near(middle, radius + 2.0 * ROUNDOFF * _size(middle))

    @cached_property
    def size(self) -> float:
        """Upper bound of the norm of Frobenius of all matrices in the ball."""
        return (_size(self.middle) + self.error) * ROUNDED_UP

    def widened(self, change: arb) -> Near:
        """Return a ball that also contains all matrices changed by at most this norm."""
        return _near(self.middle, self.error + above(change))

    def mid(self) -> Near:
        """Return the middle."""
        return Near(self.middle)

    def transpose(self) -> Near:
        """Return the ball of the transposed matrices."""
        return Near(self.middle.T, self.error)

    def inv(self) -> Near:
        """Return the ball of the inverses V⁻¹, about an approximate W.

        |V⁻¹ - W| <= |W| r / (1 - r) with r = |1 - V W| < 1.

        Raises ZeroDivisionError if a matrix in the ball may be singular.
        """
        try:
            W = Near(np.linalg.inv(self.middle))
        except np.linalg.LinAlgError:
            raise ZeroDivisionError from None
        rest = (Near(np.eye(len(W.middle))) - self * W).size
        if not rest < 0.5:
            raise ZeroDivisionError
        return _near(W.middle, 2.0 * W.size * rest)

    def __neg__(self) -> Near:
        return Near(-self.middle, self.error)

    def __add__(self, other: Any) -> Near:
        other = Near.of(other)
        middle = self.middle + other.middle
        return _near(middle, self.error + other.error + ROUNDOFF * _size(middle))

    def __sub__(self, other: Any) -> Near:
        return self + -Near.of(other)

    def __mul__(self, other: Any) -> Near:
        """Return the product with a matrix or with a number in doubles."""
        if isinstance(other, float):
            error = abs(other) * self.error + 2.0 * ROUNDOFF * abs(other) * self.size
            return _near(self.middle * other, error)
        other = Near.of(other)
        n = len(other.middle)
        rounding = (n + 2) * ROUNDOFF * self.size * other.size
        error = self.error * other.size + self.size * other.error
        return _near(self.middle @ other.middle, error + rounding)


#: Slices of a factor in a product of `Pair`, of 22 bits with up to 256 columns, beside the rest.
SLICES = 3
#: Whether the product of slices i and j is rounded.
IS_BEYOND = np.add.outer(np.arange(SLICES + 1), np.arange(SLICES + 1)) >= SLICES


@dataclass(frozen=True, eq=False)
class Pair:
    """Ball of matrices about the sum of two of doubles, in the norm of Frobenius.

    It has twice the digits of `Near`, for what cancels in a residual.

    high, low: doubles
    error: radius of the ball

    Sources: Ozaki, Ogita, Oishi and Rump, Numerical Algorithms 59 (2012), 95-118 (products); Knuth,
    The Art of Computer Programming 2, Section 4.2.2 (sums).
    """

    high: np.ndarray
    low: np.ndarray
    error: float = 0.0

    @classmethod
    def of(cls, matrix: Any) -> Pair:
        """Return a ball that contains all matrices in the given one, of any kind."""
        if isinstance(matrix, Pair):
            return matrix
        if isinstance(matrix, np.ndarray):
            matrix = Near(matrix)
        if isinstance(matrix, Near):
            return Pair(matrix.middle, 0.0 * matrix.middle, matrix.error)
        high = midpoints(matrix)
        low = Near.of(matrix - ball_matrix(high))
        return Pair(high, low.middle, low.error)

    def mid(self) -> Pair:
        """Return the middle."""
        return Pair(self.high, self.low)

    def transpose(self) -> Pair:
        """Return the ball of the transposed matrices."""
        return Pair(self.high.T, self.low.T, self.error)

    def __neg__(self) -> Pair:
        return Pair(-self.high, -self.low, self.error)

    def __sub__(self, other: Pair) -> Pair:
        return self + -other

    def __add__(self, other: Pair) -> Pair:
        total, missing = _sum_and_error(self.high, other.high)
        lows = self.low + other.low
        low = missing + lows
        error = self.error + other.error + ROUNDOFF * (_size(lows) + _size(low))
        return Pair(*_sum_and_error(total, low), error * ROUNDED_UP)

    def __mul__(self, other: Pair) -> Pair:
        """Return the product, of which the leading products of slices are exact."""
        n = len(other.high)
        bits = min((52 - (n - 1).bit_length()) // 2, 24)
        left, right = self._sliced(1, bits), other._sliced(0, bits)
        products = left[:, None] @ right
        # Slice i of an entry is an integer times a power of two that the row or column has in
        # common, and 2^-(bits i): of at most 2^bits for i = 0, half of it for i = 1, and 9/16 of it
        # for i = 2, with the low part. The sums over products of slices i and j with the same
        # i + j < 3 are below 11/8 n 2^(2 bits) <= 2^53: exact.
        high, low, sums = products[0, 0], np.zeros(products.shape[2:]), 0.0
        for level in range(1, SLICES):
            exact = sum(products[i, level - i] for i in range(level + 1))
            high, missing = _sum_and_error(high, exact)
            low = low + missing
            sums += _size(low)
        low = low + products[IS_BEYOND].sum(0)
        # Rounded are the last slices, these products of n terms and their sum, and the low parts.
        sizes = np.outer([*map(_size, left)], [*map(_size, right)])
        rounding = (n + 16) * ROUNDOFF * sizes[IS_BEYOND].sum() + ROUNDOFF * (sums + _size(low))
        error = self.error * Near.of(other).size + Near.of(self).size * other.error
        return Pair(*_sum_and_error(high, low), (error + rounding) * ROUNDED_UP + UNDERFLOW)

    def _sliced(self, axis: int, bits: int) -> np.ndarray:
        """Return slices whose sum is the middle, of which the last, what remains, is rounded.

        axis: 1 if the entries of a row have a power of two in common, 0 for columns
        bits: of the integers
        """
        exponents = np.frexp(np.abs(self.high).max(axis, keepdims=True))[1]
        slices, rest, low = [], self.high, self.low
        for i in range(1, SLICES + 1):
            if i == SLICES:  # low is at most a last digit of high, below the slices before
                rest, low = _sum_and_error(rest, low)
            # The last digit of 1.5 2^52 g is g: the sum with it rounds to multiples of g.
            rounding = np.ldexp(1.5, 52 - bits * i + exponents)
            slices.append((rest + rounding) - rounding)
            rest = rest - slices[-1]
        return np.array([*slices, rest + low])


def _sum_and_error(left: np.ndarray, right: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the sum, rounded, and its exact rounding error."""
    total = left + right
    of_right = total - left
    return total, (left - (total - of_right)) + (right - of_right)


def _near(middle: np.ndarray, error: float) -> Near:
    """Return a ball whose radius is rounded up, and covers what underflows."""
    return Near(middle, error * ROUNDED_UP + UNDERFLOW)


def _size(matrix: np.ndarray) -> float:
    """Return the norm of Frobenius of doubles, rounded up."""
    return math.sqrt(np.vdot(matrix, matrix)) * ROUNDED_UP + UNDERFLOW


def norm(matrix: Any) -> arb:
    """Return an upper bound of the norm of Frobenius, which bounds the spectral norm.

    matrix: in balls, or a ball in this norm
    """
    from flint import arb, arb_mat

    if isinstance(matrix, Near):
        return arb(matrix.size)
    entries = arb_mat(1, matrix.nrows() * matrix.ncols(), matrix.entries())  # one row
    sum_of_squares = (entries * entries.transpose())[0, 0]
    return sum_of_squares.upper().sqrt().upper()


def is_positive_definite(matrix: Any) -> bool | None:
    """Return whether all symmetric matrices in the balls are proved positive definite; False if all
    are proved not to be, None if neither is proved, as always of `Near` ones that may not be.

    The pivots of Gaussian elimination, D of the decomposition L D L', are all positive, or the
    first one that is not is negative: that pivot is v'M v of a vector v. Only the entries on and
    below the diagonal are read.
    """
    if _is_clearly_positive(Near.of(matrix)):
        return True
    if isinstance(matrix, Near):
        return None
    _, last = _elimination(ball_matrix(matrix))
    return True if last > 0 else False if last < 0 else None


def _is_clearly_positive(matrix: Near) -> bool:
    """Return whether Cholesky's method in doubles proves a matrix positive definite.

    If it ends for M - c, then M > 0 where c exceeds its rounding, n + 1 roundoffs of the trace, and
    the radius of M, √2 times as large where only the lower triangle is read. The c here is larger.

    Source: Rump, BIT Numerical Mathematics 46 (2006), 433-452.
    """
    middle = np.tril(matrix.middle)
    n, trace = len(middle), float(np.trace(middle))
    c = 2.0 * matrix.error + 4 * (n + 4) * ROUNDOFF * trace
    if not UNDERFLOW < c < trace < math.inf:
        return False
    try:
        root = np.linalg.cholesky(middle - c * np.eye(n))
    except np.linalg.LinAlgError:
        return False
    return bool(np.isfinite(root).all())


def cholesky(matrix: arb_mat) -> arb_mat | None:
    """Return W, lower triangular, with W W' = M, (n, n), or None unless M is proved positive."""
    columns, last = _elimination(matrix)
    return ball_matrix(columns).transpose() if last > 0 else None


def _elimination(matrix: arb_mat) -> tuple[list[list[arb]], arb]:
    """Return the columns of W, (n, n), and the last pivot, the first that is not positive."""
    n = matrix.nrows()
    rows, zero = matrix.tolist(), 0 * matrix[0, 0]
    columns, pivot = [], zero
    for k in range(n):
        pivot = rows[k][k]
        if not pivot > 0:
            break
        root = pivot.sqrt()
        column = [rows[i][k] / root for i in range(k, n)]
        columns.append([zero] * k + column)
        for i in range(k + 1, n):
            factor = column[i - k]
            for j in range(k + 1, i + 1):
                rows[i][j] = rows[i][j] - factor * column[j - k]
    return columns, pivot
