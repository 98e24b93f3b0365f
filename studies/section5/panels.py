"""Pictures of the experiments: panels with lines as plain data, and how they are drawn."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from hfa_support.reporting.figure import enlarge_first_second, new_figure
from studies.section5.flown_laws import CERTIFIED, CERTIFIED_FF, EXACT, EXACT_FF, INTEGRAL, MODIFIED, PRINTED

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

COMMAND = "command"
#: Of the time: nothing is drawn from there on, which is said.
_RESTS = 0.7
#: Of a limit: from there on it is drawn.
_NEAR = 0.8
#: What follows the name of a law in the legend when its flight was lost.
LOST = " (lost at "
#: Lightness, dashes and width together tell the lines apart, also in print without color.
_STYLES: dict[str, dict[str, Any]] = {
    COMMAND: {"color": "black", "linestyle": "--", "linewidth": 1.0, "zorder": 5},
    PRINTED: {
        "color": "black",
        "marker": "x",
        "linestyle": "none",
        "markersize": 9,
        "markeredgewidth": 2.0,
        "zorder": 6,
    },
    MODIFIED: {"color": "0.65", "linestyle": "-", "linewidth": 3.0},
    CERTIFIED: {"color": "C0", "linestyle": "-", "linewidth": 1.3},
    CERTIFIED_FF: {"color": "navy", "linestyle": "-.", "linewidth": 1.5},
    INTEGRAL: {"color": "C1", "linestyle": "-", "linewidth": 1.3, "marker": "o", "markersize": 4, "markevery": 0.08},
    EXACT: {"color": "C3", "linestyle": ":", "linewidth": 1.8},
    EXACT_FF: {"color": "darkred", "linestyle": (0, (5, 1, 1, 1, 1, 1)), "linewidth": 1.3},
}
#: Places besides 0 that a scale should have.
_MARKS = 4
#: For lines that are not laws: cases of uncertainty, weights.
_CYCLE: tuple[dict[str, Any], ...] = (
    {"color": "black", "linestyle": "-", "linewidth": 2.2},
    {"color": "C0", "linestyle": "--", "linewidth": 1.6},
    {"color": "C1", "linestyle": "-.", "linewidth": 1.6},
    {"color": "0.55", "linestyle": ":", "linewidth": 2.4},
)
#: For the lines of a bundle, which need not be told apart.
_BUNDLE: dict[str, Any] = {"color": "0.8", "linewidth": 0.8, "zorder": 1}


@dataclass(frozen=True, eq=False)
class Line:
    """x: (N,), y: (N,) or (N, k) for a bundle without names of its own."""

    label: str
    x: np.ndarray
    y: np.ndarray


@dataclass(frozen=True, eq=False)
class PlotPanel:
    """One pair of axes. y_label with its unit; scale: "linear", "log" or "asinh"; marked: times of vertical lines.

    linear_part: the part of the largest value below which an "asinh" axis is linear, rounded to a power of ten.
    limits: lowest and highest value that is allowed, drawn where a line comes near them.
    """

    title: str
    y_label: str
    lines: tuple[Line, ...]
    scale: str = "linear"
    marked: tuple[tuple[float, str], ...] = ()
    linear_part: float = 1e-3
    limits: tuple[float, ...] = ()


@dataclass(frozen=True, eq=False)
class PaperFigure:
    """A figure of the paper, drawn anew: panels row by row. number: the paper's."""

    number: int
    title: str
    columns: int
    panels: tuple[PlotPanel, ...]

    def __str__(self) -> str:
        """Number and title."""
        return f"Figure {self.number}. {self.title}"

    @property
    def arrays(self) -> dict[str, np.ndarray]:
        """What is drawn, by panel and line: "02 Case I / certified / x"."""
        found = {}
        for index, panel in enumerate(self.panels):
            for line in panel.lines:
                name = f"{index:02d} {panel.title} {panel.y_label} / {line.label}"
                found[f"{name} / x"], found[f"{name} / y"] = line.x, line.y
        # A "/" would make folders of an archive's members when it is unpacked.
        return {re.sub(r"[^\w .,+=()-]", "_", name): values for name, values in found.items()}


def draw(picture: PaperFigure) -> Figure:
    """The picture, with one legend for all panels."""
    rows = -(-len(picture.panels) // picture.columns)
    figure, title = new_figure(5.4 * picture.columns, 1.0 + (2.2 if rows > 2 else 2.8) * rows), str(picture)
    grid = figure.subplots(rows, picture.columns, squeeze=False, sharex=True)
    labels: dict[str, Any] = {}
    for axes, panel in zip(grid.ravel(), picture.panels, strict=False):
        _draw_panel(axes, panel)
        own = axes.get_legend() is not None
        handles, names = ([], []) if own else axes.get_legend_handles_labels()
        labels |= {name: handle for name, handle in zip(names, handles, strict=True) if name not in labels}
    for axes in grid.ravel()[len(picture.panels) :]:
        axes.set_axis_off()
    for column in range(picture.columns):
        last = (len(picture.panels) - 1 - column) // picture.columns
        grid[last, column].set_xlabel("time, s")
        grid[last, column].tick_params(labelbottom=True)
    if labels:  # above, where no caption is
        columns = min(len(labels), 2 + picture.columns)
        figure.legend(labels.values(), labels, loc="outside upper center", ncols=columns, fontsize=9, title=title)
    else:
        figure.suptitle(title, fontsize=10)
    return figure


def _draw_panel(axes: Axes, panel: PlotPanel) -> None:
    if panel.scale == "asinh":
        _scale_by_asinh(axes, panel)
    else:
        axes.set_yscale(panel.scale)
    _draw_lines(axes, panel.lines)
    if any(line.y.ndim == 2 for line in panel.lines):  # named lines of one panel are not those of the next
        axes.legend(loc="upper left", bbox_to_anchor=(1.0, 1.0), fontsize=7, frameon=False)
    drawn = np.concatenate([line.y.ravel() for line in panel.lines])
    for limit in panel.limits:
        if np.any(drawn / limit > _NEAR):
            axes.axhline(limit, color="black", linestyle=(0, (6, 3)), linewidth=0.7, zorder=0, label="limit")
    for time, _ in panel.marked:
        axes.axvline(time, color="0.4", linewidth=0.9, linestyle=(0, (1, 2)))
    if panel.title and panel.marked:  # panels without a title stand below one that has the names already
        times, names = zip(*panel.marked, strict=True)
        top = axes.secondary_xaxis("top")
        top.set_xticks(times, names, fontsize=8)
        top.tick_params(length=0, pad=1)
    axes.set_title(panel.title, fontsize=10)
    axes.set_ylabel(panel.y_label, fontsize=9)
    axes.tick_params(labelsize=8, which="both")
    axes.grid(alpha=0.3)
    reached = np.concatenate([line.x for line in panel.lines])
    if len(reached):  # of all values, also those that a logarithmic axis leaves out
        margin = 0.02 * float(np.ptp(reached)) or 1.0
        axes.set_xlim(float(reached.min()) - margin, float(reached.max()) + margin)
        moving = max(_last(line) for line in panel.lines if len(line.x))
        if moving < _RESTS * reached.max():
            middle = 0.5 * float(moving + reached.max())
            axes.text(middle, 0.5, f"0 from {moving:.3g} s on", transform=axes.get_xaxis_transform(), ha="center")
    if panel.scale != "log":
        enlarge_first_second(axes)


def _last(line: Line) -> float:
    """The time of its last finite value."""
    return float(line.x[np.isfinite(line.y.reshape(len(line.x), -1)).any(axis=1)].max(initial=0.0))


def _draw_lines(axes: Axes, lines: Sequence[Line]) -> None:
    for index, line in enumerate(lines):
        bundle = line.y.ndim == 2
        style = _STYLES.get(line.label.partition(LOST)[0], _CYCLE[index % len(_CYCLE)])
        if bundle:
            axes.plot(line.x, line.y[:, :1], label=line.label, **_BUNDLE)
            axes.plot(line.x, line.y[:, 1:], **_BUNDLE)
        else:
            axes.plot(line.x, line.y, label=line.label, **style)


def _scale_by_asinh(axes: Axes, panel: PlotPanel) -> None:
    """Linear near 0, logarithmic beyond a power of ten; marked at 0 and at the powers of ten from there on."""
    largest = max((float(np.nanmax(np.abs(line.y), initial=0.0)) for line in panel.lines), default=0.0)
    if largest == 0.0:
        return
    first, last = math.floor(math.log10(largest * panel.linear_part)), math.ceil(math.log10(largest))
    axes.set_yscale("asinh", linear_width=10.0**first)
    powers = [10.0**power for power in range(first + (last - first > 1), last + 1)]  # the first would touch the 0
    for sizes in (powers, [size for power in powers for size in (0.3 * power, power)]):
        places = [place for size in sizes for place in (-size, size) if _reaches(panel, place)]
        if len(places) >= _MARKS:
            break
    axes.set_yticks([0.0, *places], ["0", *map(_marked_as, places)])
    axes.set_yticks([], minor=True)


def _marked_as(place: float) -> str:
    power = math.floor(math.log10(abs(place)) + 1e-9)
    if -3 < power < 3:
        return f"{place:g}"
    return f"${place / 10.0**power:.0f}\\cdot10^{{{power}}}$".replace("1\\cdot", "")


def _reaches(panel: PlotPanel, place: float) -> bool:
    """Whether a line comes up to a place on the axis, or nearly."""
    return any(bool(np.any(line.y / place >= 0.7)) for line in panel.lines)
