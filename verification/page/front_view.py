"""The aircraft from the front at each angle of the sweep, drawn by Plotly: panels, lift and weight to one scale."""

from __future__ import annotations

from typing import Any

import numpy as np

from hfa_model.aircraft import Aircraft
from hfa_support.reporting.text import angle_text
from hfa_support.reporting.unit_system import in_force, unit_in_force
from trim.linear.linear_model import LinearModel
from trim.point.trim_figure import Panel, panels_from_the_front, scale_text, shown_panel, trim_figure
from verification.page.interactive import COLORS, NEUTRAL, InteractivePlot, axis, frames, layout
from verification.page.main_job import TrimmedAngle

#: Length of the longest arrow, of the span of a panel.
_LONGEST = 0.7


def front_view(aircraft: Aircraft, points: tuple[TrimmedAngle, ...], name: str) -> InteractivePlot | None:
    """One drawing for all points that are trimmed, a frame each where there are several; None where none is."""
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
    where = f"dihedral {angle_text(points[first].dihedral)}" if len(points) == 1 else "the chosen dihedral angle"
    text = f"The trimmed aircraft at {where}, seen from the front (the pilot's right is left); {scale_text(scale)}"
    point = known[0][0]
    return InteractivePlot(
        name,
        text,
        lambda: trim_figure(aircraft, point),
        (
            {
                "data": data,
                "layout": layout(x, y),
                "frames": frames(moving, range(len(_FIXED))) if len(points) > 1 else [],
            },
        ),
    )


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
    """What moves: the ends of the panels, lift, weight, hinges, the sizes beside them; nothing without a trim."""
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
        _line([*ends, hinges[0] - [0.0, 0.1 * half]])
        | {"text": [*sizes, f"{moment:.1f} {unit_in_force('ft lbf')}"], "textposition": [*beside, "bottom center"]},
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
