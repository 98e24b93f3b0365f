"""What a trim of the HFA says beside that of any model: loads, the numbers of a flight manual, a
front view."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

import hfa_model
from hfa_aircraft.model import Model
from hfa_aircraft.units import in_units_of, native_values, unit_of
from hfa_model.aerodynamics import Loads, PanelLoads
from hfa_model.atmosphere import density, speed_of_sound
from hfa_model.declaration import is_hfa
from hfa_support.reporting.figure import new_figure
from hfa_support.reporting.report import Report
from hfa_support.reporting.text import Table, angle_text, four_decimals, short_number, shown_unit
from trim.point.condition import TrimCondition
from trim.point.operating_point import OperatingPoint
from trim.point.trim_report import point_report

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


#: Name -> unit, and how the table calls what it shows. The coefficients are C_L = L / (q S) and C_D
#: = D / (q S) of the whole aircraft, tails included, q = ρ V² / 2, S = 3 s c the wing without
#: tails. hinge_moment_total: of loads and weight about a hinge, with spring and damper, zero in
#: balance.
PERFORMANCE: dict[str, tuple[str, str]] = {
    "dynamic_pressure": ("lbf/ft^2", "dynamic pressure q"),
    "density": ("slug/ft^3", "air density"),
    "speed_of_sound": ("ft/s", "speed of sound"),
    "mach": ("1", "Mach number"),
    "wing_area": ("ft^2", "wing area S, without tails"),
    "drag_coefficient": ("1", "drag coefficient D/(q S)"),
    "load_factor": ("1", "load factor"),
    "gamma": ("rad", "flight-path angle"),
    "climb_rate": ("ft/s", "climb rate"),
    "weight": ("lbf", ""),
    "lift_coefficient": ("1", ""),
    "lift_over_drag": ("1", ""),
    "hinge_moment_total": ("ft lbf", ""),
}
_WATCHED = ("dynamic_pressure", "load_factor", "gamma", "climb_rate", "hinge_moment_total")


def trim_report(model: Model, condition: TrimCondition, point: OperatingPoint) -> Report:
    """The report of a trim; of the paper's aircraft with its loads and performance in place of its
    outputs."""
    if not is_hfa(model):
        return point_report(model, condition, point)
    return with_loads(point_report(model, condition, point, with_outputs=False), model, point)


def with_loads(report: Report, aircraft: Model, point: OperatingPoint) -> Report:
    """The report of a trim with the loads on the aircraft and its panels, and its performance."""
    loads = hfa_model.loads(aircraft, point.states, point.inputs)
    numbers = performance(aircraft, point)
    flat = {name: getattr(loads, name) for name in Loads._fields if name not in ("center", "outer")}
    for panel in ("center", "outer"):
        flat |= {
            f"{panel}_{name}": getattr(getattr(loads, panel), name) for name in PanelLoads._fields
        }
    force = unit_of(aircraft, "lbf")
    moment = unit_of(aircraft, "ft lbf")
    load_units = {name: moment if name.endswith("moment") else force for name in flat}
    units = {name: unit_of(aircraft, unit) for name, (unit, _) in PERFORMANCE.items()}
    rows = [
        (called, short_number(numbers[name], units[name]), shown_unit(units[name]))
        for name, (_, called) in PERFORMANCE.items()
        if called
    ]
    parts = (
        *report.parts,
        _loads(loads, numbers, force, moment),
        Table(("performance", "value", "unit"), rows),
    )
    return replace(report, parts=parts).with_data(
        loads=flat, load_units=load_units, performance=numbers, performance_units=units
    )


def performance(aircraft: Model, point: OperatingPoint) -> dict[str, float]:
    """The numbers of `PERFORMANCE` at a point, trimmed or not."""
    p, x = hfa_model.parameters_of(aircraft), point.states
    watched, loads = (
        aircraft.outputs_at(x, point.inputs, _WATCHED),
        hfa_model.loads(aircraft, x, point.inputs),
    )
    lift, drag, area = loads.lift, loads.drag, 3 * p.panel_span * p.chord
    force = watched["dynamic_pressure"] * area
    altitude = float(native_values(aircraft, ("altitude",), [x.altitude])[0])
    sound = in_units_of(aircraft, float(speed_of_sound(altitude)), "ft/s")
    found = watched | {
        "weight": 3 * p.panel_mass * p.gravity,
        "wing_area": area,
        "density": in_units_of(aircraft, float(density(altitude)), "slug/ft^3"),
        "speed_of_sound": sound,
        "mach": x.speed / sound,
        "lift_coefficient": lift / force,
        "drag_coefficient": drag / force,
        "lift_over_drag": lift / drag,
    }
    return {name: found[name] for name in PERFORMANCE}


def _loads(loads: Loads, numbers: dict[str, float], unit: str, moment: str) -> Table:
    """A row a load: of the aircraft, its center panel and one outer panel.

    loads: in the units of the model; the forces of a panel are in its own axes.
    numbers: those of `performance`.
    unit: of forces.
    moment: the unit of moments.
    """
    center = loads.center
    outer = loads.outer
    weight = numbers["weight"]
    # q S of one of the three panels: what makes a coefficient of its lift.
    panel_force = numbers["dynamic_pressure"] * numbers["wing_area"] / 3
    coefficients = (
        numbers["lift_coefficient"],
        center.lift / panel_force,
        outer.lift / panel_force,
    )
    rows = [
        ("weight", *_row((weight, weight / 3, weight / 3), unit)),
        ("lift", *_row((loads.lift, center.lift, outer.lift), unit)),
        ("drag", *_row((loads.drag, center.drag, outer.drag), unit)),
        ("thrust", *_row((loads.thrust, None, None), unit)),
        ("lift/drag", f"{numbers['lift_over_drag']:.3f}", "", "", "1"),
        ("lift coefficient", *_row(coefficients, "1")),
        ("pitching moment", *_row((loads.pitching_moment, None, None), moment)),
        ("hinge moment", *_row((None, None, loads.hinge_moment), moment)),
        ("with hinge spring", *_row((None, None, numbers["hinge_moment_total"]), moment)),
    ]
    return Table(("load", "aircraft", "center panel", "outer panel", "unit"), rows)


def _row(values: Iterable[float | None], unit: str) -> tuple[str, ...]:
    """Loads and their unit; nothing where there is none."""
    return *("" if value is None else four_decimals(value) for value in values), unit


#: Length of the longest arrow, of the span of a panel.
_LONGEST = 0.55


class Panel(NamedTuple):
    """A panel from the front; horizontal to the right of the picture and up, in the units of the
    report.

    ends: (2, 2), the ends of its span. middle: (2,), where its forces act. lift: (2,), across the
    panel. weight: (2,)."""

    ends: np.ndarray
    middle: np.ndarray
    lift: np.ndarray
    weight: np.ndarray


def panels_from_the_front(aircraft: Model, point: OperatingPoint) -> tuple[Panel, Panel, Panel]:
    """The right panel, the center panel, the left panel: a pilot's right is left in the picture.

    The hinges lie at (±s/2, 0); an outer panel leaves its hinge at the dihedral angle η, its middle
    is (s/2)(cos η, sin η) further on, its lift L_o points along (∓sin η, cos η)."""
    p, loads = (
        hfa_model.parameters_of(aircraft),
        hfa_model.loads(aircraft, point.states, point.inputs),
    )
    half, weight = (
        p.panel_span / 2,
        np.array([0.0, -(p.panel_mass * p.gravity)]),
    )
    middle, outer = (each.lift for each in (loads.center, loads.outer))
    center = Panel(
        np.array([[-half, 0.0], [half, 0.0]]), np.zeros(2), np.array([0.0, middle]), weight
    )
    cos_eta, sin_eta = np.cos(point.states.dihedral), np.sin(point.states.dihedral)
    right, left = (
        Panel(
            np.array([[side * half, 0.0], [side * half * (1 + 2 * cos_eta), 2 * half * sin_eta]]),
            np.array([side * half * (1 + cos_eta), half * sin_eta]),
            outer * np.array([-side * sin_eta, cos_eta]),
            weight,
        )
        for side in (-1, 1)
    )
    return right, center, left


def scale_text(model: Model, scale: float) -> str:
    """scale: length of a force in the picture over the force, in the units of the model."""
    length = "foot" if unit_of(model, "ft") == "ft" else "meter"
    return f"arrows: {1 / scale:.3g} {unit_of(model, 'lbf')} to the {length}"


def trim_figure(aircraft: Model, point: OperatingPoint) -> Figure:
    """The aircraft from the front in a trim, as a figure.

    Forces are to one scale, stated in the picture; angles and lengths are true; the hinge moments
    are in words."""
    panels = panels_from_the_front(aircraft, point)
    span, x = hfa_model.parameters_of(aircraft).panel_span, point.states
    force = unit_of(aircraft, "lbf")
    length = unit_of(aircraft, "ft")
    of_moment = unit_of(aircraft, "ft lbf")
    scale = (
        _LONGEST
        * span
        / max(
            float(np.linalg.norm(each)) for panel in panels for each in (panel.lift, panel.weight)
        )
    )
    figure = new_figure(10.0, 4.6)
    axes = figure.subplots()
    for panel in panels:
        axes.plot(*panel.ends.T, color="black", linewidth=3.0, solid_capstyle="butt", zorder=2)
        for each, color in ((panel.lift, "C0"), (panel.weight, "0.35")):
            start, end = panel.middle, panel.middle + each * scale
            style = {
                "arrowstyle": "-|>",
                "color": color,
                "linewidth": 2.0,
                "shrinkA": 0,
                "shrinkB": 0,
            }
            axes.annotate("", xy=tuple(end), xytext=tuple(start), arrowprops=style)
            axes.plot(*end, alpha=0.0)  # the arrow counts for the limits of the axes
            size = (
                np.linalg.norm(each)
                if each is panel.weight
                else np.copysign(np.linalg.norm(each), each[1])
            )
            _label(axes, end, f"{size:.1f} {force}", color)
    moment = round(float(hfa_model.loads(aircraft, x, point.inputs).hinge_moment), 1) + 0.0
    for side in (-1, 1):
        place = np.array([side * span / 2, 0.0])
        axes.plot(*place, "o", color="C3", markersize=7, markerfacecolor="white", zorder=3)
        _label(
            axes, place, f"{moment:.1f} {of_moment}", "C3", above=x.dihedral < 0
        )  # where no panel is in the way
    for color, name in (
        ("C0", "lift"),
        ("0.35", "weight"),
        ("C3", "moment of loads and weight about the hinge"),
    ):
        axes.plot([], [], color=color, linewidth=2.0, label=name)
    axes.set_aspect("equal")
    axes.margins(0.02, 0.12)
    width, height = axes.dataLim.size
    figure.set_figheight(
        1.9 + 9.2 * (1.24 * height) / (1.04 * width)
    )  # no empty space at the sides
    axes.set_xlabel(f"{length}, seen from the front")
    axes.set_ylabel(length)
    axes.grid(alpha=0.3)
    figure.legend(loc="outside upper center", ncols=3, fontsize=8, frameon=False)
    axes.set_title(
        f"{point.dynamics} dynamics: {point.status} at dihedral {angle_text(x.dihedral)},"
        f" {aircraft.describe('speed', round(x.speed, 2))},"
        f" {aircraft.describe('altitude', round(x.altitude))}\n{scale_text(aircraft, scale)}",
        fontsize=10,
    )
    return figure


def _label(axes: Axes, place: np.ndarray, text: str, color: str, above: bool | None = None) -> None:
    """The text beyond the end of an arrow, or above or below a place."""
    above = bool(place[1] >= 0) if above is None else above
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
