"""Linear interpolation in tables with any number of arguments, as CasADi expressions."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import casadi as ca
import numpy as np


class Interpolator:
    """Linear interpolation of tables at CasADi expressions.

    Tables are constant beyond the first and last breakpoint. At a breakpoint, the slope is that of
    the cell to the right.

    The cell of an argument is selected by comparisons, which are 0 or 1 and have zero derivatives.
    The cost of a table's derivative is therefore independent of the size of the table. If a smooth
    function with values between 0 and 1 replaces the comparisons, the table becomes smooth. Tables
    over the same expression and breakpoints share the comparisons.
    """

    def __init__(self) -> None:
        self._axes: dict[tuple[int, bytes], tuple[ca.SX, ca.SX, ca.SX]] = {}

    def __call__(
        self, values: np.ndarray, breakpoints: Sequence[np.ndarray], arguments: Sequence[Any]
    ) -> ca.SX:
        """Return the interpolated value of a table with d arguments.

        values: (n1, ..., nd), in row-major order
        breakpoints: d increasing arrays with at least two entries
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
        """Return an indicator of the argument's cell, and the argument's distance from `_middle`.

        The indicator (n - 1,) is 1 in the cell and 0 elsewhere. The argument is limited to the
        range of the breakpoints.

        points: breakpoints, (n,)
        """
        key = (argument.element_hash(), points.tobytes())
        if key not in self._axes:
            inside = ca.fmin(ca.fmax(argument, points[0]), points[-1])
            above = argument >= ca.SX(ca.DM(points[1:-1]))
            chosen = ca.vertcat(1, above) - ca.vertcat(above, 0)
            self._axes[key] = (chosen, inside - _middle(points), argument)  # fixes its hash
        chosen, offset, _ = self._axes[key]
        return chosen, offset


def lines_of_cells(values: Any, points: np.ndarray) -> tuple[Any, Any]:
    """Return the lines that interpolate a table in its cells, as levels and slopes.

    The level is the value of the line at the middle breakpoint. Both arrays have the shape (n - 1,
    ...).

    values: values at the breakpoints, (n, ...), an array, or expressions as a column
    points: breakpoints, (n,)
    """
    column = (-1, *[1] * (len(values.shape) - 1))
    widths = np.diff(points).reshape(column)
    starts = (points[:-1] - _middle(points)).reshape(column)
    slopes = (values[1:] - values[:-1]) / widths
    return values[:-1] - slopes * starts, slopes


def _middle(points: np.ndarray) -> float:
    """Return the middle breakpoint, relative to which the arguments of lines are measured."""
    return float(points[len(points) // 2])


def _between(lines: ca.SX, cells: Sequence[tuple[ca.SX, ca.SX]]) -> ca.SX:
    """Return the interpolated value of a table of lines."""
    # lines (2, n1 - 1, 2, n2 - 1, ...)
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
