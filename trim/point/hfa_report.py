"""What a trim of the HFA says beside that of any model: loads, and the numbers of a flight manual."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from typing import NamedTuple

from hfa_model.aerodynamics import Loads, PanelLoads
from hfa_model.aircraft import Aircraft
from hfa_model.atmosphere import density, speed_of_sound
from hfa_support.reporting.report import Report
from hfa_support.reporting.text import Table, four_decimals, short_number, shown_unit
from hfa_support.reporting.unit_system import in_force, unit_in_force
from trim.point.operating_point import OperatingPoint


def with_loads(report: Report, aircraft: Aircraft, point: OperatingPoint) -> Report:
    """The report of a trim with the loads on the aircraft and its panels, and its performance."""
    loads, numbers = aircraft.loads(point.states, point.inputs), performance(aircraft, point)
    flat = {name: getattr(loads, name) for name in Loads._fields if name not in ("center", "outer")}
    for panel in ("center", "outer"):
        flat |= {f"{panel}_{name}": getattr(getattr(loads, panel), name) for name in PanelLoads._fields}
    data = {"loads": flat, "performance": numbers._asdict(), "performance_units": PERFORMANCE_UNITS}
    parts = (*report.parts, _loads(loads, numbers), _performance(numbers))
    return replace(report, parts=parts).with_data(**data)


class Performance(NamedTuple):
    """Steady flight in numbers; units in `PERFORMANCE_UNITS`.

    weight: W = 3 m g. wing_area: S = 3 s c, without the tails. The coefficients are C_L = L / (q S) and
    C_D = D / (q S) of the whole aircraft, tails included, with q = ρ V² / 2. hinge_moment_total: of loads and weight
    about a hinge, with spring and damper, zero in balance. The others as in `OUTPUTS` of `hfa_model/outputs.py`.
    """

    weight: float
    wing_area: float
    density: float
    dynamic_pressure: float
    speed_of_sound: float
    mach: float
    lift_coefficient: float
    drag_coefficient: float
    lift_over_drag: float
    load_factor: float
    gamma: float
    climb_rate: float
    hinge_moment_total: float


PERFORMANCE_UNITS: dict[str, str] = {
    "weight": "lbf",
    "wing_area": "ft^2",
    "density": "slug/ft^3",
    "dynamic_pressure": "lbf/ft^2",
    "speed_of_sound": "ft/s",
    "mach": "1",
    "lift_coefficient": "1",
    "drag_coefficient": "1",
    "lift_over_drag": "1",
    "load_factor": "1",
    "gamma": "rad",
    "climb_rate": "ft/s",
    "hinge_moment_total": "ft lbf",
}

_WATCHED = ("dynamic_pressure", "load_factor", "gamma", "climb_rate", "hinge_moment_total")


def performance(aircraft: Aircraft, point: OperatingPoint) -> Performance:
    """The numbers at a point, trimmed or not."""
    p, x = aircraft.parameters, point.states
    watched = aircraft.model.outputs_at(x, point.inputs, _WATCHED)
    loads = aircraft.loads(x, point.inputs)
    wing_area = 3 * p.panel_span * p.chord
    pressure_area = watched["dynamic_pressure"] * wing_area
    sound = float(speed_of_sound(x.altitude))
    return Performance(
        weight=3 * p.panel_mass * p.gravity,
        wing_area=wing_area,
        density=float(density(x.altitude)),
        speed_of_sound=sound,
        mach=x.speed / sound,
        lift_coefficient=loads.lift / pressure_area,
        drag_coefficient=loads.drag / pressure_area,
        lift_over_drag=loads.lift / loads.drag,
        **watched,
    )


def _loads(loads: Loads, numbers: Performance) -> Table:
    """Of the aircraft, its center panel and one outer panel; the forces of a panel in its own axes."""
    panel_weight, panel_pressure_area = numbers.weight / 3, numbers.dynamic_pressure * numbers.wing_area / 3
    weights, coefficients = [numbers.weight, panel_weight, panel_weight], [numbers.lift_coefficient]
    coefficients += [panel.lift / panel_pressure_area for panel in (loads.center, loads.outer)]
    rows = [
        ("weight", *_row(weights, "lbf")),
        ("lift", *_row((loads.lift, loads.center.lift, loads.outer.lift), "lbf")),
        ("drag", *_row((loads.drag, loads.center.drag, loads.outer.drag), "lbf")),
        ("thrust", *_row((loads.thrust, None, None), "lbf")),
        ("lift/drag", f"{numbers.lift_over_drag:.3f}", "", "", "1"),
        ("lift coefficient", *_row(coefficients, "1")),
        ("pitching moment", *_row((loads.pitching_moment, None, None), "ft lbf")),
        ("hinge moment", *_row((None, None, loads.hinge_moment), "ft lbf")),
        ("with hinge spring", *_row((None, None, numbers.hinge_moment_total), "ft lbf")),
    ]
    return Table(("load", "aircraft", "center panel", "outer panel", "unit"), rows)


def _row(values: Iterable[float | None], unit: str) -> tuple[str, ...]:
    """Loads and their unit; nothing where there is none."""
    return *("" if value is None else four_decimals(in_force(value, unit)) for value in values), unit_in_force(unit)


_SHOWN_PERFORMANCE = {
    "dynamic_pressure": "dynamic pressure q",
    "density": "air density",
    "speed_of_sound": "speed of sound",
    "mach": "Mach number",
    "wing_area": "wing area S, without tails",
    "drag_coefficient": "drag coefficient D/(q S)",
    "load_factor": "load factor",
    "gamma": "flight-path angle",
    "climb_rate": "climb rate",
}


def _performance(numbers: Performance) -> Table:
    rows = []
    for name, shown in _SHOWN_PERFORMANCE.items():
        unit = PERFORMANCE_UNITS[name]
        rows.append((shown, short_number(getattr(numbers, name), unit), shown_unit(unit)))
    return Table(("performance", "value", "unit"), rows)
