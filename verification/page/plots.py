"""Interactive plots of the page: Plotly figures as JSON, drawn by Plotly's own script.

`front_view`: the aircraft from the front, panels, lift and weight to one scale. `locus_plot`: the root locus over the
dihedral angle, where hovering says angle, frequency and damping.
"""

from __future__ import annotations

import html
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np

from hfa_model.aircraft import Aircraft
from hfa_support.jsonable import jsonable
from hfa_support.reporting.report import Picture
from hfa_support.reporting.unit_system import in_force, unit_in_force
from trim.linear.linear_model import LinearModel
from trim.point.trim_figure import Panel, panels_from_the_front, scale_text, shown_panel, trim_figure
from trim.sweeps.sweep import Sweep
from verification.page.main_job import Angle

#: data, layout and, where a slider moves it, frames, as Plotly's figure schema has them.
PlotlyFigure: TypeAlias = Mapping[str, Any]
#: Colors that stand apart on a light and on a dark page, also for the color-blind (Okabe, Ito 2008).
COLORS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9")
NEUTRAL = "#888888"
_GRID = {"gridcolor": "rgba(128,128,128,0.3)", "zerolinecolor": "rgba(128,128,128,0.8)"}


@dataclass(frozen=True, eq=False)
class InteractivePlot(Picture):
    """A picture that is one or more Plotly figures on a page of HTML; elsewhere Matplotlib draws it."""

    figures: tuple[PlotlyFigure, ...]

    def html(self) -> str:
        """Boxes, figures and one caption; the page that holds them brings Plotly's script."""
        key, text = self.name.removesuffix(".png"), html.escape(self.text)
        boxes = "".join(
            f'<div class="plot" id="plot-{key}-{number}" role="img" aria-label="{text}"></div>'
            f'<script type="application/json" data-plot="plot-{key}-{number}">{in_script(figure)}</script>'
            for number, figure in enumerate(self.figures, start=1)
        )
        return f'<figure><div class="plots">{boxes}</div><figcaption>{text}</figcaption></figure>'


def in_script(value: Any) -> str:
    """The value as JSON of which no word can end the script element that holds it."""
    return json.dumps(jsonable(value), allow_nan=False, separators=(",", ":")).replace("<", "\\u003c")


def axis(title: str, lowest: float, highest: float, **more: Any) -> dict[str, Any]:
    """An axis with its title and range."""
    return {"title": {"text": title}, "range": [lowest, highest], **_GRID, **more}


def layout(x: dict[str, Any], y: dict[str, Any]) -> dict[str, Any]:
    """A layout that takes its background and its size from the page; the legend above."""
    return {
        "xaxis": x,
        "yaxis": y,
        "autosize": True,
        "margin": {"l": 50, "r": 40, "t": 10, "b": 45},
        "hovermode": "closest",
        "paper_bgcolor": "rgba(0,0,0,0)",
        "plot_bgcolor": "rgba(0,0,0,0)",
        "modebar": {"orientation": "v", "bgcolor": "rgba(0,0,0,0)", "color": NEUTRAL, "activecolor": COLORS[1]},
        "legend": {"orientation": "h", "yanchor": "bottom", "y": 1.02},
    }


def frames(traces: Sequence[Sequence[Mapping[str, Any]]], numbers: Sequence[int]) -> list[dict[str, Any]]:
    """A frame for each position of the slider, named by it; numbers: of the traces that change."""
    return [
        {"name": str(position), "data": list(changed), "traces": list(numbers)}
        for position, changed in enumerate(traces)
    ]


#: Length of the longest arrow, of the span of a panel.
_LONGEST = 0.7


def front_view(aircraft: Aircraft, points: tuple[Angle, ...]) -> InteractivePlot | None:
    """One drawing for all points that are trimmed, a frame each, arrows to one scale; None where none is trimmed."""
    models = [each.model for each in points]
    drawn = [None if model is None else _panels(aircraft, model) for model in models]
    known = [(model.point, panels) for model, panels in zip(models, drawn, strict=True) if model and panels]
    if not known:
        return None
    span, length = in_force(aircraft.parameters.panel_span, "ft"), unit_in_force("ft")
    forces = [force for _, panels in known for panel in panels for force in (panel.lift, panel.weight)]
    scale = _LONGEST * span / max(float(np.linalg.norm(force)) for force in forces)
    moving = [_traces(aircraft, model, panels, scale) for model, panels in zip(models, drawn, strict=True)]
    first = next(i for i, panels in enumerate(drawn) if panels is not None)
    low, high = _heights(moving)
    wide = 1.5 * span + in_force(12.0, "ft")
    x = axis(length, -wide, wide, constrain="domain", showgrid=False, zeroline=False)  # lines would cross the texts
    y = axis(length, low, high, scaleanchor="x", scaleratio=1, constrain="domain")
    data = [fixed | changed for fixed, changed in zip(_FIXED, moving[first], strict=True)]
    text = f"The trimmed aircraft at the chosen angle, seen from the front; {scale_text(scale)}"
    point = known[0][0]
    figure = {"data": data, "layout": layout(x, y), "frames": frames(moving, range(len(_FIXED)))}
    return InteractivePlot("trim.png", text, lambda: trim_figure(aircraft, point), (figure,))


_ARROW = {"symbol": "arrow", "size": 13, "angleref": "previous"}
#: What does not move, trace by trace as in `_traces`.
_FIXED: tuple[dict[str, Any], ...] = (
    {"name": "panels", "mode": "lines", "line": {"color": NEUTRAL, "width": 7}},
    {"name": "lift", "mode": "lines+markers", "line": {"color": COLORS[0], "width": 3}, "marker": _ARROW},
    {"name": "weight", "mode": "lines+markers", "line": {"color": COLORS[1], "width": 3}, "marker": _ARROW},
    {"name": "hinges (moment of loads and weight)", "mode": "markers", "marker": {"size": 10, "color": COLORS[2]}},
    {"name": "sizes", "mode": "text", "showlegend": False},
)


def _traces(
    aircraft: Aircraft, model: LinearModel | None, panels: tuple[Panel, Panel, Panel] | None, scale: float
) -> list[dict[str, Any]]:
    """What moves: the ends of the panels, lift, weight, hinges, and their sizes; nothing without a trim."""
    if panels is None or model is None:
        return [{"x": [], "y": []} for _ in _FIXED]
    gap, half = np.array([np.nan, np.nan]), in_force(aircraft.parameters.panel_span, "ft") / 2
    forces = [(panel.middle, panel.lift) for panel in panels], [(panel.middle, panel.weight) for panel in panels]
    ends = np.array([start + scale * force for kind in forces for start, force in kind])
    hinges = np.array([[-half, 0.0], [half, 0.0]])
    moment = in_force(float(aircraft.loads(model.point.states, model.point.inputs).hinge_moment), "ft lbf")
    moment = round(moment, 1) + 0.0
    sizes = [f"{np.linalg.norm(force):.1f} {unit_in_force('lbf')}" for kind in forces for _, force in kind]
    beside = ["top center" if force[1] >= 0 else "bottom center" for kind in forces for _, force in kind]
    return [
        _line([each for panel in panels for each in (*panel.ends, gap)]),
        *(_line([each for start, force in kind for each in (start, start + scale * force, gap)]) for kind in forces),
        _line(hinges),
        _line([*ends, *(hinges - [0.0, 0.1 * half])])
        | {"text": [*sizes, *[f"{moment:.1f} {unit_in_force('ft lbf')}"] * 2]}
        | {"textposition": [*beside, *["bottom center"] * 2]},
    ]


def _panels(aircraft: Aircraft, model: LinearModel) -> tuple[Panel, Panel, Panel]:
    right, center, left = map(shown_panel, panels_from_the_front(aircraft, model.point))
    return right, center, left


def _line(places: Any) -> dict[str, Any]:
    x, y = np.round(np.asarray(places), 3).T
    return {"type": "scatter", "x": x, "y": y, "hoverinfo": "skip"}


def _heights(moving: list[list[dict[str, Any]]]) -> tuple[float, float]:
    """From the lowest to the highest place of any drawing, with room for the texts."""
    y = np.concatenate([np.asarray(trace["y"], dtype=float) for traces in moving for trace in traces])
    room = in_force(16.0, "ft")
    return float(np.nanmin(y)) - room, float(np.nanmax(y)) + room


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
