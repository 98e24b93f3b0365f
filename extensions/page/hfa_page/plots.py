"""Interactive plots of the page: Plotly figures as JSON, drawn by Plotly's script.

- The flexible aircraft is drawn from the front, with panels, lift and weight at one scale; of
  another one, the variables are drawn between their limits.
- The root locus is drawn over the scheduling variable. Hovering over a root shows its value,
  frequency and damping.
"""

from __future__ import annotations

import html
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np

import hfa_model
from hfa_aircraft.model import Model
from hfa_aircraft.units import in_units_of, unit_of
from hfa_page.main_job import Slider
from hfa_support.reporting.parts import Picture
from hfa_support.reporting.results import jsonable
from hfa_support.reporting.text import beside_unit, shown_unit, shown_value, shown_values
from trim.hfa.front_view import (
    HINGE_COLOR,
    LIFT_COLOR,
    PANEL_COLOR,
    WEIGHT_COLOR,
    panels_from_the_front,
    scale_text,
)
from trim.hfa.reports import trim_figure
from trim.point.operating_point import OperatingPoint
from trim.reports.book import with_range
from trim.sweeps.result import Sweep

#: A Plotly figure: data, layout and, with a slider, frames.
PlotlyFigure: TypeAlias = Mapping[str, Any]
#: Colors that are distinct on light and dark pages, also for color-blind users (Okabe, Ito 2008).
COLORS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9")
NEUTRAL = "#888888"
#: Length of the longest arrow, as a fraction of the span of a panel.
_LONGEST_ARROW = 0.7
_ARROW_HEAD = {"symbol": "arrow", "size": 13, "angleref": "previous"}
#: Properties of the traces of `_drawing` that do not depend on the trim.
_FRONT_VIEW_STYLES: tuple[dict[str, Any], ...] = (
    {"name": "panels", "mode": "lines", "line": {"color": PANEL_COLOR, "width": 7}},
    *(
        {
            "name": name,
            "mode": "lines+markers",
            "line": {"color": color, "width": 3},
            "marker": _ARROW_HEAD,
        }
        for name, color in (("lift", LIFT_COLOR), ("weight", WEIGHT_COLOR))
    ),
    {
        "name": "hinges (moment of loads and weight)",
        "mode": "markers",
        "marker": {"size": 10, "color": HINGE_COLOR},
    },
    {"name": "sizes", "mode": "text", "showlegend": False},
)
_HOVER_TEXT = (
    "frequency %{customdata[1]:.4f} rad/s<br>damping"
    " %{customdata[2]:.4f}<br>eigenvalue %{x:.4f}, %{y:.4f} 1/s"
)


@dataclass(frozen=True, eq=False)
class InteractivePlot(Picture):
    """Picture that is interactive on an HTML page, and a Matplotlib figure elsewhere.

    figures: Plotly figures of the picture
    """

    figures: tuple[PlotlyFigure, ...]

    def html(self) -> str:
        """Return HTML with the Plotly figures above one caption. The page must contain Plotly's
        script.
        """
        key = self.name.removesuffix(".png")
        text = html.escape(self.text)
        boxes = "".join(
            f'<div class="plot" id="plot-{key}-{number}" role="img"'
            f' aria-label="{text}"></div><script type="application/json"'
            f' data-plot="plot-{key}-{number}">{in_script(figure)}</script>'
            for number, figure in enumerate(self.figures, start=1)
        )
        return f'<figure><div class="plots">{boxes}</div><figcaption>{text}</figcaption></figure>'


def in_script(value: Any) -> str:
    """Return a value as JSON text that can be embedded in an HTML script element.

    Each "<" is escaped. Otherwise, a text in the value could end the element.
    """
    return json.dumps(jsonable(value), allow_nan=False, separators=(",", ":")).replace(
        "<", "\\u003c"
    )


def _axis(title: str, **more: Any) -> dict[str, Any]:
    """Return an axis of Plotly with a title, and further properties."""
    grid = {"gridcolor": "rgba(128,128,128,0.3)", "zerolinecolor": "rgba(128,128,128,0.8)"}
    return {"title": {"text": title}, **grid, **more}


def _figure(
    traces: Sequence[dict[str, Any]],
    at_positions: Sequence[Sequence[dict[str, Any]]],
    x: dict[str, Any],
    y: dict[str, Any],
    legend: bool = True,
) -> PlotlyFigure:
    """Return a Plotly figure with one frame for each position of the slider.

    traces: traces in drawing order, of which the last ones change with the slider
    at_positions: for each position, what it changes in these traces
    """
    layout = {
        "xaxis": x,
        "yaxis": y,
        "autosize": True,
        "margin": {"l": 50, "r": 40, "t": 10, "b": 45},
        "hovermode": "closest",
        "paper_bgcolor": "rgba(0,0,0,0)",
        "plot_bgcolor": "rgba(0,0,0,0)",
        "modebar": {
            "orientation": "v",
            "bgcolor": "rgba(0,0,0,0)",
            "color": NEUTRAL,
            "activecolor": COLORS[1],
        },
        "showlegend": legend,
        "legend": {"orientation": "h", "yanchor": "bottom", "y": 1.02},
    }
    changing = list(range(len(traces) - len(at_positions[0]), len(traces)))  # numbers of traces
    frames = [
        {"name": str(i), "data": list(changed), "traces": changing}
        for i, changed in enumerate(at_positions)
    ]
    return {"data": list(traces), "layout": layout, "frames": frames}


def pictures_over(slider: Slider) -> list[InteractivePlot]:
    """Return the pictures of an aircraft that follow its slider: the aircraft from the front, or
    its variables between their limits, and the root locus. Without a trim there are no pictures.
    """
    trims = [position.point for position in slider.points]
    if not any(trims):
        return []
    draw = _front_view if hfa_model.is_hfa(slider.sweep.model) else _limits_view
    drawn = draw("trim.png", trims)
    return [plot for plot in (drawn, _locus_plot(slider)) if plot is not None]


def _limits_view(name: str, trims: Sequence[OperatingPoint | None]) -> InteractivePlot | None:
    """Return the variables of each trim in percent of their ranges, or None without any."""
    trimmed = next(point for point in trims if point is not None)
    names = [margin.name for margin in with_range(trimmed)]
    if not names:
        return None

    def shares(point: OperatingPoint | None) -> list[dict[str, Any]]:
        """Return the trace of one trim, which is empty without a trim."""
        ranged = [] if point is None else with_range(point)
        drawn = [margin for margin in ranged if margin.name in names]
        return [
            {
                "type": "scatter",
                "hoverinfo": "skip",
                "x": [
                    100 * (margin.value - margin.lowest) / (margin.highest - margin.lowest)
                    for margin in drawn
                ],
                "y": [margin.name for margin in drawn],
                "text": [
                    beside_unit(shown_value(margin.value, margin.unit, ".4g"), margin.unit)
                    for margin in drawn
                ],
            }
        ]

    fixed = {"mode": "markers+text", "textposition": "top center", "marker": {"size": 10}}
    x = _axis("share of the range between the limits, %", range=[-5, 105])
    y = _axis("", type="category", categoryarray=names, automargin=True)
    figure = _figure([fixed], [shares(point) for point in trims], x, y, legend=False)
    text = "Variables of the trim between their limits"
    return InteractivePlot(name, text, lambda: trim_figure(trimmed), (figure,))


def _front_view(name: str, trims: Sequence[OperatingPoint | None]) -> InteractivePlot:
    """Return the front view of the aircraft at all trims, with the same scale of the forces.

    trims: trim at each position of the slider, or None; at least one exists
    """
    trimmed = [point for point in trims if point is not None]
    aircraft = trimmed[0].model
    span = hfa_model.parameters_of(aircraft).panel_span
    length = unit_of(aircraft, "ft")
    panels = [panel for point in trimmed for panel in panels_from_the_front(point)]
    largest = max(np.linalg.norm([panel.lift, panel.weight], axis=1).max() for panel in panels)
    scale = _LONGEST_ARROW * span / float(largest)
    drawings = [_drawing(aircraft, point, scale) for point in trims]
    heights = np.concatenate(
        [np.asarray(trace["y"], dtype=float) for traces in drawings for trace in traces]
    )
    # The labels of arrows and hinges need room above, below and beside the drawings. Three panels
    # with a dihedral of 0 reach 1.5 spans to each side.
    room = in_units_of(aircraft, 16.0, "ft")
    wide = 1.5 * span + in_units_of(aircraft, 12.0, "ft")
    # Grid lines would cross the labels.
    plain = {"constrain": "domain", "showgrid": False, "zeroline": False}
    x = _axis(length, range=[-wide, wide], **plain)
    low = float(np.nanmin(heights)) - room
    high = float(np.nanmax(heights)) + room
    y = _axis(length, range=[low, high], scaleanchor="x", scaleratio=1, constrain="domain")
    text = (
        "The trimmed aircraft at the chosen angle, seen from the front: lift (blue), weight "
        "(orange), and at the hinges (green) the moment of loads and weight, positive "
        f"where it lifts the tips; {scale_text(aircraft, scale)}"
    )
    figure = _figure(_FRONT_VIEW_STYLES, drawings, x, y, legend=False)
    return InteractivePlot(name, text, lambda: trim_figure(trimmed[0]), (figure,))


def _drawing(aircraft: Model, point: OperatingPoint | None, scale: float) -> list[dict[str, Any]]:
    """Return the traces of a front view at a trim, in the order of `_FRONT_VIEW_STYLES`, or empty
    traces without a trim.

    scale: length of an arrow divided by its force
    """
    if point is None:
        return [{"x": [], "y": []} for _ in _FRONT_VIEW_STYLES]
    panels = panels_from_the_front(point)
    half = hfa_model.parameters_of(aircraft).panel_span / 2
    hinges = np.array([[-half, 0.0], [half, 0.0]])
    moment = float(hfa_model.loads(aircraft, point.states, point.inputs).hinge_moment)
    # The sum with 0.0 prints -0.0 as 0.0.
    moment_text = f"{round(moment, 1) + 0.0:.1f}<br>{unit_of(aircraft, 'ft lbf')}"
    arrows: dict[str, list[np.ndarray]] = {"lift": [], "weight": []}
    labels = []  # position, text, and side of the position
    for kind, lines in arrows.items():
        for panel in panels:
            force = getattr(panel, kind)
            end = panel.middle + scale * force
            lines.append(np.array([panel.middle, end]))
            size = f"{np.linalg.norm(force):.1f} {unit_of(aircraft, 'lbf')}"
            labels.append((end, size, "top center" if force[1] >= 0 else "bottom center"))
    for hinge in hinges:
        labels.append((hinge - [0.0, 0.1 * half], moment_text, "bottom center"))
    positions, texts, sides = zip(*labels, strict=True)
    return [
        _separate_lines([panel.ends for panel in panels]),
        *map(_separate_lines, arrows.values()),
        _line(hinges),
        {**_line(positions), "text": texts, "textposition": sides},
    ]


def _separate_lines(lines: list[np.ndarray]) -> dict[str, Any]:
    """Return one Plotly trace that draws several lines, each (k, 2), with a gap after each."""
    gap = np.full((1, 2), np.nan)
    return _line(np.concatenate([part for line in lines for part in (line, gap)]))


def _line(positions: Any) -> dict[str, Any]:
    """Return a Plotly trace of positions, (k, 2), which is drawn as a line, marks or texts."""
    x, y = np.round(np.asarray(positions), 3).T
    return {"type": "scatter", "x": x, "y": y, "hoverinfo": "skip"}


def _locus_plot(slider: Slider) -> InteractivePlot:
    """Return the root locus of an aircraft over its scheduling variable. If some modes are much
    slower than others, a second figure shows these alone.
    """
    swept = slider.sweep
    slow = swept.slow
    figures = [_locus(swept, np.ones(len(swept.mode_names), dtype=bool))]
    text = f"Eigenvalues over {swept.variables[-1]}"
    if slow.any() and not slow.all():
        figures.append(_locus(swept, slow))
        text += ": all modes, and the slow ones alone"
    return InteractivePlot("root_locus.png", text, swept.figure, tuple(figures))


def _locus(swept: Sweep, shown: np.ndarray) -> PlotlyFigure:
    """Return a root locus, a line for each mode, with marks at the slider's value.

    shown: which of the modes are drawn
    """
    unit = swept.plan.units[-1]  # of the scheduling variable, the only one that is swept
    values = shown_values(swept.values[:, -1], unit)
    hover_text = f"{swept.variables[-1]} %{{customdata[0]:.4g}} {shown_unit(unit)}<br>{_HOVER_TEXT}"
    roots = swept.eigenvalues[:, shown]
    names = [swept.mode_names[column] for column in np.flatnonzero(shown).tolist()]
    modes = list(dict.fromkeys(swept.mode_names))
    traces: list[dict[str, Any]] = []
    for column, name in enumerate(names):
        color = COLORS[modes.index(name) % len(COLORS)]
        traces.append(
            _roots(values, roots[:, column], hover_text)
            | {
                "name": name,
                "legendgroup": name,
                "showlegend": name not in names[:column],
                "line": {"color": color, "width": 2},
                "mode": "lines+markers",
                "marker": {"size": 4},
            }
        )
    chosen = [[_roots(value, row, hover_text)] for value, row in zip(values, roots, strict=True)]
    traces.append(
        {
            "name": f"chosen {swept.variables[-1]}",
            "mode": "markers",
            "marker": {"symbol": "x", "size": 9, "color": COLORS[1]},
        }
    )
    x = _axis("real part, 1/s", rangemode="tozero")
    y = _axis("imaginary part, 1/s", rangemode="tozero")
    return _figure(traces, chosen, x, y)


def _roots(values: Any, roots: np.ndarray, hover_text: str) -> dict[str, Any]:
    """Return a Plotly trace of eigenvalues, with the numbers of their hover text.

    values: value of the scheduling variable at each eigenvalue, or the same at all
    hover_text: template of a text with this value, and frequency and damping of the eigenvalue
    """
    size = np.abs(roots)
    with np.errstate(invalid="ignore", divide="ignore"):
        hover = np.broadcast_arrays(values, size, np.where(size > 0, -roots.real / size, 0.0))
    numbers = {
        "x": np.round(roots.real, 6),
        "y": np.round(roots.imag, 6),
        "customdata": np.round(np.stack(hover, 1), 6),
    }
    return {"type": "scatter", **numbers, "hovertemplate": hover_text}
