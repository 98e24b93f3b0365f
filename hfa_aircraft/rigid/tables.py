"""Linear interpolation in tables with any number of arguments, as CasADi expressions."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import casadi as ca
import numpy as np


class Interval(NamedTuple):
    """Interval between two breakpoints in which an argument of a table lies.

    indicator: 1 for the cell and 0 for all others, (n - 1,)
    offset: argument, limited to the range of the breakpoints, minus `_middle` of them
    """

    indicator: ca.SX
    offset: ca.SX


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
        #: (hash of an argument, breakpoints) -> its cell, and the argument, which keeps its hash.
        self._cells: dict[tuple[int, bytes], tuple[Interval, ca.SX]] = {}

    def __call__(
        self, values: np.ndarray, breakpoints: Sequence[np.ndarray], arguments: Sequence[Any]
    ) -> ca.SX:
        """Return the interpolated value of a table with d arguments.

        values: (n1, ..., nd), in row-major order
        breakpoints: d increasing arrays with at least two entries
        arguments: d scalars, numbers or expressions
        """
        axes = [np.asarray(points, dtype=float) for points in breakpoints]
        # In each cell of an argument, the table is the line level + slope * offset. The axis of its
        # breakpoints in `lines` is therefore replaced by two axes: (level, slope), and the cells.
        lines = np.asarray(values, dtype=float)
        for number, points in enumerate(axes):
            axis = 2 * number
            levels_and_slopes = np.stack(lines_of_cells(np.moveaxis(lines, axis, 0), points))
            lines = np.moveaxis(levels_and_slopes, (0, 1), (axis, axis + 1))
        cells = [
            self.cell(ca.SX(argument), points)
            for points, argument in zip(axes, arguments, strict=True)
        ]
        return _value_of_lines(ca.SX(ca.DM(lines.ravel())), cells)

    def cell(self, argument: ca.SX, points: np.ndarray) -> Interval:
        """Return the cell of an argument.

        points: breakpoints, (n,)
        """
        key = (argument.element_hash(), points.tobytes())
        if key not in self._cells:
            inside = ca.fmin(ca.fmax(argument, points[0]), points[-1])
            above = argument >= ca.SX(ca.DM(points[1:-1]))
            # 1 for the last breakpoint that is not above the argument, which begins its cell.
            indicator = ca.vertcat(1, above) - ca.vertcat(above, 0)
            self._cells[key] = Interval(indicator, inside - _middle(points)), argument
        cell, _ = self._cells[key]
        return cell


def lines_of_cells(values: Any, points: np.ndarray) -> tuple[Any, Any]:
    """Return the lines that interpolate a table in its cells, as levels and slopes.

    The level is the value of the line at the middle breakpoint of the table (`Interval.offset`).
    Both arrays have the shape (n - 1, ...).

    values: values at the breakpoints, (n, ...), an array, or expressions as a column
    points: breakpoints, (n,)
    """
    column_shape = (-1, *[1] * (len(values.shape) - 1))
    widths = np.diff(points).reshape(column_shape)
    start_offsets = (points[:-1] - _middle(points)).reshape(column_shape)
    slopes = (values[1:] - values[:-1]) / widths
    return values[:-1] - slopes * start_offsets, slopes


def _middle(points: np.ndarray) -> float:
    """Return the middle breakpoint, relative to which the arguments of lines are measured."""
    return float(points[len(points) // 2])


def _value_of_lines(lines: ca.SX, cells: Sequence[Interval]) -> ca.SX:
    """Return the interpolated value of a table, a flat array (2, n1 - 1, 2, n2 - 1, ...)."""
    # Levels and slopes along the first argument are themselves tables of the other arguments. As
    # CasADi reshapes column by column, each column contains the table of one cell, of which the
    # indicator selects one.
    if not cells:
        return lines
    first, *others = cells
    half = lines.numel() // 2
    count = first.indicator.numel()
    level, slope = (
        _value_of_lines(ca.mtimes(ca.reshape(part, half // count, count), first.indicator), others)
        for part in (lines[:half], lines[half:])
    )
    return level + first.offset * slope
