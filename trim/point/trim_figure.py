"""The aircraft at a trim seen from the front: panels at the dihedral angle, their lift, weight and hinge moments."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from hfa_model.aircraft import Aircraft
from hfa_support.reporting.figure import new_figure
from hfa_support.reporting.text import angle_text, short_number, shown_unit
from hfa_support.reporting.unit_system import in_force, unit_in_force
from trim.point.operating_point import OperatingPoint

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

#: Length of the longest arrow, of the span of a panel.
_LONGEST = 0.55
#: The arc of a moment reaches this far to both sides of the panel, rad.
_HALF_ARC = math.radians(30.0)
_LIFT, _WEIGHT, _MOMENT = "C0", "0.35", "C3"


class Panel(NamedTuple):
    """A panel from the front; horizontal to the right of the picture and up, ft; forces in lbf.

    ends: (2, 2), the ends of its span. middle: (2,), where its forces act. lift: (2,), across the panel. weight: (2,).
    """

    ends: np.ndarray
    middle: np.ndarray
    lift: np.ndarray
    weight: np.ndarray


def panels_from_the_front(aircraft: Aircraft, point: OperatingPoint) -> tuple[Panel, Panel, Panel]:
    """The right panel, the center panel, the left panel: a pilot's right is left in the picture.

    The hinges lie at (±s/2, 0); an outer panel leaves its hinge at the dihedral angle η, its middle is (s/2)(cos η,
    sin η) further on, its lift L_o points along (∓sin η, cos η).
    """
    p, loads = aircraft.parameters, aircraft.loads(point.states, point.inputs)
    half, weight = p.panel_span / 2, np.array([0.0, -p.panel_mass * p.gravity])
    center = Panel(np.array([[-half, 0.0], [half, 0.0]]), np.zeros(2), np.array([0.0, loads.center.lift]), weight)
    cos_eta, sin_eta = np.cos(point.states.dihedral), np.sin(point.states.dihedral)
    right, left = (
        Panel(
            np.array([[side * half, 0.0], [side * half * (1 + 2 * cos_eta), 2 * half * sin_eta]]),
            np.array([side * half * (1 + cos_eta), half * sin_eta]),
            loads.outer.lift * np.array([-side * sin_eta, cos_eta]),
            weight,
        )
        for side in (-1, 1)
    )
    return right, center, left


def shown_panel(panel: Panel) -> Panel:
    """In the units of the report: m and N in place of ft and lbf."""
    ends, middle = (in_force(each, "ft") for each in (panel.ends, panel.middle))
    return Panel(ends, middle, in_force(panel.lift, "lbf"), in_force(panel.weight, "lbf"))


def scale_text(scale: float) -> str:
    """scale: length of a force in the picture over the force, in the units of the report."""
    return f"arrows: {1 / scale:.3g} {unit_in_force('lbf')} to the {'foot' if unit_in_force('ft') == 'ft' else 'meter'}"


def trim_figure(aircraft: Aircraft, point: OperatingPoint) -> Figure:
    """Forces to one scale, stated in the picture; angles and lengths true."""
    panels = tuple(map(shown_panel, panels_from_the_front(aircraft, point)))
    hinge_moment = in_force(aircraft.loads(point.states, point.inputs).hinge_moment, "ft lbf")
    span = in_force(aircraft.parameters.panel_span, "ft")
    force, length = unit_in_force("lbf"), unit_in_force("ft")
    greatest = max(float(np.linalg.norm(each)) for panel in panels for each in (panel.lift, panel.weight))
    scale = _LONGEST * span / greatest
    figure = new_figure(10.0, 4.6)
    axes = figure.subplots()
    for panel in panels:
        axes.plot(*panel.ends.T, color="black", linewidth=3.0, solid_capstyle="butt", zorder=2)
        _arrow(axes, panel.middle, panel.lift * scale, _LIFT, f"{_signed_lift(panel):.1f} {force}")
        _arrow(axes, panel.middle, panel.weight * scale, _WEIGHT, f"{np.linalg.norm(panel.weight):.1f} {force}")
    for side in (-1, 1):
        _hinge(axes, side, hinge_moment, point.states.dihedral, span)
    for color, name in ((_LIFT, "lift"), (_WEIGHT, "weight"), (_MOMENT, "moment of loads and weight about the hinge")):
        axes.plot([], [], color=color, linewidth=2.0, label=name)
    axes.set_aspect("equal")
    axes.margins(0.08, 0.2)
    axes.set_xlabel(f"{length}, seen from the front")
    axes.set_ylabel(length)
    axes.grid(alpha=0.3)
    axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.18), ncols=3, fontsize=8, frameon=False)
    x = point.states
    axes.set_title(
        f"{point.dynamics} dynamics: {point.status} at dihedral {angle_text(x.dihedral)}, "
        f"{short_number(x.speed, 'ft/s')} {shown_unit('ft/s')}, {short_number(x.altitude, 'ft')} {length}\n"
        f"{scale_text(scale)}",
        fontsize=10,
    )
    return figure


def _signed_lift(panel: Panel) -> float:
    """The lift with its sign: positive towards the upper side of the panel."""
    return float(np.copysign(np.linalg.norm(panel.lift), panel.lift[1]))


def _arrow(axes: Axes, start: np.ndarray, force: np.ndarray, color: str, text: str) -> None:
    end = start + force
    style = {"arrowstyle": "-|>", "color": color, "linewidth": 2.0, "shrinkA": 0, "shrinkB": 0}
    axes.annotate("", xy=_pair(end), xytext=_pair(start), arrowprops=style)
    axes.plot(*end, alpha=0.0)  # the arrow counts for the limits of the axes
    _label(axes, end, text, color, above=bool(force[1] >= 0))


def _hinge(axes: Axes, side: int, moment: float, dihedral: float, span: float) -> None:
    """A hinge and the arc of its moment, if there is one: upward where the moment lifts the outer panel."""
    shown = round(moment, 1) + 0.0
    place = np.array([side * span / 2, 0.0])
    axes.plot(*place, "o", color="black", markersize=7, markerfacecolor="white", zorder=3)
    below, above = (
        place + 0.2 * span * np.array([side * np.cos(angle), np.sin(angle)])
        for angle in (dihedral - _HALF_ARC, dihedral + _HALF_ARC)
    )
    if shown:
        start, end = (below, above) if shown > 0 else (above, below)
        bend = math.copysign(0.3, side * shown)
        style = {"arrowstyle": "-|>", "color": _MOMENT, "linewidth": 1.8, "connectionstyle": f"arc3,rad={bend}"}
        axes.annotate("", xy=_pair(end), xytext=_pair(start), arrowprops=style)
    text, towards = f"{shown:.1f} {unit_in_force('ft lbf')}", "right" if side > 0 else "left"
    _label(axes, place, text, _MOMENT, above=dihedral < 0, align=towards)  # where no panel and no arc is in the way


def _label(axes: Axes, place: np.ndarray, text: str, color: str, *, above: bool, align: str = "center") -> None:
    """The text above or below a place, clear of it."""
    style: dict[str, Any] = {"color": color, "fontsize": 9, "ha": align, "textcoords": "offset points"}
    offset, side = (6, "bottom") if above else (-6, "top")
    axes.annotate(text, xy=_pair(place), xytext=(0, offset), va=side, **style)


def _pair(place: np.ndarray) -> tuple[float, float]:
    return float(place[0]), float(place[1])
