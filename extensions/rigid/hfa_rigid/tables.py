"""Linear interpolation in tables of any number of dimensions, as CasADi expressions."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import casadi as ca
import numpy as np


class Interpolator:
    """Values of tables at expressions, constant beyond the first and the last breakpoint.

    On each axis one comparison for each breakpoint selects the cell. The line of that cell, a level
    and a slope, is selected with these 0-1 numbers, whose derivatives are zero. A derivative
    therefore costs as much as one of y0 + t (y1 - y0), however large the table is. Numbers between
    0 and 1 give a blend of the lines of both cells, so that smooth comparisons make a smooth table.
    At a breakpoint the slope is the one to the right. Tables over the same expression and
    breakpoints share the comparisons.
    """

    def __init__(self) -> None:
        self._axes: dict[tuple[int, bytes], tuple[ca.SX, ca.SX, ca.SX]] = {}

    def __call__(
        self, values: np.ndarray, breakpoints: Sequence[np.ndarray], arguments: Sequence[Any]
    ) -> ca.SX:
        """Return the value at the arguments, one for each axis.

        values: (n1, ..., nd), in row-major order
        breakpoints: d arrays, increasing, of at least two
        arguments: d scalars, numbers or expressions
        """
        axes = [np.asarray(points, dtype=float) for points in breakpoints]
        lines = np.asarray(values, dtype=float)
        for axis, points in enumerate(axes):
            first = 2 * axis
            both = np.stack(lines_of_cells(np.moveaxis(lines, first, 0), points))
            lines = np.moveaxis(both, (0, 1), (first, first + 1))
        cells = [
            self.cell(ca.SX(argument), points)
            for points, argument in zip(axes, arguments, strict=True)
        ]
        return _between(ca.SX(ca.DM(lines.ravel())), cells)

    def cell(self, argument: ca.SX, points: np.ndarray) -> tuple[ca.SX, ca.SX]:
        """Return the indicator (n - 1,) of the argument's cell, and the argument relative to the
        middle.

        The argument is clipped to the breakpoints.
        """
        key = (argument.element_hash(), points.tobytes())
        if key not in self._axes:
            inside = ca.fmin(ca.fmax(argument, points[0]), points[-1])
            above = argument >= ca.SX(ca.DM(points[1:-1]))
            chosen = ca.vertcat(1, above) - ca.vertcat(above, 0)
            self._axes[key] = (chosen, inside - _middle(points), argument)  # it keeps its hash
        chosen, offset, _ = self._axes[key]
        return chosen, offset


def lines_of_cells(values: Any, points: np.ndarray) -> tuple[Any, Any]:
    """Return levels at the middle breakpoint and slopes (n - 1, ...) of the lines between values.

    values: (n, ...), an array, or expressions as a column
    points: (n,)
    """
    column = (-1, *[1] * (len(values.shape) - 1))
    widths = np.diff(points).reshape(column)
    starts = (points[:-1] - _middle(points)).reshape(column)
    slopes = (values[1:] - values[:-1]) / widths
    return values[:-1] - slopes * starts, slopes


def _middle(points: np.ndarray) -> float:
    """Return the breakpoint to which the arguments of lines are relative."""
    return float(points[len(points) // 2])


def _between(lines: ca.SX, cells: Sequence[tuple[ca.SX, ca.SX]]) -> ca.SX:
    """Return the interpolated value of a table of lines in row-major order, one axis after the
    other.

    lines: (2, n1 - 1, 2, n2 - 1, ...), of each axis the levels and the slopes
    """
    if not cells:
        return lines
    chosen, offset = cells[0]
    half = lines.numel() // 2
    count = chosen.numel()
    level, slope = (
        _between(ca.mtimes(ca.reshape(part, half // count, count), chosen), cells[1:])
        for part in (lines[:half], lines[half:])
    )
    return level + offset * slope
