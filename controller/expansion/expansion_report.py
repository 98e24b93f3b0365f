"""Report of the value of a nonlinear game about a trim."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from controller.expansion.expansion import PERMITTED_ERROR, Expansion
from controller.expansion.radius import Radius, largest_errors
from controller.expansion.series import name_of
from hfa_support.reporting.figure import new_figure
from hfa_support.reporting.report import Report
from hfa_support.reporting.results import storable
from hfa_support.reporting.text import Table, shown_unit, shown_value

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def expansion_report(expansion: Expansion) -> Report:
    """Return a report of the degree and the radii of V2 and of V."""
    names = expansion.game.names
    radii = expansion.radii
    columns = [name_of_value(radius.degree) for radius in radii]
    rows = [("z'Pz", "", *(_size_of_set(radius) for radius in radii))]
    units = names.state_units
    for index, (state, unit) in enumerate(zip(names.states, units, strict=True)):
        extents = [_extent(radius, index, unit) for radius in radii]
        rows.append((state, shown_unit(unit), *extents))
    weights = zip(expansion.basis.exponents.tolist(), expansion.weights.tolist(), strict=True)
    return Report(
        title=(
            f"Nonlinear game: {name_of_value(expansion.order)} has {expansion.basis.size}"
            f" coefficients, proved within {expansion.error:.1g}"
        ),
        parts=(
            f"Flights of both players, without input limits, cost what V predicts within"
            f" {100 * PERMITTED_ERROR:g} %\nin the set z'Pz <= c, which extends to these"
            " deviations from the trim:",
            Table(("largest", "unit", *columns), rows),
        ),
        data=storable(expansion),
        records=Table(
            ("monomial", "weight"),
            [(name_of(powers, names.states), weight) for powers, weight in weights],
        ),
    )


def name_of_value(degree: int) -> str:
    """Return "V2", "V2 + V3" or "V2 + ... + V4"."""
    if degree == 2:
        return "V2"
    return "V2 + V3" if degree == 3 else f"V2 + ... + V{degree}"


def _size_of_set(radius: Radius) -> str:
    """Return c of the set z'Pz <= c as text, "unlimited", or "none"."""
    if math.isinf(radius.c):
        return "unlimited"
    return f"{radius.c:.3g}" if radius.c else "none"


def _extent(radius: Radius, index: int, unit: str) -> str:
    """Return the largest deviation of a state, or "" without a bounded set."""
    if not radius.c or math.isinf(radius.c):
        return ""
    return shown_value(float(radius.extents[index]), unit, ".3g")


#: Number of distances from the trim, and the least and largest one, relative to the radius.
_DISTANCES = 25
_NEAREST, _FARTHEST = 0.01, 3.0
#: Errors outside this range are not drawn: flights have an error of integration of about 1e-4.
_LEAST_ERROR, _LARGEST_ERROR = 2e-4, 10.0


def expansion_figure(expansion: Expansion) -> Figure:
    """Return a figure of the largest errors of V2, V2 + V3, ... over z'Pz.

    An error is the difference from the cost of a flight of both players, relative to the cost. A
    curve ends where a flight does not converge.
    """
    bounded = [radius.c for radius in expansion.radii if 0.0 < radius.c < np.inf]
    lowest = min(bounded, default=1.0) ** 0.5 * _NEAREST
    highest = max(bounded, default=1.0) ** 0.5 * _FARTHEST
    sizes = np.geomspace(lowest, highest, _DISTANCES)
    figure = new_figure(7.0, 4.5)
    axes = figure.subplots()
    for index, errors in enumerate(largest_errors(expansion, sizes)):
        is_drawn = (errors >= _LEAST_ERROR) & (errors <= _LARGEST_ERROR)
        percent = np.where(is_drawn, 100.0 * errors, np.nan)
        axes.loglog(sizes**2, percent, label=name_of_value(index + 2), marker=".")
    axes.axhline(100.0 * PERMITTED_ERROR, color="black", linewidth=0.8, linestyle="--")
    axes.set_xlabel("z'Pz of the initial condition")
    axes.set_ylabel("largest error of the value, % of the cost of a flight")
    axes.grid(visible=True, which="major", linewidth=0.4)
    axes.legend(loc="upper left", fontsize=8, title=expansion.game.names.origin, title_fontsize=8)
    return figure
