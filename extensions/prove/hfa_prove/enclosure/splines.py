"""Tables of `casadi.interpolant` as sums of products of piecewise polynomials.

A table is f(x) = Σ_I c_I Π_d φ_(d, I_d)(x_d). The functions φ of one variable are the hats of a
linear table, or the B-splines of a smooth one. All coefficients are rational numbers and therefore
exact. CasADi continues linear tables with the slopes of their ends, and smooth ones with 0.
"""

from __future__ import annotations

import struct
from bisect import bisect_right
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property, lru_cache
from itertools import pairwise, zip_longest
from typing import Any

import casadi as ca
import numpy as np

from hfa_support.errors import BadInputError

#: Coefficients of a polynomial in t - t_0, in ascending order.
Coefficients = tuple[Fraction, ...]
#: Largest degree of a piece.
HIGHEST = 3
#: Largest relative difference of a table from CasADi's values.
_SAME = 1e-9
#: Types of serialized numbers, and the bytes of a number with its type.
_TYPES = {b"d": "<d", b"J": "<q"}
_BYTES = 9
#: Number of points at which values are compared.
_POINTS = 16
#: Entry with the coefficients of B-splines, behind those of derivatives that CasADi has stored.
_COEFFICIENTS = "BSpline::coeffs"
#: CasADi's class of the Jacobian of a linear table.
_DERIVATIVE = "LinearInterpolantJac"


@dataclass(frozen=True)
class Spline:
    """Piecewise polynomial of one variable.

    knots: x_1 < .. < x_k
    pieces: k + 1 polynomials, before x_1, between the knots, and beyond x_k. The first is a
        polynomial in t - x_1, each other one in t minus the knot at its left end.
    """

    knots: tuple[float, ...]
    pieces: tuple[Coefficients, ...]

    @cached_property
    def origins(self) -> tuple[float, ...]:
        """The point t_0 of each piece, (k + 1,)."""
        return (self.knots[0], *self.knots)

    @cached_property
    def has_jumps(self) -> tuple[bool, ...]:
        """Whether the spline is discontinuous at each knot, (k,)."""
        found = []
        for k, knot in enumerate(self.knots):
            length = Fraction(knot) - Fraction(self.origins[k])
            found.append(polynomial(self.pieces[k], length) != self.pieces[k + 1][0])
        return tuple(found)

    def at(self, t: float) -> float:
        """Return the value at t, in double precision."""
        piece = bisect_right(self.knots, t)
        return float(polynomial(self.pieces[piece], t - self.origins[piece]))

    def combined(self, weights: Sequence[Fraction], others: Sequence[Spline]) -> Spline:
        """Return the weighted sum of other splines, all with the knots of this one."""
        pieces = []
        for parts in zip(*(other.pieces for other in others), strict=True):
            columns = zip(*map(_filled, parts), strict=True)
            pieces.append(
                tuple(
                    sum((w * c for w, c in zip(weights, column, strict=True)), Fraction(0))
                    for column in columns
                )
            )
        return Spline(self.knots, tuple(pieces))


def polynomial(coefficients: Sequence[Any], step: Any) -> Any:
    """Return a polynomial in t - t_0 at a step from t_0, a fraction, double or ball (Horner)."""
    value = 0 * step
    for coefficient in reversed(coefficients):
        value = value * step + coefficient
    return value


@dataclass(frozen=True)
class Table:
    """One output of a table.

    bases: functions φ of each argument
    values: coefficients c, the index of the first argument varies fastest
    """

    bases: tuple[tuple[Spline, ...], ...]
    values: tuple[Fraction, ...]

    def at(self, point: Sequence[float]) -> float:
        """Return the value of the table at a point, in double precision."""
        if not self.bases:
            return float(self.values[0])
        *inner, basis = self.bases
        *before, last = point
        size = len(self.values) // len(basis)
        total = 0.0
        for i, spline in enumerate(basis):
            part = Table(tuple(inner), self.values[i * size : (i + 1) * size])
            factor = spline.at(last)
            total += factor * part.at(before) if factor else 0.0
        return total

    def spline(self) -> Spline:
        """Return a table of one argument as a piecewise polynomial."""
        (basis,) = self.bases
        return basis[0].combined(self.values, basis)

    def layers(self) -> Iterator[tuple[Spline, Table]]:
        """Yield functions of the last argument, and the tables by which they are multiplied.

        Their sum is Σ_i φ_i g_i = g_1 Σ φ_i + Σ_i (φ_i + φ_(i+1) + ..) (g_i - g_(i-1)). Balls of
        the second form are narrower if neighboring g_i differ little.
        """
        *inner, basis = self.bases
        size = len(self.values) // len(basis)
        before = (Fraction(0),) * size
        for i in range(len(basis)):
            values = self.values[i * size : (i + 1) * size]
            change = tuple(a - b for a, b in zip(values, before, strict=True))
            before = values
            if any(change):
                following = basis[i:]
                ones = (Fraction(1),) * len(following)
                sum_of_following = following[0].combined(ones, following)
                yield sum_of_following, Table(tuple(inner), change)


def is_table(function: ca.Function) -> bool:
    """Return whether a function is a table of CasADi, or the Jacobian of a linear table."""
    return function.class_name() in ("LinearInterpolant", "BSplineInterpolant", _DERIVATIVE)


def tables_of(function: ca.Function) -> tuple[Table, ...]:
    """Return the outputs of a table, or the entries of the Jacobian of a linear one, by column.

    Raises BadInputError if the degree is above 3, or if CasADi stores tables in an unknown form.
    """
    return _tables_of(function.serialize({"debug": True}), function)


@lru_cache(maxsize=64)
def _tables_of(stored: str, function: ca.Function) -> tuple[Table, ...]:
    """Return the outputs of a table, which are kept for each serialized form `stored`."""
    entries = _Entries(bytes(_nibbles(stored)), function.name())
    grids = entries.split("Interpolant::grid", "Interpolant::offset")
    bases = [_hats(grid) for grid in grids]
    values = entries.numbers("Interpolant::values")
    if function.class_name() == "BSplineInterpolant":
        knots = entries.split("BSplineCommon::knots", "BSplineCommon::offset")
        degrees = entries.numbers("BSplineCommon::degree")
        if max(degrees) > HIGHEST:
            raise BadInputError(f"{function.name()}: tables of degree {max(degrees):g} are refused")
        bases = [_b_splines(t, int(degree)) for t, degree in zip(knots, degrees, strict=True)]
        values = entries.numbers(_COEFFICIENTS)
    outputs = int(entries.number("Interpolant::m"))
    # Values or coefficients of each output; those of all outputs alternate in `values`.
    exact = [tuple(map(Fraction, values[output::outputs])) for output in range(outputs)]
    if function.class_name() == _DERIVATIVE:
        slopes = [tuple(map(_derivative, basis)) for basis in bases]
        # Column d of the Jacobian: the derivative in argument d.
        columns = [(*bases[:d], slope, *bases[d + 1 :]) for d, slope in enumerate(slopes)]
        return tuple(Table(column, values_of) for column in columns for values_of in exact)
    tables = tuple(Table(tuple(bases), values_of) for values_of in exact)
    _compare(tables, function, np.array([(grid[0], grid[-1]) for grid in grids]))
    return tables


class _Entries:
    """Entries of a function that CasADi has serialized together with their names."""

    def __init__(self, data: bytes, name: str) -> None:
        self._data = data
        self._name = name

    def number(self, key: str) -> float:
        """Return an entry that is a number."""
        return self._number(self._place_after(key))

    def numbers(self, key: str) -> list[float]:
        """Return an entry that is a list of numbers: "V", their count, and the numbers."""
        start = self._place_after(key) + 1
        count = int(self._number(start))
        return [self._number(start + _BYTES * (i + 1)) for i in range(count)]

    def split(self, key: str, offsets: str) -> list[tuple[float, ...]]:
        """Return a list of numbers in parts that begin at the given offsets."""
        numbers = self.numbers(key)
        ends = map(int, self.numbers(offsets))
        return [tuple(numbers[a:b]) for a, b in pairwise(ends)]

    def _number(self, start: int) -> float:
        """Return the number at a place: a letter for its type, and eight bytes."""
        letter = self._data[start : start + 1]
        if letter not in _TYPES:
            raise self._unknown()
        return float(struct.unpack_from(_TYPES[letter], self._data, start + 1)[0])

    def _place_after(self, key: str) -> int:
        """Return the place after the name of an entry."""
        stored = b"si" + struct.pack("<i", len(key)) + key.encode()
        is_last = key == _COEFFICIENTS  # derivatives of the table have entries of this name before
        place = self._data.rfind(stored) if is_last else self._data.find(stored)
        if place < 0:
            raise self._unknown()
        return place + len(stored)

    def _unknown(self) -> BadInputError:
        """Return the error on a table that CasADi stores in an unknown form."""
        return BadInputError(
            f"the table {self._name} is not stored as by CasADi 3.7 and 3.8 (this is CasADi "
            f"{ca.CasadiMeta.version()}); write it as a polynomial"
        )


def _nibbles(text: str) -> Iterator[int]:
    """Yield the bytes of CasADi's text, which has two letters for each byte."""
    for low, high in zip(text[::2], text[1::2], strict=True):
        yield ord(low) - ord("a") + 16 * (ord(high) - ord("a"))


@lru_cache(maxsize=64)
def _hats(grid: tuple[float, ...]) -> tuple[Spline, ...]:
    """Return the hats of a grid, 1 at one of its points and 0 at the others, linear beyond it."""
    hats = []
    x = list(map(Fraction, grid))
    lengths = [after - before for before, after in pairwise(x)]
    for i in range(len(x)):
        values = [Fraction(k == i) for k in range(len(x))]
        slopes = [
            (after - before) / length
            for (before, after), length in zip(pairwise(values), lengths, strict=True)
        ]
        # (value, slope) at the first point for the piece before it, then at every point for the
        # piece after it.
        pieces = [(values[0], slopes[0]), *zip(values, [*slopes, slopes[-1]], strict=True)]
        hats.append(Spline(grid, tuple(pieces)))
    return tuple(hats)


@lru_cache(maxsize=64)
def _b_splines(knots: tuple[float, ...], degree: int) -> tuple[Spline, ...]:
    """Return the B-splines of a sequence of knots (Cox and de Boor), 0 beyond the knots."""
    # On each piece, the B-splines of degree q are polynomials in x = low + s that follow from those
    # of degree q - 1: B_i = (x - t_i) / (t_(i+q) - t_i) B_i + (t_(i+q+1) - x) / (t_(i+q+1) -
    # t_(i+1)) B_(i+1).
    t = list(map(Fraction, knots))
    distinct = sorted(set(t))
    zero: Coefficients = (Fraction(0),)
    count = len(t) - degree - 1
    pieces: list[list[Coefficients]] = [[zero] for _ in range(count)]
    for low, high in pairwise(distinct):
        basis: list[Coefficients] = [
            (Fraction(start <= low and high <= end),) for start, end in pairwise(t)
        ]
        for q in range(1, degree + 1):
            basis = [
                _sum_of(
                    _times_line(basis[i], low - t[i], 1, t[i + q] - t[i]),
                    _times_line(basis[i + 1], t[i + q + 1] - low, -1, t[i + q + 1] - t[i + 1]),
                )
                for i in range(len(basis) - 1)
            ]
        for of_spline, piece in zip(pieces, basis, strict=True):
            of_spline.append(piece)
    grid = tuple(map(float, distinct))
    return tuple(Spline(grid, (*of_spline, zero)) for of_spline in pieces)


def _times_line(piece: Coefficients, at: Fraction, slope: int, span: Fraction) -> Coefficients:
    """Return (at + slope s) / span times a polynomial in s, or 0 if the span is 0."""
    if not span:
        return (Fraction(0),)
    scaled = [c / span for c in piece]
    return _sum_of(tuple(at * c for c in scaled), (Fraction(0), *(slope * c for c in scaled)))


def _sum_of(a: Coefficients, b: Coefficients) -> Coefficients:
    """Return the coefficients of the sum of two polynomials."""
    return tuple(x + y for x, y in zip_longest(a, b, fillvalue=Fraction(0)))


def _filled(piece: Coefficients) -> Coefficients:
    """Return the coefficients with zeros up to the highest degree."""
    return piece + (Fraction(0),) * (HIGHEST + 1 - len(piece))


def _derivative(spline: Spline) -> Spline:
    """Return the derivative of a spline between its knots."""
    # Filled, so that the derivative of a constant keeps the coefficient 0.
    pieces = [tuple(k * c for k, c in enumerate(_filled(piece)))[1:] for piece in spline.pieces]
    return Spline(spline.knots, tuple(pieces))


def _compare(tables: Sequence[Table], function: ca.Function, ends: np.ndarray) -> None:
    """Raise BadInputError if a function differs from its tables at random points within `ends`."""
    points = np.random.default_rng(0).uniform(ends[:, 0], ends[:, 1], (_POINTS, len(ends)))
    found = np.array([[table.at(point) for table in tables] for point in points])
    expected = np.array([function(point).full().ravel() for point in points])
    if not np.all(np.abs(found - expected) <= _SAME * (1.0 + np.abs(expected).max())):
        raise BadInputError(
            f"CasADi {ca.CasadiMeta.version()} computes other values of the table "
            f"{function.name()} than it stores; write it as a polynomial"
        )
