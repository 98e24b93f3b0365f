"""The root locus over the dihedral angle as an interactive plot: hover says angle, frequency and damping."""

from __future__ import annotations

from typing import Any

import numpy as np

from trim.sweeps.sweep import Sweep
from verification.page.interactive import COLORS, NEUTRAL, InteractivePlot, PlotlyFigure, axis, frames, layout

#: Marked where the sweep visits them, degrees: the printed angles and the one between, with Plotly's symbols.
MARKED = {5.0: "circle-open", 10.0: "square-open", 15.0: "diamond-open"}
_HOVER = (
    "dihedral %{customdata[0]:.4g} deg<br>frequency %{customdata[1]:.4f} rad/s<br>damping %{customdata[2]:.4f}"
    "<br>eigenvalue %{x:.4f}, %{y:.4f} 1/s"
)


def locus_plot(swept: Sweep) -> InteractivePlot | None:
    """All modes, and the slow ones alone where there are slow and fast ones; None where nothing is trimmed."""
    if not swept.mode_names:
        return None
    every, slow = np.ones(len(swept.mode_names), dtype=bool), swept.root_locus.slow
    figures, text = [locus_figure(swept, every)], "Eigenvalues over the dihedral angle"
    if slow.any() and not slow.all():
        figures.append(locus_figure(swept, slow))
        text += ": all modes, and the slow ones alone"
    return InteractivePlot("root_locus.png", text, swept.root_locus.figure, tuple(figures))


def locus_figure(swept: Sweep, shown: np.ndarray) -> PlotlyFigure:
    """A line a mode, markers at `MARKED`, and the point of the slider; shown: (n,) which columns."""
    names = list(dict.fromkeys(swept.mode_names))
    traces: list[dict[str, Any]] = []
    for name in names:
        columns = [i for i, each in enumerate(swept.mode_names) if each == name and shown[i]]
        if columns:
            line = {"color": COLORS[names.index(name) % len(COLORS)], "width": 2}
            about = {"name": name, "mode": "lines+markers", "line": line, "marker": {"size": 4}}
            traces.append(_points(swept, np.arange(len(swept.values)), columns) | about)
    columns = np.flatnonzero(shown).tolist()
    angles = np.degrees(swept.values[:, -1])
    for angle, symbol in MARKED.items():
        rows = np.flatnonzero(np.abs(angles - angle) < 1e-9)
        if rows.size:
            marker = {"symbol": symbol, "size": 11, "color": NEUTRAL, "line": {"width": 2}}
            about = {"name": f"{angle:g} deg", "mode": "markers", "marker": marker}
            traces.append(_points(swept, rows, columns) | about)
    moving = [_points(swept, np.array([row]), columns) for row in range(len(angles))]
    chosen = {"name": "chosen angle", "mode": "markers", "marker": {"symbol": "x", "size": 9, "color": COLORS[1]}}
    traces.append(moving[0] | chosen)
    roots = swept.eigenvalues[:, shown]
    x, y = axis("real part, 1/s", *_range(roots.real)), axis("imaginary part, 1/s", *_range(roots.imag))
    return {
        "data": traces,
        "layout": layout(x, y),
        "frames": frames([[each] for each in moving], [len(traces) - 1]),
    }


def _points(swept: Sweep, rows: np.ndarray, columns: list[int]) -> dict[str, Any]:
    """The eigenvalues of these rows, column after column with a gap between them."""
    gap = np.full(1, complex(np.nan, np.nan))
    roots = np.concatenate([each for column in columns for each in (swept.eigenvalues[rows, column], gap)])
    angles = np.concatenate([each for _ in columns for each in (np.degrees(swept.values[rows, -1]), [np.nan])])
    size = np.abs(roots)
    with np.errstate(invalid="ignore", divide="ignore"):
        told = np.stack([angles, size, np.where(size > 0, -roots.real / size, 0.0)], axis=1)
    return {
        "type": "scatter",
        "x": np.round(roots.real, 6),
        "y": np.round(roots.imag, 6),
        "customdata": np.round(told, 6),
        "hovertemplate": _HOVER,
    }


def _range(values: np.ndarray) -> tuple[float, float]:
    """What holds all values and zero, with room at both ends."""
    lowest, highest = min(float(np.nanmin(values)), 0.0), max(float(np.nanmax(values)), 0.0)
    room = 0.06 * (highest - lowest) or 1.0
    return lowest - room, highest + room
