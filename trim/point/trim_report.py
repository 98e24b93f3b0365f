"""What a trim says: every variable between its limits, each equation, loads, and the numbers of a flight manual."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Any, NamedTuple

from hfa_model.aerodynamics import Loads, PanelLoads
from hfa_model.aircraft import Aircraft
from hfa_model.atmosphere import density, speed_of_sound
from hfa_model.outputs import moment_of, outputs_of
from hfa_model.vectors import INPUTS, RATE_UNITS, STATES, UNITS
from hfa_support.jsonable import finite_or_none
from hfa_support.reporting.report import Report
from hfa_support.reporting.text import (
    Cell,
    Table,
    degrees,
    four_decimals,
    in_degrees,
    short_number,
    shown_unit,
    shown_value,
)
from hfa_support.reporting.unit_system import in_force, unit_in_force
from trim.point.condition import SCALES, TrimCondition
from trim.point.operating_point import BALANCE, OperatingPoint, tolerance


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


#: A variable is at its limit when it is this close to it, in its scaled unit and relative to the limit.
_CLOSE = 1e-6


class Margin(NamedTuple):
    """A variable between its limits, in its own unit: rad, ft, lbf.

    role: "free", "held", or "alpha + gamma" for the pitch angle where one of these is free. A limit that does not
    exist is infinite.
    """

    name: str
    value: float
    role: str
    lowest: float
    highest: float

    @property
    def unit(self) -> str:
        """Unit of value and limits."""
        return UNITS[self.name]

    @property
    def distance(self) -> float:
        """min(value - lowest, highest - value): to the nearer limit; negative beyond it, infinite without one."""
        return min(self.value - self.lowest, self.highest - self.value)

    @property
    def nearer(self) -> str:
        """Which limit the distance is to: "lowest" or "highest"; empty where there is none."""
        if math.isinf(self.distance):
            return ""
        return "lowest" if self.value - self.lowest <= self.highest - self.value else "highest"

    @property
    def nearer_limit(self) -> float:
        """The value of the nearer limit."""
        return self.lowest if self.nearer == "lowest" else self.highest

    @property
    def share(self) -> float:
        """distance / (highest - lowest): 0 at a limit, 0.5 halfway; 0 where the range is infinite."""
        return self.distance / (self.highest - self.lowest)

    @property
    def at_limit(self) -> bool:
        """Whether the variable is at its nearer limit or beyond it."""
        return bool(self.nearer) and self.distance <= _CLOSE * (SCALES[self.name] + abs(self.nearer_limit))

    @property
    def binds(self) -> bool:
        """Whether a limit keeps the variable where it is: one that is held stands where it was put."""
        return self.at_limit and self.role != "held"


def all_margins(condition: TrimCondition, point: OperatingPoint) -> dict[str, Margin]:
    """Every state, input and the flight-path angle, in this order: states, gamma, inputs."""
    role = dict.fromkeys(condition.imposed, "held") | dict.fromkeys(condition.free, "free")
    role["pitch"] = "alpha + gamma" if {"alpha", "gamma"} & set(condition.free) else "held"
    return {
        name: Margin(name, point.values[name], role[name], *condition.limits_of(name))
        for name in (*STATES, "gamma", *INPUTS)
    }


def margins(condition: TrimCondition, point: OperatingPoint) -> dict[str, float]:
    """Input or free variable -> distance to the nearer of its limits, in its own unit; negative beyond the limit.

    The pitch angle is there when alpha or gamma is free. What has no limits has no margin.
    """
    return {each.name: each.distance for each in margins_that_count(condition, point)}


def margins_that_count(condition: TrimCondition, point: OperatingPoint) -> list[Margin]:
    """The limited inputs and free variables: what the trim used up, or could."""
    every = all_margins(condition, point)
    pitch = ("pitch",) if every["pitch"].role != "held" else ()
    names = dict.fromkeys((*INPUTS, *condition.free, *pitch))
    return [every[name] for name in names if every[name].nearer]


def nearest_limits(condition: TrimCondition, point: OperatingPoint) -> list[Margin]:
    """The three margins that are the least share of their range, and all others that are at a limit; least first."""
    ordered = sorted(margins_that_count(condition, point), key=lambda each: each.share)
    return [each for index, each in enumerate(ordered) if index < 3 or each.at_limit]


TRIM_SCHEMA = "hfa.trim/1"


def trim_report(aircraft: Aircraft, condition: TrimCondition, point: OperatingPoint) -> Report:
    """Every variable between its limits, the limits that bind, the verdict on each equation, loads and performance;
    angles in degrees for people."""
    loads = aircraft.loads(point.states, point.inputs)
    numbers = performance(aircraft, point)
    every = all_margins(condition, point)
    return Report(
        title=point.title,
        parts=(
            _variables("state", [every[name] for name in (*STATES, "gamma")]),
            _variables("input", [every[name] for name in INPUTS]),
            _nearest(nearest_limits(condition, point)),
            point.equations(condition.rates),
            _loads(loads, numbers),
            _performance(numbers),
        ),
        notes=point.warnings,
        data=_data(condition, point, loads, numbers),
        records=point.records(),
    )


def _variables(kind: str, standing: list[Margin]) -> Table:
    rows = [
        (
            each.name,
            *degrees(each.value, each.unit),
            each.role,
            *("" if math.isinf(limit) else shown_value(limit, each.unit) for limit in (each.lowest, each.highest)),
            _margin(each),
            each.nearer,
        )
        for each in standing
    ]
    return Table((kind, "value", "unit", "is", "lowest", "highest", "margin", "to"), rows)


def _margin(each: Margin) -> str:
    """The distance to the nearer limit, and where in its range the value lies; nothing where there is no limit."""
    if not each.nearer:
        return ""
    shown = degrees(each.distance, each.unit)[0]
    width = each.highest - each.lowest
    return shown if math.isinf(width) else Cell(shown, place=(each.value - each.lowest) / width)


def _nearest(nearest: list[Margin]) -> Table:
    rows = [
        (
            f"{each.name}, {each.nearer}",
            shown_value(each.nearer_limit, each.unit),
            degrees(each.distance, each.unit)[0],
            shown_unit(each.unit),
            f"{100 * each.share:.1f} %",
            Cell("BINDS", "far") if each.binds else "held there" if each.at_limit else "-",
        )
        for each in nearest
    ]
    return Table(("nearest limit", "limit", "margin", "unit", "of its range", "verdict"), rows)


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


def _data(condition: TrimCondition, point: OperatingPoint, loads: Loads, numbers: Performance) -> dict[str, Any]:
    """Radians, feet, pounds, as stored in the point."""
    nearest = nearest_limits(condition, point)
    return {
        "schema": TRIM_SCHEMA,
        "status": str(point.status),
        "dihedral_deg": in_degrees(point.states.dihedral),
        "dynamics": point.dynamics,
        "operating_point": point.to_dict(),
        "scaled_residuals": point.scaled_residuals,
        "balance_limit": BALANCE,
        "loads": {name: getattr(loads, name) for name in Loads._fields if name not in ("center", "outer")}
        | {
            f"{panel}_{name}": getattr(getattr(loads, panel), name)
            for panel in ("center", "outer")
            for name in PanelLoads._fields
        },
        "margins": margins(condition, point),
        "variables": {name: _variable_data(each) for name, each in all_margins(condition, point).items()},
        "nearest_limits": [each.name for each in nearest],
        "binding": [each.name for each in nearest if each.binds],
        "equations": {
            name: {
                "imposed": condition.rates[name],
                "residual": value,
                "tolerance": tolerance(name),
                "unit": getattr(RATE_UNITS, name),
                "ok": point.balances(name),
            }
            for name, value in point.residuals.items()
        },
        "performance": numbers._asdict(),
        "performance_units": PERFORMANCE_UNITS,
        "warnings": point.warnings,
    }


def _variable_data(variable: Margin) -> dict[str, Any]:
    return {
        "value": variable.value,
        "unit": variable.unit,
        "role": variable.role,
        "lowest": finite_or_none(variable.lowest),
        "highest": finite_or_none(variable.highest),
        "margin": finite_or_none(variable.distance),
        "nearer": variable.nearer,
        "at_limit": variable.at_limit,
    }
