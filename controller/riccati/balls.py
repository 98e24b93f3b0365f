"""Matrices of balls, which contain the exact result of each operation.

A ball is an interval, given by its midpoint and its radius (`arb` of FLINT, `arb_mat` for
matrices). The sum or product of two balls is a ball that contains the sums or products of all their
numbers: its radius also covers the rounding. What is true of all matrices in a ball is thereby
proved of the exact one. Comparisons of balls are True only if they are true of all their numbers; a
number that is not finite proves nothing.

Source: Johansson, IEEE Transactions on Computers 66 (2017), 1281-1292 (Arb).
"""

from __future__ import annotations

import copyreg
import math
import os
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from itertools import chain
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np

if TYPE_CHECKING:
    from flint import arb, arb_mat


#: Bits of the first attempt of each proof, and of all attempts. With the last, what is 0 is smaller
#: than the smallest double, 2^-1074.
BITS = 128
ATTEMPTS = (BITS, 2 * BITS, 4 * BITS, 8 * BITS, 16 * BITS)
#: Unit roundoff of doubles.
ROUNDOFF = 2.0**-53
#: Doubles whose products of four do not underflow are larger.
TINY = 2.0**-250

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


def ball_matrix(matrix: np.ndarray | list[list[arb]]) -> arb_mat:
    """Return the exact matrix of doubles, or of balls."""
    from flint import arb_mat

    if isinstance(matrix, np.ndarray):
        rows, columns = matrix.shape
        return arb_mat(rows, columns, matrix.ravel().tolist())
    return arb_mat(matrix)


def scaled_balls(matrix: arb_mat, rows: np.ndarray, columns: np.ndarray) -> arb_mat:
    """Return 2^rows_i M_ij 2^columns_j in balls, exactly if their bits suffice for the entries.

    rows, columns: (n,) and (m,) integers
    """
    from flint import arb

    if not rows.any() and not columns.any():
        return matrix
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
    entries = [0.0 if ball.is_exact() else above(ball.rad()) for ball in matrix.entries()]
    return np.reshape(entries, (matrix.nrows(), matrix.ncols()))


def above(number: arb) -> float:
    """Return a double that is not below any number of a ball."""
    return math.nextafter(float(number.upper()), math.inf)


def stacked(blocks: list[list[arb_mat]]) -> arb_mat:
    """Return the matrix [[a, b], [c, d]] of blocks a, b, c and d."""
    return ball_matrix(block_entries(blocks))


def block_entries(blocks: list[list[Any]]) -> list[list[Any]]:
    """Return the entries of the matrix of these blocks of FLINT, row by row."""
    rows = []
    for blocks_beside in blocks:
        tables = [block.tolist() for block in blocks_beside]
        rows += [[*chain.from_iterable(parts)] for parts in zip(*tables, strict=True)]
    return rows


def part(matrix: arb_mat, rows: slice, columns: slice = slice(None)) -> arb_mat:
    """Return some rows of a matrix, and some of their columns."""
    return ball_matrix([row[columns] for row in matrix.tolist()[rows]])


def symmetric(matrix: arb_mat) -> arb_mat:
    """Return the midpoints of the symmetric part (M + M')/2, exact and exactly symmetric."""
    return symmetric_part(matrix.mid()).mid()


def symmetric_part(matrix: arb_mat) -> arb_mat:
    """Return balls that contain the symmetric part (M + M')/2."""
    return (matrix + matrix.transpose()) * 0.5


def norm(matrix: arb_mat) -> arb:
    """Return an upper bound of the norm of Frobenius, which bounds the spectral norm."""
    from flint import arb_mat

    entries = arb_mat(1, matrix.nrows() * matrix.ncols(), matrix.entries())  # one row
    sum_of_squares = (entries * entries.transpose())[0, 0]
    return sum_of_squares.upper().sqrt().upper()


def is_positive_definite(matrix: arb_mat) -> bool | None:
    """Return whether all symmetric matrices in the balls are proved positive definite; False if all
    are proved not to be, None if neither is proved.

    The pivots of Gaussian elimination, D of the decomposition L D L', are all positive, or the
    first one that is not is negative: that pivot is v'M v of a vector v. Only the entries on and
    below the diagonal are read.
    """
    if _is_clearly_positive(matrix):
        return True
    _, last = _elimination(matrix)
    return True if last > 0 else False if last < 0 else None


def _is_clearly_positive(matrix: arb_mat) -> bool:
    """Return whether Cholesky's method in doubles proves a matrix positive definite.

    If it ends for M - c, then M > 0 where c exceeds its rounding, n + 1 roundoffs of the trace, and
    the radii of M. The c here is four times as large.

    Source: Rump, BIT Numerical Mathematics 46 (2006), 433-452.
    """
    middle = np.tril(midpoints(matrix))
    n, trace = len(middle), float(np.trace(middle))
    c = above(norm(matrix - matrix.mid())) + 4 * (n + 4) * ROUNDOFF * trace
    if not TINY < c < trace < math.inf:
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


#: Midpoint or radius: m and e of m 2^e, or a text if it is not finite.
_Storable: TypeAlias = "tuple[int, int] | str"


@cache
def make_balls_picklable() -> None:
    """Let balls and their matrices be pickled and copied in this process."""
    from flint import arb, arb_mat

    copyreg.pickle(arb, lambda ball: (arb, (_storable(ball.mid()), _storable(ball.rad()))))
    copyreg.pickle(
        arb_mat, lambda matrix: (arb_mat, (matrix.nrows(), matrix.ncols(), matrix.entries()))
    )


def _storable(exact: arb) -> _Storable:
    """Return an exact number, the midpoint or radius of a ball, in a form that can be pickled:
    (mantissa, exponent of 2), or "inf", "-inf" or "nan".
    """
    if exact.is_finite():
        mantissa, exponent = exact.man_exp()
        return int(mantissa), int(exponent)
    if exact > 0:
        return "inf"
    return "-inf" if exact < 0 else "nan"
