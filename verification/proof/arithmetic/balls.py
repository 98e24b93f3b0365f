"""Balls of real numbers (python-flint, Arb): a midpoint and a radius that holds every rounding;
Taylor models of them.

Every value is an enclosure: what is computed with balls contains what exact arithmetic would give
for any numbers in the arguments. A comparison of balls is true only when it holds for all of their
numbers. Taylor models keep how a value depends on the place and on errors. Sources: Johansson, Arb:
efficient arbitrary-precision midpoint-radius interval arithmetic, IEEE Transactions on Computers 66
(2017); Makino and Berz, Taylor models and other validated functional inclusion methods, IJPAM 4
(2003)."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from itertools import zip_longest
from typing import Any

import numpy as np
from flint import arb, arb_mat, arb_series

#: Relative radius that holds the decimal from which a double was read, also by way of degrees: four
#: units of 2^-53.
READING = 2.0**-51
#: {s : |s| <= 1} and {s² : |s| <= 1}.
_ALL, _SQUARE = arb(0, 1), arb(0.5, 0.5)
#: Control points of s² on the four quarters of [-1, 1]: their hull holds (s, s²).
_HULL = ((-1.0, 1.0), (-0.75, 0.5), (-0.25, 0.0), (0.25, 0.0), (0.75, 0.5), (1.0, 1.0))


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


def inside(inner: Sequence[arb], outer: Sequence[arb]) -> bool:
    """Each ball lies in the interior of its partner, for certain."""
    return all(
        one.is_finite() and other.contains_interior(one)
        for one, other in zip(inner, outer, strict=True)
    )


def norm(entries: Iterable[arb]) -> arb:
    """sqrt(Σ entry²): of a matrix the Frobenius norm."""
    known = list(entries)
    low, high = (
        sum((end(entry) ** 2 for entry in known), arb(0)) for end in (arb.abs_lower, arb.abs_upper)
    )
    return low.sqrt().union(high.sqrt())


def pivots(values: arb_mat) -> list[arb] | None:
    """D of L D L' = M for every symmetric M in the matrix of balls; None when a pivot may be 0.

    The signs of D are those of the eigenvalues (Sylvester's law of inertia). Only the lower
    triangle is read."""
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


class TaylorModel:
    """c_0 + c_1 s + c_2 s² + rest + Σ z_k t_k for every |s|, |t_k| <= 1, as parts (c_0, c_1, c_2,
    rest, z_1, ..).

    s: the place within the box. t: errors of the parameters. The parts are balls, or matrices of
    balls. What is no Taylor model is a constant; `ball_function.py` runs functions on scalar ones.
    """

    def __init__(self, *parts: Any) -> None:
        self.parts = parts + (0 * parts[0],) * (4 - len(parts))

    @classmethod
    def of(cls, value: Any) -> TaylorModel:
        """A value; other arguments are constants."""
        return (
            value
            if isinstance(value, TaylorModel)
            else cls(arb(value) if isinstance(value, int) else value)
        )

    def map(self, linear: Callable[[Any], Any]) -> TaylorModel:
        """A linear map of every part."""
        return TaylorModel(*map(linear, self.parts))

    def __add__(self, other: Any) -> TaylorModel:
        if not isinstance(other, TaylorModel):
            return TaylorModel(self.parts[0] + other, *self.parts[1:])
        return TaylorModel(
            *(a + b for a, b in zip_longest(self.parts, TaylorModel.of(other).parts, fillvalue=0))
        )

    def __neg__(self) -> TaylorModel:
        return self.map(lambda part: -part)

    def __sub__(self, other: Any) -> TaylorModel:
        return self + -TaylorModel.of(other)

    def __mul__(self, other: Any) -> TaylorModel:
        if not isinstance(other, TaylorModel):
            return self.map(lambda part: part * other)
        (a0, a1, a2, rest, *za), (b0, b1, b2, other_rest, *zb) = self.parts, other.parts
        # What is kept of the product of the two aways is a1 b1 s².
        rest = rest * b0 + a0 * other_rest + self.away(0) * other.away() + _ALL * a1 * other.away(0)
        z = map(sum, zip_longest((x * b0 for x in za), (a0 * y for y in zb), fillvalue=0))
        return TaylorModel(a0 * b0, a0 * b1 + a1 * b0, a0 * b2 + a1 * b1 + a2 * b0, rest, *z)

    def __truediv__(self, other: Any) -> TaylorModel:
        return self * TaylorModel.of(other).through(lambda series: 1 / series)

    def __radd__(self, other: Any) -> TaylorModel:
        return self + other

    def __rsub__(self, other: Any) -> TaylorModel:
        return TaylorModel.of(other) - self

    def __rmul__(self, other: Any) -> TaylorModel:
        return self.map(lambda part: other * part)

    def __rtruediv__(self, other: Any) -> TaylorModel:
        return TaylorModel.of(other) / self

    def transpose(self) -> TaylorModel:
        """Of a matrix."""
        return self.map(lambda part: part.transpose())

    def away(self, s: Any = _ALL, square: Any = _SQUARE) -> Any:
        """Every value less c_0, at some s and s²."""
        _, c1, c2, rest, *z = self.parts
        return s * c1 + square * c2 + sum((_ALL * each for each in z), rest)

    def range(self) -> Any:
        """Every value on the box."""
        return self.parts[0] + self.away()

    def corners(self) -> list[Any]:
        """Enclosures whose convex hull holds every value."""
        return [self.parts[0] + self.away(arb(s), arb(square)) for s, square in _HULL]

    def through(self, function: Callable[[arb_series], arb_series]) -> TaylorModel:
        """f(c_0 + δ) = f + f' δ + f''/2 δ² + f'''(ξ)/6 δ³ with ξ in the range."""
        near = function(arb_series([self.parts[0], 1], prec=3))
        far = function(arb_series([self.range(), 1], prec=4))
        delta = TaylorModel(arb(0), *self.parts[1:])
        square = delta * delta
        last = TaylorModel(near[0], arb(0), arb(0), far[3] * square.range() * self.away())
        return (
            delta.map(lambda part: part * near[1]) + square.map(lambda part: part * near[2]) + last
        )


for _name in ("sqrt", "exp", "log", "sin", "cos", "tan", "asin", "acos", "atan"):
    setattr(TaylorModel, _name, lambda self, _name=_name: self.through(getattr(arb_series, _name)))
