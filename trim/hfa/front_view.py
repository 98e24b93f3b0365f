"""Front view of the HFA at a trim: panels, lift, weight and hinge moments."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

import hfa_model
from hfa_aircraft.model import Model
from hfa_aircraft.units import unit_of
from hfa_support.reporting.figure import new_figure
from trim.point.operating_point import OperatingPoint

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

#: Colors of the drawing, here and on the page of `hfa report` (Okabe, Ito 2008).
PANEL_COLOR = "#888888"
LIFT_COLOR = "#0072B2"
WEIGHT_COLOR = "#D55E00"
HINGE_COLOR = "#009E73"
#: Length of the longest arrow, as a fraction of the span of a panel.
_LONGEST_ARROW = 0.55
#: Width of the picture. The height follows from its content.
_FIGURE_WIDTH = 10.0
#: Height of title, legend and label, and width of the axes, inches.
_TITLE_AND_LEGEND_HEIGHT, _AXES_WIDTH = 1.9, 9.2


class Panel(NamedTuple):
    """A panel seen from the front, as (horizontal, vertical) vectors in the units of the model.

    ends: (2, 2), end points of the span
    middle: (2,), point at which the forces act
    lift: (2,), force normal to the panel
    weight: (2,), downward force
    """

    ends: np.ndarray
    middle: np.ndarray
    lift: np.ndarray
    weight: np.ndarray


def panels_from_the_front(point: OperatingPoint) -> tuple[Panel, Panel, Panel]:
    """Return the right, the center and the left panel at a trim.

    The aircraft's right side is on the left of the picture. The hinges are at (±s/2, 0) for the
    panel span s. An outer panel extends from its hinge at the dihedral angle η. Its middle is
    (s/2)(cos η, sin η) from the hinge, and its lift is along (∓sin η, cos η).
    """
    parameters = hfa_model.parameters_of(point.model)
    loads = hfa_model.loads(point.model, point.states, point.inputs)
    half = parameters.panel_span / 2
    weight = np.array([0.0, -parameters.panel_mass * parameters.gravity])
    center = Panel(
        ends=np.array([[-half, 0.0], [half, 0.0]]),
        middle=np.zeros(2),
        lift=np.array([0.0, loads.center.lift]),
        weight=weight,
    )
    cosine = np.cos(point.states.dihedral)
    sine = np.sin(point.states.dihedral)

    def outer(side: int) -> Panel:
        """Return an outer panel, on the left (side -1) or the right (side 1) of the picture."""
        hinge = np.array([side * half, 0.0])
        along = np.array([side * cosine, sine])
        return Panel(
            ends=np.array([hinge, hinge + 2 * half * along]),
            middle=hinge + half * along,
            lift=loads.outer.lift * np.array([-side * sine, cosine]),
            weight=weight,
        )

    return outer(-1), center, outer(1)


def scale_text(model: Model, scale: float) -> str:
    """Return a text such as "arrows: 3.2 lbf per foot".

    scale: length of an arrow divided by its force, in the units of the model
    """
    length = "foot" if unit_of(model, "ft") == "ft" else "meter"
    return f"arrows: {1 / scale:.3g} {unit_of(model, 'lbf')} per {length}"


def front_view(point: OperatingPoint) -> Figure:
    """Return a figure of the flexible aircraft from the front at a trim.

    All forces are drawn at the same scale, and the figure states this scale. Angles and lengths are
    true to scale. The hinge moments are printed as text.
    """
    aircraft = point.model
    panels = panels_from_the_front(point)
    span = hfa_model.parameters_of(aircraft).panel_span
    forces = [force for panel in panels for force in (panel.lift, panel.weight)]
    scale = _LONGEST_ARROW * span / max(float(np.linalg.norm(force)) for force in forces)
    unit = unit_of(aircraft, "lbf")
    figure = new_figure(_FIGURE_WIDTH, 4.6)
    axes = figure.subplots()
    for panel in panels:
        axes.plot(*panel.ends.T, color=PANEL_COLOR, linewidth=4.0, solid_capstyle="butt")
        lift = np.copysign(np.linalg.norm(panel.lift), panel.lift[1])
        weight = np.linalg.norm(panel.weight)
        _draw_force(axes, panel.middle, panel.lift * scale, f"{lift:.1f} {unit}", LIFT_COLOR)
        _draw_force(axes, panel.middle, panel.weight * scale, f"{weight:.1f} {unit}", WEIGHT_COLOR)
    _draw_hinges(axes, point)
    for color, name in (
        (LIFT_COLOR, "lift"),
        (WEIGHT_COLOR, "weight"),
        (HINGE_COLOR, "moment of loads and weight about the hinge"),
    ):
        axes.plot([], [], color=color, linewidth=2.0, label=name)
    axes.set_aspect("equal")
    across, upward = 0.02, 0.12  # free shares of the width and the height on each side
    axes.margins(across, upward)
    # The width of the axes is fixed, and with equal scales their height follows from the content.
    width, height = axes.dataLim.size
    ratio = (1.0 + 2.0 * upward) * height / ((1.0 + 2.0 * across) * width)
    figure.set_figheight(_TITLE_AND_LEGEND_HEIGHT + _AXES_WIDTH * ratio)
    length = unit_of(aircraft, "ft")
    axes.set_xlabel(f"{length}, seen from the front")
    axes.set_ylabel(length)
    axes.grid(alpha=0.3)
    figure.legend(loc="outside upper center", ncols=3, fontsize=8, frameon=False)
    axes.set_title(_title(point, scale), fontsize=10)
    return figure


def _title(point: OperatingPoint, scale: float) -> str:
    """Return dynamics, status and flight condition of the trim, and the scale of the arrows."""
    aircraft, x = point.model, point.states
    where = (
        f"dihedral {aircraft.describe('dihedral', x.dihedral)}",
        aircraft.describe("speed", round(x.speed, 2)),
        aircraft.describe("altitude", round(x.altitude)),
    )
    return (
        f"{point.dynamics} dynamics: {point.status} at {', '.join(where)}\n"
        f"{scale_text(aircraft, scale)}"
    )


def _draw_force(axes: Axes, place: np.ndarray, arrow: np.ndarray, text: str, color: str) -> None:
    """Draw an arrow, (2,), from the point `place`, (2,), and a text beyond its end."""
    end = place + arrow
    style = {"arrowstyle": "-|>", "color": color, "linewidth": 2.0, "shrinkA": 0, "shrinkB": 0}
    axes.annotate("", xy=tuple(end), xytext=tuple(place), arrowprops=style)
    axes.plot(*end, alpha=0.0)  # annotations do not extend the limits of the axes
    _label(axes, end, text, color, above=bool(end[1] >= 0))


def _draw_hinges(axes: Axes, point: OperatingPoint) -> None:
    """Draw both hinges with the hinge moment, the same at both, on the side that the panels leave
    free: below hinges whose outer panels are raised.
    """
    aircraft = point.model
    span = hfa_model.parameters_of(aircraft).panel_span
    moment = hfa_model.loads(aircraft, point.states, point.inputs).hinge_moment
    rounded = round(float(moment), 1)
    text = f"{abs(rounded):.1f} {unit_of(aircraft, 'ft lbf')}"
    if rounded != 0.0:
        text += ", tips up" if rounded > 0.0 else ", tips down"
    for side in (-1, 1):
        hinge = np.array([side * span / 2, 0.0])
        axes.plot(*hinge, "o", color=HINGE_COLOR, markersize=7, zorder=3)
        _label(axes, hinge, text, HINGE_COLOR, above=point.states.dihedral < 0)


def _label(axes: Axes, place: np.ndarray, text: str, color: str, above: bool) -> None:
    """Print a text above or below a point."""
    style: dict[str, Any] = {
        "color": color,
        "fontsize": 9,
        "ha": "center",
        "textcoords": "offset points",
    }
    axes.annotate(
        text,
        xy=tuple(place),
        xytext=(0, 6 if above else -6),
        va="bottom" if above else "top",
        **style,
    )
