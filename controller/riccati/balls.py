"""Matrices of balls, which contain the exact result of each operation.

A ball is an interval, given by its midpoint and its radius. The sum or product of two balls is a
ball that contains the sums or products of all their numbers: its radius also covers the rounding.
What is true of all matrices in a ball is thereby proved of the exact one.

There are two arithmetics. `Balls` has as many bits as `precision` gives it, in numbers of FLINT
(`arb`, and `arb_mat` for matrices). `DoubleBalls` is as fast as a few products of doubles.
Residuals, whose digits cancel, are computed in `Balls`, and bounds in either. Bounds are numbers of
FLINT, which round outward: a bound that is compared proves what it says, and a number that is not
finite proves nothing.

Sources: Johansson, IEEE Transactions on Computers 66 (2017), 1281-1292 (Arb); Rump, Acta Numerica
19 (2010), 287-449.
"""

from __future__ import annotations

import copyreg
import threading
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache, cached_property
from itertools import chain
from typing import TYPE_CHECKING, Any, TypeAlias, TypeVar

import numpy as np

if TYPE_CHECKING:
    from flint import arb, arb_mat


#: What becomes a matrix of balls: exact doubles, balls of FLINT, or `Balls`.
Exact: TypeAlias = "np.ndarray | arb_mat | Balls"
#: Bits of the first attempt of each proof, and of all attempts. With the last, what is 0 is smaller
#: than the smallest double, 2^-1074.
BITS = 128
ATTEMPTS = (BITS, 2 * BITS, 4 * BITS, 8 * BITS, 16 * BITS)
#: Unit roundoff of doubles.
ROUNDOFF = 2.0**-53
#: Sums and products of up to a million nonnegative doubles round by less than this factor, since
#: each rounds by at most 2^-53.
UP = 1.0 + 1e-9
#: More than the sum of a million underflows, of less than 2^-1074 each.
UNDERFLOW = 1e-290

_LOCK = threading.RLock()


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


@dataclass(frozen=True, eq=False)
class Balls:
    """Matrix of balls in the arithmetic of FLINT."""

    matrix: arb_mat

    @classmethod
    def of(cls, matrix: Exact) -> Balls:
        """Return a matrix that contains the given one, itself if it is of this kind."""
        if isinstance(matrix, Balls):
            return matrix
        return cls(ball_matrix(matrix) if isinstance(matrix, np.ndarray) else matrix)

    @classmethod
    def around(cls, middle: Exact, spread: Sequence[arb]) -> Balls:
        """Return the symmetric matrix with the radius s_i s_j about each entry ij of a middle."""
        errors = ball_matrix([[_about_zero(row * column) for column in spread] for row in spread])
        return cls(cls.of(middle).matrix + errors)

    @cached_property
    def midpoint(self) -> np.ndarray:
        """Midpoints, rounded to doubles."""
        return midpoints(self.matrix)

    @cached_property
    def radius(self) -> np.ndarray:
        """Radii, rounded up."""
        return radii(self.matrix)

    def mid(self) -> Balls:
        """Return the exact midpoints."""
        return type(self)(self.matrix.mid())

    def symmetric(self) -> Balls:
        """Return the exact midpoints of the symmetric part."""
        middle = symmetric(self.matrix)
        return self if middle is self.matrix else type(self)(middle)

    @property
    def rows(self) -> int:
        """Number of rows."""
        return int(self.matrix.nrows())

    @property
    def T(self) -> Balls:
        """The transpose."""
        return type(self)(self.matrix.transpose())

    def beside(self, right: Balls) -> Balls:
        """Return [self right]."""
        return type(self)(stacked([[self.matrix, right.matrix]]))

    def block(self, rows: slice, columns: slice) -> Balls:
        """Return some rows and columns."""
        return type(self)(part(self.matrix, rows, columns))

    def __neg__(self) -> Balls:
        return type(self)(-self.matrix)

    def __add__(self, other: Balls) -> Balls:
        return type(self)(self.matrix + other.matrix)

    def __sub__(self, other: Balls) -> Balls:
        return type(self)(self.matrix - other.matrix)

    def __matmul__(self, other: Balls) -> Balls:
        return type(self)(self.matrix * other.matrix)

    def __mul__(self, factor: arb | float) -> Balls:
        return type(self)(self.matrix * factor)

    def solve(self, right: Balls) -> Balls:
        """Return M⁻¹ right."""
        return type(self)(self.matrix.solve(right.matrix))

    def wider(self, columns: Sequence[arb]) -> Balls:
        """Return the matrix with a larger radius in each column."""
        changes = [_about_zero(radius) for radius in columns]
        return type(self)(self.matrix + ball_matrix([changes] * self.rows))

    def norm(self) -> arb:
        """Return an upper bound of the spectral norm."""
        return norm(self.matrix)

    def inverse_norm(self) -> arb:
        """Return an upper bound of the spectral norm of the inverse."""
        from flint import arb

        try:
            return norm(self.matrix.inv())
        except ZeroDivisionError:
            return arb("inf")

    def is_positive_definite(self) -> bool:
        """Return whether all symmetric matrices in the balls are proved positive definite."""
        return is_positive_definite(self.matrix) is True


@dataclass(frozen=True, eq=False)
class DoubleBalls:
    """Matrix of balls with midpoints and radii in doubles, of up to 1000 rows.

    midpoint: (n, m)
    radius: (n, m)
    """

    midpoint: np.ndarray
    radius: np.ndarray

    @classmethod
    def of(cls, matrix: Exact) -> DoubleBalls:
        """Return a matrix that contains the given one; an array is exact."""
        if isinstance(matrix, np.ndarray):
            return cls(matrix, np.zeros_like(matrix))
        if isinstance(matrix, DoubleBalls):
            return matrix
        exact = Balls.of(matrix)
        middle = exact.midpoint
        rounding = 2.0 * ROUNDOFF * np.abs(middle)  # of the midpoints
        return cls(middle, UP * (exact.radius + rounding) + UNDERFLOW)

    @classmethod
    def around(cls, middle: Exact, spread: Sequence[arb]) -> DoubleBalls:
        """Return the symmetric matrix with the radius s_i s_j about each entry ij of a middle."""
        inner = cls.of(middle)
        sizes = UP * upper_ends(spread) + UNDERFLOW**0.5
        return cls(inner.midpoint, UP * (inner.radius + np.outer(sizes, sizes)))

    @property
    def rows(self) -> int:
        """Number of rows."""
        return len(self.midpoint)

    @property
    def T(self) -> DoubleBalls:
        """The transpose."""
        return type(self)(self.midpoint.T, self.radius.T)

    def beside(self, right: DoubleBalls) -> DoubleBalls:
        """Return [self right]."""
        both = ((self.midpoint, right.midpoint), (self.radius, right.radius))
        return type(self)(*map(np.hstack, both))

    def block(self, rows: slice, columns: slice) -> DoubleBalls:
        """Return some rows and columns."""
        return type(self)(self.midpoint[rows, columns], self.radius[rows, columns])

    def __neg__(self) -> DoubleBalls:
        return type(self)(-self.midpoint, self.radius)

    def __add__(self, other: DoubleBalls) -> DoubleBalls:
        return self._sum(self.midpoint + other.midpoint, other)

    def __sub__(self, other: DoubleBalls) -> DoubleBalls:
        return self._sum(self.midpoint - other.midpoint, other)

    def _sum(self, middle: np.ndarray, other: DoubleBalls) -> DoubleBalls:
        """Return the sum or difference whose rounded midpoint is given: the radii add up."""
        radius = self.radius + other.radius + ROUNDOFF * np.abs(middle)
        return type(self)(middle, UP * radius + UNDERFLOW)

    def __matmul__(self, other: DoubleBalls) -> DoubleBalls:
        # A product of n terms rounds by at most (n + 2) ROUNDOFF |left| |right| in each entry.
        terms = self.midpoint.shape[1] + 2
        left, right = np.abs(self.midpoint), np.abs(other.midpoint)
        with np.errstate(over="ignore", invalid="ignore"):  # a bound of inf or nan proves nothing
            rounding = left @ (other.radius + terms * ROUNDOFF * right)
            spread = self.radius @ (right + other.radius)
            return type(self)(self.midpoint @ other.midpoint, UP * (rounding + spread) + UNDERFLOW)

    def __mul__(self, factor: arb) -> DoubleBalls:
        in_doubles = DoubleBalls.of(ball_matrix([[factor]]))
        value, spread = in_doubles.midpoint[0, 0], in_doubles.radius[0, 0]
        middle = self.midpoint * value
        radius = np.abs(self.midpoint) * spread + self.radius * (abs(value) + spread)
        return type(self)(middle, UP * (radius + ROUNDOFF * np.abs(middle)) + UNDERFLOW)

    def norm(self) -> arb:
        """Return an upper bound of the spectral norm, as `norm` does."""
        from flint import arb

        sizes = np.abs(self.midpoint) + self.radius
        if not sizes.size:
            return arb(0)
        return (arb(float(sizes.sum(0).max())) * arb(float(sizes.sum(1).max()))).sqrt() * arb(UP)

    def inverse_norm(self) -> arb:
        """Return an upper bound of the spectral norm of the inverse; inf if it may not exist.

        It is |M~| / (1 - |M M~ - I|) with an approximate inverse M~.
        """
        from flint import arb

        try:
            inverse = DoubleBalls.of(np.linalg.inv(self.midpoint))
        except np.linalg.LinAlgError:
            return arb("inf")
        error = (self @ inverse - DoubleBalls.of(np.eye(self.rows))).norm()
        return inverse.norm() / (1 - error) if error < 1 else arb("inf")

    def is_positive_definite(self) -> bool:
        """Return whether all symmetric matrices in the balls are proved positive definite.

        The diagonal is scaled to about 1 by powers of two. Then Cholesky's method succeeds in
        doubles after more than its rounding and the radii is subtracted from the diagonal
        (Rump 2010, Section 10.8).
        """
        from flint import arb

        diagonal = np.diag(self.midpoint)
        if not (diagonal > 0.0).all():
            return False
        units = np.exp2(-np.round(0.5 * np.log2(diagonal)))
        scales = np.outer(units, units)
        scaled = self.midpoint * scales
        spread = np.maximum(self.radius, self.radius.T) * scales  # either triangle is read
        rounding = 8.0 * (len(scaled) + 2) * ROUNDOFF * np.trace(scaled)
        shift = arb(float(rounding)) + DoubleBalls(0.0 * spread, spread).norm() + arb(UNDERFLOW)
        if not shift.is_finite():
            return False
        scaled[np.diag_indices_from(scaled)] -= float(shift) * UP
        try:
            np.linalg.cholesky(scaled)  # of one triangle
        except np.linalg.LinAlgError:
            return False
        return bool(np.isfinite(scaled).all())


#: Matrix of balls of one of the arithmetics.
Matrix = TypeVar("Matrix", Balls, DoubleBalls)


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
    entries = iter(matrix.entries())
    return ball_matrix([[next(entries) * i * j for j in of_columns] for i in of_rows])


def identity(n: int) -> arb_mat:
    """Return the identity, (n, n)."""
    return ball_matrix(np.eye(n))


def midpoints(matrix: arb_mat) -> np.ndarray:
    """Return the midpoints of balls as doubles, (n, m)."""
    entries = np.array([float(entry) for entry in matrix.entries()])
    return entries.reshape(matrix.nrows(), matrix.ncols())


def radii(matrix: arb_mat) -> np.ndarray:
    """Return the radii of balls as doubles, rounded up, (n, m)."""
    shape = matrix.nrows(), matrix.ncols()
    if matrix == matrix:  # balls with a radius are not equal
        return np.zeros(shape)
    entries = [float(entry.rad()) for entry in matrix.entries()]
    return np.nextafter(np.reshape(entries, shape) * UP, np.inf)


def upper_ends(numbers: Sequence[arb]) -> np.ndarray:
    """Return the upper ends of balls, rounded to doubles, (n,); times `UP`, they are bounds."""
    return np.array([float(number.upper()) for number in numbers])


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


def part(matrix: arb_mat, rows: slice, columns: slice) -> arb_mat:
    """Return some rows and columns of a matrix."""
    return ball_matrix([row[columns] for row in matrix.tolist()[rows]])


def _about_zero(radius: arb) -> arb:
    """Return a ball about 0 that contains ± the radius, itself a ball."""
    return radius.union(-radius)


def symmetric(matrix: arb_mat) -> arb_mat:
    """Return the exact midpoints of the symmetric part (M + M')/2."""
    from flint import arb

    mirrored = matrix.transpose()
    if matrix == mirrored:  # balls with a radius are not equal
        return matrix
    return ((matrix.mid() + mirrored.mid()) * arb(0.5)).mid()


def symmetric_part(matrix: arb_mat) -> arb_mat:
    """Return balls that contain the symmetric part (M + M')/2."""
    return (matrix + matrix.transpose()) * 0.5


def norm(matrix: arb_mat) -> arb:
    """Return an upper bound of the spectral norm, √(|M|₁ |M|∞).

    |M|₁ and |M|∞ are the largest sums of magnitudes in a column and in a row.
    """
    from flint import arb

    if 0 in (matrix.nrows(), matrix.ncols()):
        return arb(0)
    sizes = ball_matrix([[abs(entry).upper() for entry in row] for row in matrix.tolist()])
    of_rows = sizes * ball_matrix(np.ones((matrix.ncols(), 1)))
    of_columns = ball_matrix(np.ones((1, matrix.nrows()))) * sizes
    square = arb(1)
    for sums in (of_rows.entries(), of_columns.entries()):
        if not all(entry.is_finite() for entry in sums):
            return arb("inf")
        square = square * max(entry.upper() for entry in sums)
    return square.sqrt().upper()


def is_positive_definite(matrix: arb_mat) -> bool | None:
    """Return whether all symmetric matrices in the balls are proved positive definite; False if all
    are proved not to be, None if neither is proved.

    The pivots of Gaussian elimination, D of their decomposition L D L', are positive, or the first
    one that is not is negative: it is v'M v for a vector v.
    """
    n = matrix.nrows()
    rows = matrix.tolist()
    for pivot in range(n):
        if not rows[pivot][pivot] > 0:
            return False if rows[pivot][pivot] < 0 else None
        for i in range(pivot + 1, n):
            factor = rows[i][pivot] / rows[pivot][pivot]
            for j in range(pivot + 1, i + 1):
                rows[i][j] = rows[i][j] - factor * rows[j][pivot]
    return True


#: Midpoint or radius: m and e of m 2^e, or a text if it is not finite.
_Part: TypeAlias = "tuple[int, int] | str"


@cache
def make_balls_picklable() -> None:
    """Let balls and their matrices be pickled and copied in this process."""
    from flint import arb, arb_mat

    copyreg.pickle(arb, lambda ball: (arb, (_part(ball.mid()), _part(ball.rad()))))
    copyreg.pickle(
        arb_mat, lambda matrix: (arb_mat, (matrix.nrows(), matrix.ncols(), matrix.entries()))
    )


def _part(exact: arb) -> _Part:
    """Return the midpoint or the radius of a ball, from a ball of radius 0."""
    if exact.is_finite():
        mantissa, exponent = exact.man_exp()
        return int(mantissa), int(exponent)
    if exact > 0:
        return "inf"
    return "-inf" if exact < 0 else "nan"
