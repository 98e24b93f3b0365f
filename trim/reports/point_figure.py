"""Figure of the variables of a trim between their limits."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from hfa_support.errors import BadInputError
from hfa_support.reporting.text import WIDTH, beside_unit, shown_value, wrapped
from trim.point.margins import Margin
from trim.point.operating_point import OperatingPoint
from trim.reports.first_lines import title_of
from trim.reports.trimmed import Trimmed

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


def draw_point(point: OperatingPoint) -> Axes:
    """Draw the variables of a trim in percent of their ranges with pyplot, and return the Axes.

    The lowest limit is at 0 %, the highest at 100 %. Variables without two different limits are
    omitted.

    Raises BadInputError if all variables are omitted.
    """
    from hfa_support.reporting.figure import pyplot_figure

    axes = pyplot_figure(7.0, _height(point)).subplots()
    _draw_variables(axes, point)
    return axes


def point_figure(point: OperatingPoint) -> Figure:
    """Return a figure of the variables of a trim in percent of their ranges, as in `draw_point`."""
    from hfa_support.reporting.figure import new_figure

    figure = new_figure(7.0, _height(point))
    _draw_variables(figure.subplots(), point)
    return figure


def _height(point: OperatingPoint) -> float:
    """Return the height in inches. Raises BadInputError without a variable to draw."""
    count = len(with_range(point))
    if not count:
        raise BadInputError(
            "no variable has both a lower and an upper limit; declare min and max of a Signal"
        )
    return 1.2 + 0.3 * count


def with_range(point: OperatingPoint) -> list[Margin]:
    """Return the variables with two different limits, from the bottom of the figure."""
    return [
        margin
        for margin in reversed(point.margins.values())
        if math.isfinite(margin.highest - margin.lowest) and margin.highest > margin.lowest
    ]


def _draw_variables(axes: Axes, point: OperatingPoint) -> None:
    """Draw a bar for the range of each variable, with a mark at its value."""
    limited = with_range(point)
    shares = [100 * (each.value - each.lowest) / (each.highest - each.lowest) for each in limited]
    rows = range(len(limited))
    axes.hlines(rows, 0.0, 100.0, color="0.85", linewidth=5, zorder=1)
    axes.scatter(shares, rows, color=["C3" if each.at_limit else "C0" for each in limited])
    labels = [f"{each.name} {shown_value(each.value, each.unit)}" for each in limited]
    axes.set_yticks(rows, map(beside_unit, labels, [each.unit for each in limited]))
    axes.set_xlabel("share of the range between the limits, %; at a limit red")
    axes.set_title(wrapped(title_of(Trimmed(point)), WIDTH), fontsize=10)
