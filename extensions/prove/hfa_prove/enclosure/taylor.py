"""Taylor models of degree 2 over many boxes at once, with rounding errors included.

Over the box center + half_width s, |s_i| <= 1, each value is c_0 + Σ c_i s_i + Σ c_ij s_i s_j
(i <= j) ± radius. Arrays of coefficients have the shape (values, 1 + n + n (n + 1) / 2, boxes).

Rounding: the error of a product or a sum of k terms in doubles is at most
(k + 1) u / (1 - (k + 1) u) times the sum of the absolute values of the terms, u = 2⁻⁵³ (Higham,
Accuracy and Stability of Numerical Algorithms, Section 3.1). This sum is at most `size`, the sum of
all |c| and the radius. A multiple of `size` is added to the radius, and the radius is rounded
upward by a factor.

Source: Makino and Berz, Taylor models and other validated functional inclusion methods, IJPAM 4
(2003).
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np

from hfa_prove.enclosure.elementary import TINY, UNIT, UPWARD
from hfa_prove.enclosure.lines import Parabola, Ranges, enclosed
from hfa_prove.enclosure.program import Argument, Group, Kind, Program

#: Largest error of a coefficient of a product, or of a function of one variable, relative to the
#: sizes: at most 8 terms, twice.
_PRODUCT = 16.0 * UNIT
#: Approximate number of entries in the arrays of a batch.
_NUMBERS = 2**18
#: Largest number of boxes of a batch.
_MOST_BOXES = 512


class Pairs(NamedTuple):
    """Indices of the products s_i s_j with i <= j, in the order of their coefficients.

    first, second: i and j of each product
    factor: (pairs, 1), 2 for i < j, else 1
    """

    first: np.ndarray
    second: np.ndarray
    factor: np.ndarray


@lru_cache(maxsize=16)
def pairs_of(n: int) -> Pairs:
    """Return the index pairs (i, j) with i <= j, in the order (0, 0), (0, 1), .., (1, 1), ..

    n: number of variables s_i
    """
    first, second = np.triu_indices(n)
    return Pairs(first, second, np.where(first < second, 2.0, 1.0)[:, None])


class Models(NamedTuple):
    """Taylor models of values over boxes.

    c: coefficients, (values, 1 + n + n (n + 1) / 2, boxes)
    radius: radii, (values, boxes)
    own: (values, boxes), the part of each radius that is caused by the last operation itself, not
        by the radii of its arguments
    """

    c: np.ndarray
    radius: np.ndarray
    own: np.ndarray

    @property
    def value(self) -> np.ndarray:
        """Values at the centers of the boxes without the radii, (values, boxes)."""
        return self.c[:, 0]

    def part(self, values: np.ndarray, boxes: np.ndarray) -> Models:
        """Return models of one value on each of the selected boxes.

        values, boxes: (N,), index of the value and index of the box
        """
        of_radius = (each[values, boxes][None] for each in (self.radius, self.own))
        return Models(self.c[values, :, boxes].T[None], *of_radius)


class Step(NamedTuple):
    """Models of a group of nodes and of their arguments.

    arguments: models of the rows of each argument
    factors: for each argument, (values, boxes), the derivative by which an error of the argument
        enters the node
    nodes: models of the nodes
    """

    arguments: Sequence[Models]
    factors: Sequence[np.ndarray]
    nodes: Models


class Traced(NamedTuple):
    """Models of all values of a program.

    inputs: models of the inputs
    steps: models of each group of nodes, in the order of evaluation
    outputs: models of the outputs
    """

    inputs: Models
    steps: Sequence[Step]
    outputs: Models


class Sharpened(NamedTuple):
    """Lower bounds of one output on each box.

    lowest: lower bounds, (boxes,)
    lowered_by: (boxes, n), approximate amount by which the range of each s_i lowers the bound
    """

    lowest: np.ndarray
    lowered_by: np.ndarray


class _Sizes(NamedTuple):
    """Bounds on the size of Taylor models, each (values, boxes).

    linear: upper bounds of |Σ c_i s_i|
    square: upper bounds of |Σ c_ij s_i s_j|
    whole: upper bounds of the absolute value
    """

    linear: np.ndarray
    square: np.ndarray
    whole: np.ndarray


def _sizes(models: Models, n: int) -> _Sizes:
    sizes = np.abs(models.c)
    linear = sizes[:, 1 : n + 1].sum(axis=1)
    square = sizes[:, n + 1 :].sum(axis=1)
    whole = (sizes[:, 0] + linear + square + models.radius) * UPWARD
    return _Sizes(linear, square, whole)


class TaylorProgram:
    """Evaluation of a program on boxes by Taylor models.

    program: the program
    n: dimension of the boxes
    """

    def __init__(self, program: Program, n: int) -> None:
        self.program = program
        self.n = n
        self._pairs = pairs_of(self.n)
        terms = sum(program.widths) + len(program.widths) + 20
        self._row = 1.01 * terms * UNIT
        coefficients = 1 + self.n + len(self._pairs.first)
        numbers = coefficients * max(program.widths)
        self.at_once = int(np.clip(_NUMBERS // numbers, 16, _MOST_BOXES))

    def over(self, centres: np.ndarray, half_widths: np.ndarray) -> Models:
        """Return Taylor models of the outputs over boxes of the inputs.

        centres, half_widths: centers and half-widths of the boxes, (boxes, n)
        """
        n = self.n
        linear = np.zeros((n, 1 + n, len(centres)))
        linear[:, 0] = centres.T
        linear[np.arange(n), np.arange(1, n + 1)] = half_widths.T
        return self.of(linear, np.zeros((n, len(centres))))

    def of(self, linear: np.ndarray, radius: np.ndarray) -> Models:
        """Return Taylor models of the outputs for inputs c_0 + Σ c_i s_i ± radius.

        An output with an infinite or nan radius has no bound.

        linear: coefficients c of the inputs, (inputs, 1 + n, boxes)
        radius: radii of the inputs, (inputs, boxes)
        """
        return self.traced(linear, radius).outputs

    def traced(self, linear: np.ndarray, radius: np.ndarray) -> Traced:
        """Return Taylor models of the inputs, of all nodes and of the outputs.

        linear: coefficients c of the inputs, (inputs, 1 + n, boxes)
        radius: radii of the inputs, (inputs, boxes)
        """
        with np.errstate(all="ignore"):
            return self._traced(linear, radius)

    def _traced(self, linear: np.ndarray, radius: np.ndarray) -> Traced:
        n = self.n
        inputs, _, boxes = linear.shape
        c = np.zeros((1 + inputs, 1 + n + len(self._pairs.first), boxes))
        c[0, 0] = 1.0
        c[1:, : 1 + n] = linear
        radii = np.concatenate([np.zeros((1, boxes)), radius])
        known = [Models(c, radii, radii)]
        sizes = [_sizes(known[0], n).whole]
        steps = []
        for group in self.program.groups:
            step = self._step(group, known, sizes)
            steps.append(step)
            known.append(step.nodes)
            sizes.append(_sizes(step.nodes, n).whole)
        return Traced(known[0], steps, self._rows(self.program.outputs, known, sizes))

    def _step(self, group: Group, known: Sequence[Models], sizes: Sequence[np.ndarray]) -> Step:
        arguments = [self._rows(argument, known, sizes) for argument in group.arguments]
        if group.kind == "product":
            return self._product(*arguments)
        return self._function(group.kind, arguments[0])

    def sharpened(self, traced: Traced, which: np.ndarray, boxes: np.ndarray) -> Sharpened:
        """Return sharper lower bounds of one output on each box.

        The error of an output is the sum over all nodes of the node's own error times its weight.
        The weight is the sum of the signed products of factors over all paths from the node to the
        output. The bounds are at least as high as the bounds by `lowest`.

        traced: models of all values of the program
        which: (N,), index of the output for each box
        boxes: (N,), indices of the boxes
        """
        n = self.n
        with np.errstate(all="ignore"):
            total, causes = self._errors(traced, which, boxes)
            model = traced.outputs.part(which, boxes)
            # rounding of the weights is relative to sizes that the radius includes
            bound = (total + 4.0 * self._row * model.radius) * UPWARD + TINY
            model = model._replace(radius=np.fmin(bound, model.radius))
            return Sharpened(lowest(model, n)[0], (amounts_by_edge(model, n)[0] + causes).T)

    def _errors(
        self, traced: Traced, which: np.ndarray, boxes: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return bounds of the errors of outputs, and the part of each bound that each s_i causes.

        The first array, (N,), is the sum over all operations of the own error times the absolute
        value of its weight. The second array, (n, N), is approximate.

        traced: models of all values of the program
        which: (N,), index of the output for each box
        boxes: (N,), indices of the boxes
        """
        total = traced.outputs.own[which, boxes]
        causes = np.zeros((self.n, len(boxes)))
        weights: dict[int, Any] = {
            group: _dense(block)[which].T for group, block in self.program.outputs.blocks.items()
        }
        groups = list(zip(self.program.groups, traced.steps, strict=True))
        for number, (group, step) in reversed(list(enumerate(groups, start=1))):
            weight = weights.pop(number, None)
            if weight is None:
                continue
            own = np.abs(weight) * step.nodes.own[:, boxes]
            total = total + own.sum(axis=0)
            for argument, rows, factor in zip(
                group.arguments, step.arguments, step.factors, strict=True
            ):
                causes += _caused(own, rows.c[:, 1 : self.n + 1, boxes]) / len(group.arguments)
                along = weight * factor[:, boxes]
                total = total + np.sum(np.abs(along) * rows.own[:, boxes], axis=0)
                for earlier, block in argument.blocks.items():
                    weights[earlier] = weights.get(earlier, 0.0) + block.T @ along
        if 0 in weights:
            total = total + np.sum(np.abs(weights[0]) * traced.inputs.own[:, boxes], axis=0)
        return total, causes

    def _rows(
        self, argument: Argument, known: Sequence[Models], sizes: Sequence[np.ndarray]
    ) -> Models:
        """Return models of the rows of an argument, from models and sizes of earlier groups."""
        c: np.ndarray | float = 0.0
        radius: np.ndarray | float = 0.0
        size: np.ndarray | float = 0.0
        for group, block in argument.blocks.items():
            models = known[group]
            width, coefficients, boxes = models.c.shape
            flat = block @ models.c.reshape(width, coefficients * boxes)
            c = c + flat.reshape(-1, coefficients, boxes)
            weights = argument.sizes[group]
            radius = radius + weights @ models.radius
            size = size + weights @ sizes[group]
        if isinstance(c, float):  # a row without terms
            zero = np.zeros_like(known[0].radius[:1])
            return Models(np.zeros_like(known[0].c[:1]), zero, zero)
        own = np.asarray(self._row * size) * UPWARD + TINY
        return Models(c, (radius + own) * UPWARD, own)

    def _product(self, a: Models, b: Models) -> Step:
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
        size_a = np.abs(a.value)
        size_b = np.abs(b.value)
        own = of_a.linear * of_b.square + of_a.square * of_b.linear + of_a.square * of_b.square
        own += (of_a.whole - size_a) * b.radius + (of_b.whole - size_b) * a.radius
        own = (own + _PRODUCT * of_a.whole * of_b.whole) * UPWARD + TINY
        radius = (own + size_a * b.radius + size_b * a.radius) * UPWARD
        return Step((a, b), (b.value, a.value), Models(c, radius, own))

    def _function(self, kind: Kind, a: Models) -> Step:
        """Return models of a function of one variable.

        On each box, the function is enclosed by a parabola or a line, whichever has the smaller
        remainder.

        kind: kind of the node
        a: models of the argument
        """
        n = self.n
        sizes = _sizes(a, n)
        centre = a.value
        deviation = (sizes.linear + sizes.square + a.radius) * UPWARD
        slack = deviation + 4.0 * UNIT * np.abs(centre)
        ranges: Ranges = (centre, centre - slack, centre + slack)
        beyond_linear = sizes.square + a.radius
        # bound of d² - (Σ c_i s_i)²
        of_square = beyond_linear * (2.0 * sizes.linear + beyond_linear)
        parabola = enclosed(kind).nearest(ranges, of_square)
        return self._composed(parabola, a, of_square, deviation)

    def _composed(
        self, parabola: Parabola, a: Models, of_square: np.ndarray, deviation: np.ndarray
    ) -> Step:
        n = self.n
        i, j, factor = self._pairs
        slope = np.abs(parabola.slope)
        bend = np.abs(parabola.bend)
        c = a.c * parabola.slope[:, None]
        c[:, 0] = parabola.value
        a1 = a.c[:, 1 : n + 1]
        c[:, n + 1 :] += parabola.bend[:, None] * (factor * (a1[:, i] * a1[:, j]))
        size = np.abs(parabola.value) + deviation * (slope + bend * deviation)
        own = (parabola.rest + bend * of_square + _PRODUCT * size) * UPWARD + TINY
        radius = (own + slope * a.radius) * UPWARD
        return Step((a,), (parabola.slope,), Models(c, radius, own))


def _dense(block: Any) -> np.ndarray:
    return block if isinstance(block, np.ndarray) else np.asarray(block.toarray())


def _caused(errors: np.ndarray, linear: np.ndarray) -> np.ndarray:
    """Return the approximate part of the sum of errors that each s_i causes, (n, boxes).

    The error of a value is divided in proportion to the absolute coefficients of s_i in the
    argument.

    errors: errors of the values, (values, boxes)
    linear: coefficients of the arguments, (values, n, boxes)
    """
    sizes = np.abs(linear)
    shares = errors / (sizes.sum(axis=1) + TINY)
    return np.asarray(np.einsum("vnb,vb->nb", sizes, shares))


def lowest(models: Models, n: int) -> np.ndarray:
    """Return lower bounds of Taylor models on the boxes, (values, boxes).

    Each bound is the larger of two bounds. In the first, each product s_i s_j with i < j is at
    least -1 and at most 1. In the second, the product is within ±(s_i² + s_j²) / 2. The remaining
    terms are a parabola in each s_i, which is minimized exactly.

    n: dimension of the boxes
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
        return np.asarray(bound - 8.0 * (len(i) + n + 10) * UNIT * size - TINY)


def highest(models: Models, n: int) -> np.ndarray:
    """Return upper bounds of Taylor models on the boxes, (values, boxes).

    n: dimension of the boxes
    """
    return -lowest(models._replace(c=-models.c), n)


def _lowest_parabolas(linear: np.ndarray, squares: np.ndarray) -> np.ndarray:
    """Return the minimum of squares s² - linear s over |s| <= 1, entry by entry, linear >= 0."""
    inside = 2.0 * squares > linear
    at_vertex = -(linear**2) / (4.0 * np.where(inside, squares, 1.0))
    return np.asarray(np.where(inside, at_vertex, squares - linear))


def amounts_by_edge(models: Models, n: int) -> np.ndarray:
    """Return approximate amounts by which each s_i lowers the minimum of Taylor models.

    The array has the shape (values, n, boxes). The amounts are those of the second bound in
    `lowest`. No proof depends on these amounts.
    """
    linear, squares, shares = _parabolas(models, n)
    return -_lowest_parabolas(linear, squares - shares)


def _parabolas(models: Models, n: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return three arrays of coefficients of Taylor models, each (values, n, boxes).

    The arrays contain |c_i|, c_ii, and half the sum of |c_ij| over j != i.
    """
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
