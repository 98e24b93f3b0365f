"""Figure of the errors of a nonlinear game's value over the distance from the trim."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from controller.expansion.expansion import SHARE, Expansion
from controller.expansion.expansion_report import name_of_value
from controller.expansion.radius import largest_errors
from hfa_support.reporting.figure import new_figure

if TYPE_CHECKING:
    from matplotlib.figure import Figure

#: Number of distances, and their range relative to the radius of the whole value.
_SIZES = 25
_RANGE = (0.01, 3.0)
#: Errors outside this range are not drawn: flights have an error of integration of about 1e-4.
_SHOWN = (2e-4, 10.0)


def expansion_figure(expansion: Expansion) -> Figure:
    """Return a figure of the largest errors of V2, V2 + V3, ... over z'Pz.

    An error is the difference from the cost of a flight of both players, relative to the cost. A
    curve ends where a flight does not converge.
    """
    bounded = [radius.c for radius in expansion.radii if 0.0 < radius.c < np.inf]
    lowest = min(bounded, default=1.0) ** 0.5 * _RANGE[0]
    highest = max(bounded, default=1.0) ** 0.5 * _RANGE[1]
    sizes = np.geomspace(lowest, highest, _SIZES)
    figure = new_figure(7.0, 4.5)
    axes = figure.subplots()
    for index, errors in enumerate(largest_errors(expansion, sizes)):
        drawn = np.where((errors >= _SHOWN[0]) & (errors <= _SHOWN[1]), 100.0 * errors, np.nan)
        axes.loglog(sizes**2, drawn, label=name_of_value(index + 2), marker=".")
    axes.axhline(100.0 * SHARE, color="black", linewidth=0.8, linestyle="--")
    axes.set_xlabel("z'Pz of the initial condition")
    axes.set_ylabel("largest error of the value, % of the cost of a flight")
    axes.grid(visible=True, which="major", linewidth=0.4)
    axes.legend(loc="upper left", fontsize=8, title=expansion.game.names.origin, title_fontsize=8)
    return figure
