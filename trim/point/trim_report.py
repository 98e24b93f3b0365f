"""What a trim says."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Any

from hfa_model.aerodynamics import Loads, PanelLoads
from hfa_model.aircraft import Aircraft
from hfa_model.vectors import INPUTS, RATE_UNITS, STATES
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
from trim.point.condition import TrimCondition
from trim.point.operating_point import BALANCE, OperatingPoint, tolerance
from trim.point.performance import PERFORMANCE_UNITS, Performance, performance
from trim.point.trim_margins import Margin, all_margins, margins, nearest_limits

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
