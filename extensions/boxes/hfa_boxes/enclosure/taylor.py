"""Taylor models of degree 2 over many boxes at once, rounding included.

Over the box center + half_width s, |s_i| <= 1, each value is c_0 + Σ c_i s_i + Σ c_ij s_i s_j
(i <= j) ± radius. Arrays of coefficients have the shape (values, 1 + n + n (n + 1) / 2, boxes).

Rounding. A product or a sum of k terms in doubles is off by at most (k + 1) u / (1 - (k + 1) u)
times the sum of their sizes, u = 2⁻⁵³ (Higham, Accuracy and Stability of Numerical Algorithms,
Section 3.1). `size`, the sum of all |c| and the radius, bounds the terms; a multiple of it is added
to the radius. A radius itself is rounded upward by a factor. Sources: Makino and Berz, Taylor
models and other validated functional inclusion methods, IJPAM 4 (2003)."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from hfa_boxes.enclosure.functions import ENCLOSED, Parabola, Ranges
from hfa_boxes.enclosure.program import Argument, Group, Program

#: Unit of rounding.
_U = 2.0**-53
#: Largest error of a coefficient of a product, or of a function of one variable, relative to the
#: sizes: at most 8 terms, twice.
_PRODUCT = 16.0 * _U
#: Factor that rounds radii upward, which are sums of at most some hundred terms.
_UPWARD = 1.0 + 1e-12
#: More than every underflow of an operation.
_TINY = 1e-290
#: Approximate number of entries in the arrays of a batch.
_NUMBERS = 2**18
#: Largest number of boxes of a batch.
_MOST_BOXES = 512


class Pairs(NamedTuple):
    """Indices of the coefficients of s_i s_j, i <= j.

    first, second: i and j of each product
    factor: 2 for i < j, else 1, as a column
    """

    first: np.ndarray
    second: np.ndarray
    factor: np.ndarray


@lru_cache(maxsize=16)
def pairs_of(n: int) -> Pairs:
    """Return the pairs in the order (0, 0), (0, 1), .., (1, 1), .."""
    first, second = np.triu_indices(n)
    return Pairs(first, second, np.where(first < second, 2.0, 1.0)[:, None])


class Models(NamedTuple):
    """Taylor models of values over boxes.

    c: (values, 1 + n + n (n + 1) / 2, boxes), coefficients
    radius: (values, boxes), radii
    """

    c: np.ndarray
    radius: np.ndarray

    @property
    def value(self) -> np.ndarray:
        """Value at the center, without the radius."""
        return self.c[:, 0]

    def part(self, values: np.ndarray, boxes: np.ndarray) -> Models:
        """Return one model whose value on each box is that of the index in `values`."""
        return Models(self.c[values, :, boxes].T[None], self.radius[values, boxes][None])


class _Sizes(NamedTuple):
    """Bounds of |Σ c_i s_i|, of |Σ c_ij s_i s_j|, and of the whole value."""

    linear: np.ndarray
    square: np.ndarray
    whole: np.ndarray


def _sizes(models: Models, n: int) -> _Sizes:
    sizes = np.abs(models.c)
    linear = sizes[:, 1 : n + 1].sum(axis=1)
    square = sizes[:, n + 1 :].sum(axis=1)
    whole = (sizes[:, 0] + linear + square + models.radius) * _UPWARD
    return _Sizes(linear, square, whole)


class TaylorProgram:
    """Evaluation of a program on boxes by Taylor models.

    n: dimension of the boxes
    """

    def __init__(self, program: Program, n: int) -> None:
        self.program = program
        self.n = n
        self._pairs = pairs_of(self.n)
        terms = sum(program.widths) + len(program.widths) + 20
        self._row = 1.01 * terms * _U
        coefficients = 1 + self.n + len(self._pairs.first)
        numbers = coefficients * max(program.widths)
        self.at_once = int(np.clip(_NUMBERS // numbers, 16, _MOST_BOXES))

    def over(self, centres: np.ndarray, half_widths: np.ndarray) -> Models:
        """Return models of the outputs over the input boxes centres ± half_widths, (boxes, n)
        each."""
        n = self.n
        linear = np.zeros((n, 1 + n, len(centres)))
        linear[:, 0] = centres.T
        linear[np.arange(n), np.arange(1, n + 1)] = half_widths.T
        return self.of(linear, np.zeros((n, len(centres))))

    def of(self, linear: np.ndarray, radius: np.ndarray) -> Models:
        """Return models of the outputs for inputs c_0 + Σ c_i s_i ± radius.

        An output whose radius is infinite or nan has no bound.

        linear: (inputs, 1 + n, boxes), coefficients c
        radius: (inputs, boxes)
        """
        with np.errstate(all="ignore"):
            return self._of(linear, radius)

    def _of(self, linear: np.ndarray, radius: np.ndarray) -> Models:
        n = self.n
        inputs, _, boxes = linear.shape
        c = np.zeros((1 + inputs, 1 + n + len(self._pairs.first), boxes))
        c[0, 0] = 1.0
        c[1:, : 1 + n] = linear
        known = [Models(c, np.concatenate([np.zeros((1, boxes)), radius]))]
        sizes = [_sizes(known[0], n).whole]
        for group in self.program.groups:
            models = self._result(group, known, sizes)
            known.append(models)
            sizes.append(_sizes(models, n).whole)
        return self._rows(self.program.outputs, known, sizes)

    def _result(self, group: Group, known: Sequence[Models], sizes: Sequence[np.ndarray]) -> Models:
        arguments = [self._rows(argument, known, sizes) for argument in group.arguments]
        if group.kind == "product":
            return self._product(*arguments)
        return self._function(group.kind, arguments[0])

    def _rows(
        self, argument: Argument, known: Sequence[Models], sizes: Sequence[np.ndarray]
    ) -> Models:
        """Return models of the rows of an argument: sums of coefficients times known models."""
        c: np.ndarray | float = 0.0
        radius: np.ndarray | float = 0.0
        size: np.ndarray | float = 0.0
        for group, block in argument.blocks.items():
            models = known[group]
            width, coefficients, boxes = models.c.shape
            flat = block @ models.c.reshape(width, coefficients * boxes)
            c = c + flat.reshape(-1, coefficients, boxes)
            weights = abs(block)
            radius = radius + weights @ models.radius
            size = size + weights @ sizes[group]
        if isinstance(c, float):  # a row without terms
            first = known[0]
            return Models(np.zeros_like(first.c[:1]), np.zeros_like(first.radius[:1]))
        rounded = np.asarray(radius + self._row * size)
        return Models(c, rounded * _UPWARD + _TINY)

    def _product(self, a: Models, b: Models) -> Models:
        n = self.n
        i, j, factor = self._pairs
        of_a = _sizes(a, n)
        of_b = _sizes(b, n)
        a0 = a.c[:, :1]
        b0 = b.c[:, :1]
        c = a0 * b.c + b0 * a.c
        c[:, 0] *= 0.5
        a1 = a.c[:, 1 : n + 1]
        b1 = b.c[:, 1 : n + 1]
        crossed = a1[:, i] * b1[:, j] + a1[:, j] * b1[:, i]
        c[:, n + 1 :] += 0.5 * factor * crossed
        rest = of_a.linear * of_b.square + of_a.square * of_b.linear + of_a.square * of_b.square
        rest += of_a.whole * b.radius + of_b.whole * a.radius
        radius = (rest + _PRODUCT * of_a.whole * of_b.whole) * _UPWARD + _TINY
        return Models(c, radius)

    def _function(self, kind: str, a: Models) -> Models:
        """Return a function of one variable: its curve or its line, whichever has the smaller
        remainder."""
        n = self.n
        sizes = _sizes(a, n)
        centre = a.value
        deviation = (sizes.linear + sizes.square + a.radius) * _UPWARD
        slack = deviation + 4.0 * _U * np.abs(centre)
        ranges: Ranges = (centre, centre - slack, centre + slack)
        enclosed = ENCLOSED[kind]
        beyond_linear = sizes.square + a.radius
        # d² = (Σ c_i s_i)² and a rest
        of_square = beyond_linear * (2.0 * sizes.linear + beyond_linear)
        parabola = None
        for enclose in (enclosed.curve, enclosed.line):
            if enclose is None:
                continue
            found = enclose(ranges)
            if parabola is None:
                parabola = found
                continue
            parabola = _nearer(parabola, found, of_square)
        assert parabola is not None
        return self._composed(parabola, a, of_square, deviation)

    def _composed(
        self, parabola: Parabola, a: Models, of_square: np.ndarray, deviation: np.ndarray
    ) -> Models:
        n = self.n
        i, j, factor = self._pairs
        slope = np.abs(parabola.slope)
        bend = np.abs(parabola.bend)
        c = a.c * parabola.slope[:, None]
        c[:, 0] = parabola.value
        a1 = a.c[:, 1 : n + 1]
        c[:, n + 1 :] += parabola.bend[:, None] * (factor * (a1[:, i] * a1[:, j]))
        radius = parabola.rest + slope * a.radius + bend * of_square
        size = np.abs(parabola.value) + deviation * (slope + bend * deviation)
        return Models(c, (radius + _PRODUCT * size) * _UPWARD + _TINY)


def _nearer(curve: Parabola, line: Parabola, of_square: np.ndarray) -> Parabola:
    """Return the line where the remainder of the curve is larger or nan."""
    is_curve = curve.rest + np.abs(curve.bend) * of_square <= line.rest
    return Parabola(*(np.where(is_curve, a, b) for a, b in zip(curve, line, strict=True)))


def lowest(models: Models, n: int) -> np.ndarray:
    """Return a lower bound on each box, (values, boxes): the larger of two bounds of the parabola.

    One bounds each product s_i s_j, i < j, by ±1, the other by ±(s_i² + s_j²) / 2. The remainder is
    a parabola in each s_i, whose lowest value is known.
    """
    i, j, _ = pairs_of(n)
    c = models.c
    with np.errstate(all="ignore"):
        linear, squares, shares = _parabolas(models, n)
        mixed = np.abs(c[:, n + 1 :][:, i != j]).sum(axis=1)
        one = _lowest_parabolas(linear, squares).sum(axis=1) - mixed
        other = _lowest_parabolas(linear, squares - shares).sum(axis=1)
        size = np.abs(c).sum(axis=1) + models.radius
        bound = c[:, 0] + np.maximum(one, other) - models.radius
        return np.asarray(bound - 8.0 * (len(i) + n + 10) * _U * size - _TINY)


def highest(models: Models, n: int) -> np.ndarray:
    """Return upper bounds on the boxes, (values, boxes)."""
    return -lowest(Models(-models.c, models.radius), n)


def _lowest_parabolas(linear: np.ndarray, squares: np.ndarray) -> np.ndarray:
    """Return the lowest b_i s + c_i s² over |s| <= 1 for each i, with b_i = -linear."""
    inside = 2.0 * squares > linear
    at_vertex = -(linear**2) / (4.0 * np.where(inside, squares, 1.0))
    return np.asarray(np.where(inside, at_vertex, squares - linear))


def lowered_by(models: Models, n: int) -> np.ndarray:
    """Return the amounts by which each s_i lowers the second bound of `lowest`, (values, n, boxes).

    No proof depends on them.
    """
    linear, squares, shares = _parabolas(models, n)
    return -_lowest_parabolas(linear, squares - shares)


def _parabolas(models: Models, n: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return |c_i|, c_ii and Σ |c_ij| / 2 over j != i, (values, n, boxes) each."""
    i, j, _ = pairs_of(n)
    is_square = i == j
    second = models.c[:, n + 1 :]
    mixed = 0.5 * np.abs(second[:, ~is_square])
    squares = second[:, is_square]
    shares = np.zeros_like(squares)
    for k, pair in enumerate(zip(i[~is_square], j[~is_square], strict=True)):
        for index in pair:
            shares[:, index] += mixed[:, k]
    return np.abs(models.c[:, 1 : n + 1]), squares, shares
