"""Values of a program at points, and its range and Jacobian over one box by the chain rule.

At a kink, the slopes of a node include Clarke's generalized gradient. Hence, for all y and w in the
box, F(y) - F(w) = J (y - w) for some J in the enclosure (Clarke, Optimization and Nonsmooth
Analysis, 1983, Proposition 2.6.5).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from hfa_prove.enclosure.elementary import TINY, UNIT, UPWARD
from hfa_prove.enclosure.lines import enclosed
from hfa_prove.enclosure.program import Argument, Kind, Program

#: Number of points at a time, whose values fit in the cache of a processor.
_TOGETHER = 4000


class Intervals(NamedTuple):
    """Intervals middle ± radius, with both arrays of the same shape."""

    middle: np.ndarray
    radius: np.ndarray

    @property
    def is_bounded(self) -> bool:
        """Whether all ends are finite."""
        return bool(np.all(np.isfinite(self.middle) & np.isfinite(self.radius)))

    @property
    def low(self) -> np.ndarray:
        """Lower ends, rounded downward."""
        return self.middle - self.radius * UPWARD - 4.0 * UNIT * np.abs(self.middle)

    @property
    def high(self) -> np.ndarray:
        """Upper ends, rounded upward."""
        return self.middle + self.radius * UPWARD + 4.0 * UNIT * np.abs(self.middle)

    def times(self, other: Intervals) -> Intervals:
        """Return enclosures of the products, entry by entry."""
        middle = self.middle * other.middle
        radius = np.abs(self.middle) * other.radius + np.abs(other.middle) * self.radius
        radius = radius + self.radius * other.radius + 4.0 * UNIT * np.abs(middle)
        return Intervals(middle, radius * UPWARD + TINY)

    def plus(self, other: Intervals) -> Intervals:
        """Return enclosures of the sums, entry by entry."""
        middle = self.middle + other.middle
        radius = self.radius + other.radius + 2.0 * UNIT * np.abs(middle)
        return Intervals(middle, radius * UPWARD)


class Jacobian(NamedTuple):
    """Enclosures of a program and of its Jacobian over a box.

    values: enclosures of the outputs, (k,)
    slopes: enclosures of the entries of the Jacobian, (k, inputs)
    """

    values: Intervals
    slopes: Intervals


def between(low: np.ndarray, high: np.ndarray) -> Intervals:
    """Return intervals that contain [low, high], entry by entry."""
    middle = 0.5 * (low + high)
    radius = np.maximum(high - middle, middle - low) * UPWARD
    return Intervals(middle, radius + 2.0 * UNIT * np.abs(middle))


def jacobian(program: Program, box: Intervals) -> Jacobian:
    """Return enclosures of the outputs of a program and of their Jacobian over a box.

    box: intervals of the inputs, (inputs,)
    """
    n = program.inputs
    with np.errstate(all="ignore"):
        values = Intervals(np.append(1.0, box.middle), np.append(0.0, box.radius))
        slopes = Intervals(np.vstack([np.zeros(n), np.eye(n)]), np.zeros((1 + n, n)))
        known = [Jacobian(values, slopes)]
        for group in program.groups:
            arguments = [_rows(argument, known) for argument in group.arguments]
            known.append(_result(group.kind, arguments))
        return _rows(program.outputs, known)


def values_at(program: Program, points: np.ndarray) -> np.ndarray:
    """Return the outputs (N, outputs) of a program at points (N, inputs), in double precision.

    An output is inf or nan where it is undefined. No proof depends on these values.
    """
    with np.errstate(all="ignore"):
        parts = [
            _values_at(program, points[first : first + _TOGETHER])
            for first in range(0, max(len(points), 1), _TOGETHER)
        ]
    return np.concatenate(parts)


def _values_at(program: Program, points: np.ndarray) -> np.ndarray:
    known = [np.vstack([np.ones(len(points)), points.T])]
    for group in program.groups:
        arguments = [_values_of(argument, known) for argument in group.arguments]
        function = np.multiply if group.kind == "product" else enclosed(group.kind).value
        known.append(function(*arguments))
    return _values_of(program.outputs, known).T


def _values_of(argument: Argument, known: Sequence[np.ndarray]) -> np.ndarray:
    """Return the values (nodes, N) of one argument of all nodes of a group."""
    total = np.zeros((1, known[0].shape[1]))
    for group, block in argument.blocks.items():
        total = total + block @ known[group]
    return total


def _rows(argument: Argument, known: list[Jacobian]) -> Jacobian:
    parts = []
    for which in range(2):
        middle: np.ndarray | float = 0.0
        radius: np.ndarray | float = 0.0
        size: np.ndarray | float = 0.0
        terms = 4
        for group, block in argument.blocks.items():
            part = known[group][which]
            weights = argument.sizes[group]
            middle = middle + block @ part.middle
            radius = radius + weights @ part.radius
            size = size + weights @ (np.abs(part.middle) + part.radius)
            terms += block.shape[1] + 1
        rounding = 4.0 * terms * UNIT * size
        parts.append(Intervals(np.asarray(middle), np.asarray((radius + rounding) * UPWARD)))
    return Jacobian(*parts)


def _result(kind: Kind, arguments: list[Jacobian]) -> Jacobian:
    a = arguments[0]
    if kind == "product":
        b = arguments[1]
        slopes = _scaled(a.slopes, b.values).plus(_scaled(b.slopes, a.values))
        return Jacobian(a.values.times(b.values), slopes)
    low = a.values.low
    high = a.values.high
    function = enclosed(kind)
    ends = function.slopes(low, high)
    steepness = between(ends.low, ends.high)
    reach = np.maximum(high - a.values.middle, a.values.middle - low) * UPWARD
    parabola = function.nearest((a.values.middle, low, high), reach**2)
    radius = parabola.rest + reach * (np.abs(parabola.slope) + reach * np.abs(parabola.bend))
    radius = (radius + 4.0 * UNIT * np.abs(parabola.value)) * UPWARD + TINY
    return Jacobian(Intervals(parabola.value, radius), _scaled(a.slopes, steepness))


def _scaled(slopes: Intervals, factors: Intervals) -> Intervals:
    """Return the rows of slopes (k, inputs), each multiplied by its factor (k,)."""
    columns = Intervals(factors.middle[:, None], factors.radius[:, None])
    return slopes.times(columns)
