"""What the aircraft is doing at a trim, in the numbers of a flight manual: C_L, Mach, load factor, climb."""

from __future__ import annotations

from typing import NamedTuple

from hfa_model.aircraft import Aircraft
from hfa_model.atmosphere import density, speed_of_sound
from hfa_model.outputs import moment_of, outputs_of
from trim.point.operating_point import OperatingPoint


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
    moment = moment_of(x, point.inputs, p, aircraft.variant)
    watched = dict(zip(_WATCHED, map(float, outputs_of(moment, _WATCHED)), strict=True))
    lift, drag = float(moment.loads.lift), float(moment.loads.drag)
    wing_area = 3 * p.panel_span * p.chord
    pressure_area = watched["dynamic_pressure"] * wing_area
    sound = float(speed_of_sound(x.altitude))
    return Performance(
        weight=3 * p.panel_mass * p.gravity,
        wing_area=wing_area,
        density=float(density(x.altitude)),
        speed_of_sound=sound,
        mach=x.speed / sound,
        lift_coefficient=lift / pressure_area,
        drag_coefficient=drag / pressure_area,
        lift_over_drag=lift / drag,
        **watched,
    )
