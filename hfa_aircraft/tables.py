"""Linear interpolation in tables of any number of dimensions, as CasADi expressions."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import casadi as ca
import numpy as np


class Interpolator:
    """Values of tables at expressions, constant beyond the first and the last breakpoint.

    On each axis one comparison a breakpoint selects the cell. Its corners are selected with these
    0-1 numbers, whose derivatives are zero, so that a derivative costs as much as one of
    y0 + t (y1 - y0), however large the table is. At a breakpoint the slope is the one to the right.
    Tables over the same expression and breakpoints share the comparisons.
    """

    def __init__(self) -> None:
        self._axes: dict[tuple[int, bytes], tuple[ca.SX, ca.SX, ca.SX]] = {}

    def __call__(
        self, values: np.ndarray, breakpoints: Sequence[np.ndarray], arguments: Sequence[Any]
    ) -> ca.SX:
        """The value at the arguments, one an axis.

        values: (n1, ..., nd), in row-major order. breakpoints: d arrays, increasing, of at least
        two. arguments: d scalars, numbers or expressions.
        """
        corner = ca.SX(ca.DM(np.asarray(values, dtype=float).ravel()))
        cells = [
            self.cell(ca.SX(argument), np.asarray(points, dtype=float))
            for points, argument in zip(breakpoints, arguments, strict=True)
        ]
        return _between(corner, cells)

    def cell(self, argument: ca.SX, points: np.ndarray) -> tuple[ca.SX, ca.SX]:
        """1 at the cell (n - 1,) that holds the argument, and its share of that cell's width."""
        key = (argument.element_hash(), points.tobytes())
        if key not in self._axes:
            inside = ca.fmin(ca.fmax(argument, points[0]), points[-1])
            above = argument >= ca.SX(ca.DM(points[1:-1]))
            chosen = ca.vertcat(1, above) - ca.vertcat(above, 0)
            start = ca.dot(chosen, ca.DM(points[:-1]))
            width = ca.dot(chosen, ca.DM(np.diff(points)))
            self._axes[key] = (chosen, (inside - start) / width, argument)  # it keeps its hash
        chosen, share, _ = self._axes[key]
        return chosen, share


def _between(values: ca.SX, cells: Sequence[tuple[ca.SX, ca.SX]]) -> ca.SX:
    """The interpolated value of a table in row-major order: one axis after the other."""
    if not cells:
        return values
    chosen, share = cells[0]
    count = chosen.numel() + 1
    rows = ca.reshape(values, values.numel() // count, count)
    low = _between(ca.mtimes(rows[:, :-1], chosen), cells[1:])
    high = _between(ca.mtimes(rows[:, 1:], chosen), cells[1:])
    return low + share * (high - low)
