"""Figure of a trim: each variable with two different limits between these limits."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from hfa_support.errors import BadInputError
from hfa_support.reporting.figure import pyplot_figure
from trim.point.operating_point import OperatingPoint

if TYPE_CHECKING:
    from matplotlib.axes import Axes


def draw_point(point: OperatingPoint) -> Axes:
    """Draw the variables of a trim in percent of their ranges with pyplot, and return the Axes.

    The lowest limit is at 0 %, the highest at 100 %. Variables without two different limits are
    omitted.

    Raises BadInputError for a point that was not found by a search, and if all variables are
    omitted.
    """
    if point.problem is None:
        raise BadInputError(
            "this operating point is not the result of a trim and has no limits; trim the model"
        )
    limited = []
    for margin in point.margins.values():
        if math.isfinite(margin.highest - margin.lowest) and margin.highest > margin.lowest:
            limited.append(margin)
    if not limited:
        raise BadInputError(
            "no variable has both a lower and an upper limit; declare min and max of a Signal"
        )
    limited.reverse()  # so that the first is at the top
    axes = pyplot_figure(7.0, 1.2 + 0.3 * len(limited)).subplots()
    shares = [100 * (each.value - each.lowest) / (each.highest - each.lowest) for each in limited]
    rows = range(len(limited))
    axes.hlines(rows, 0.0, 100.0, color="0.85", linewidth=5, zorder=1)
    axes.scatter(shares, rows, color=["C3" if each.at_limit else "C0" for each in limited])
    axes.set_yticks(rows, [" ".join(each.row()[:3]) for each in limited])
    axes.set_xlabel("share of the range between the limits, %; at a limit red")
    axes.set_title(point.title, fontsize=10)
    return axes
