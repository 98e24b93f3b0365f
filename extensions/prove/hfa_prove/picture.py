"""Figures of sections through a proved region."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from hfa_aircraft.march.ending import Outcome
from hfa_prove.monomials import PolynomialFunction
from hfa_prove.search.clock import Clock
from hfa_prove.search.obstacles import starts_by_outcome
from hfa_prove.search.region_search import Region
from hfa_support.reporting.text import shown_unit, shown_values

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

#: Markers of initial conditions that do not converge.
_MARKERS = {Outcome.LEFT: "C3+", Outcome.DIVERGED: "C3x"}
#: Descriptions of their outcomes.
_ENDS = {Outcome.LEFT: "leaves the limits", Outcome.DIVERGED: "does not converge"}
#: Largest number of pairs of states.
_MOST_PAIRS = 6
#: Number of rays on which levels are drawn.
_RAYS = 361
#: Size of the view, over that of the levels.
_WIDER = 1.4
#: Corners of a box, closed.
_CORNERS = np.array([[-1.0, 1.0, 1.0, -1.0, -1.0], [-1.0, -1.0, 1.0, 1.0, -1.0]])
#: Distance of the sides of a box, over the view, beyond which the label states them.
_FARTHEST_BOX = 4.0
#: Size of a view that contains a box, over the box.
_ABOUT_BOX = 1.1
#: Number of rays with simulated initial conditions.
_FLOWN = 40


def region_figure(region: Region, box: np.ndarray | None = None) -> Figure:
    """Return a figure of sections through a region, one for each pair of states.

    At most `_MOST_PAIRS` pairs are shown. Each section shows the proved set, the lowest level with
    V' >= 0, and initial conditions that do not converge, with the level of the nearest one. In each
    section all other deviations are 0. Angles are in degrees.

    box: half-widths of the box in which critics are compared, (n,), in the units of the states, or
        None
    """
    from matplotlib.figure import Figure

    states = region.statement.loop.states
    units = region.statement.loop.model.units(states)
    pairs = [(i, j) for i in range(len(states)) for j in range(i + 1, len(states))][:_MOST_PAIRS]
    columns = min(3, len(pairs))
    rows = -(-len(pairs) // columns)
    figure = Figure(figsize=(1.0 + 4.2 * columns, 3.8 * rows + 1.4), layout="constrained")
    name = region.statement.loop.model.title
    sections = "section" if len(pairs) == 1 else "sections"
    others = ", all other deviations 0" if len(states) > 2 else ""
    for index, (i, j) in enumerate(pairs):
        axes = figure.add_subplot(rows, columns, index + 1)
        _draw(axes, region, i, j)
        axes.set_xlabel(f"{states[i]}, {shown_unit(units[i])}")
        axes.set_ylabel(f"{states[j]}, {shown_unit(units[j])}")
        if box is not None:
            x = shown_values(box[i], units[i])
            y = shown_values(box[j], units[j])
            _draw_box(axes, float(x), float(y))
        if index == 0:
            first = axes
    handles, labels = first.get_legend_handles_labels()
    figure.legend(
        handles,
        labels,
        title=f"{name}: {sections} of the proved set{others}",
        loc="outside upper center",
        fontsize=8,
        ncols=1 if len(pairs) == 1 else 3,
    )
    return figure


def _draw(axes: Axes, region: Region, i: int, j: int) -> None:
    """Draw the section in the plane of states i and j.

    The section shows levels of V and initial conditions that do not converge.
    """
    assert region.obstacles is not None  # of a search
    states = region.statement.loop.states
    x_unit, y_unit = region.statement.loop.model.units((states[i], states[j]))
    levels = [("proved", region.set.rho, "C0", "-")]
    rises, place = region.obstacles.rises
    if place is not None:
        levels.append(("lowest V with V' >= 0", rises, "C1", "--"))
    for outcome, (level, _) in region.obstacles.starts.items():
        if outcome in _MARKERS:
            levels.append((f"V of the nearest condition that {_ENDS[outcome]}", level, "C3", "--"))
    for name, level, color, style in levels:
        edge_x, edge_y = _cut(region.set.V, level, region.set.T, i, j)
        x = shown_values(edge_x, x_unit)
        y = shown_values(edge_y, y_unit)
        axes.plot(x, y, style, color=color, label=name)
        if name == "proved":
            axes.fill(x, y, color=color, alpha=0.2)
    x_limits = axes.get_xlim()
    y_limits = axes.get_ylim()
    axes.set_xlim(*(_WIDER * np.array(x_limits)))
    axes.set_ylim(*(_WIDER * np.array(y_limits)))
    rays = _rays(region.set.T, i, j, _FLOWN)
    found = starts_by_outcome(region.loop, region.set, rays, Clock(np.inf))
    for outcome, marker in _MARKERS.items():
        if outcome in found:
            x = shown_values(found[outcome][:, i], x_unit)
            y = shown_values(found[outcome][:, j], y_unit)
            axes.plot(x, y, marker, label=f"initial condition that {_ENDS[outcome]}")
    axes.plot(0.0, 0.0, "k+")


def _draw_box(axes: Axes, x: float, y: float) -> None:
    """Draw the box in which critics are compared, with half-widths x and y.

    The axes are extended to the sides of the box if these are near. Otherwise the axis label shows
    the half-width.
    """
    axes.plot(x * _CORNERS[0], y * _CORNERS[1], "k:", label="box of a critic's comparison")
    for half, side in ((x, axes.xaxis), (y, axes.yaxis)):
        low, high = side.get_view_interval()
        if half > _FARTHEST_BOX * high:
            side.set_label_text(f"{side.get_label_text()} (box to ±{half:.3g})")
            continue
        wide = _ABOUT_BOX * half
        side.set_view_interval(min(low, -wide), max(high, wide), ignore=True)


def _cut(
    V: PolynomialFunction, level: float, T: np.ndarray, i: int, j: int
) -> tuple[np.ndarray, np.ndarray]:
    """Return points (x, y) on the boundary of {V <= level} in the plane of deviations i and j.

    Both coordinates are nan in a direction in which V does not reach the level.

    T: matrix of the coordinates z = T y, (n, n). The set is in the unit ball of y.
    """
    rays = _rays(T, i, j, _RAYS)
    shares = V.edge(rays, level)
    shares[~np.isfinite(shares)] = np.nan
    return shares * rays[:, i], shares * rays[:, j]


def _rays(T: np.ndarray, i: int, j: int, count: int) -> np.ndarray:
    """Return rays (count, n) from the origin in the plane of deviations i and j.

    The rays are twice as long as the extents of the unit ball of y.

    T: matrix of the coordinates z = T y, (n, n)
    """
    angles = np.linspace(0.0, 2.0 * np.pi, count)
    rays = np.zeros((count, len(T)))
    extents = 2.0 * np.linalg.norm(T, axis=1)
    rays[:, i] = np.cos(angles) * extents[i]
    rays[:, j] = np.sin(angles) * extents[j]
    return rays
