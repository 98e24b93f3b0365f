"""What a trim says: as numbers for JSON, as a table, and as text for a person."""

from __future__ import annotations

import math
from typing import Any

from hfa_model.aerodynamics import Loads, PanelLoads
from hfa_model.compiled import Aircraft
from hfa_model.vectors import INPUT_UNITS, INPUTS, RATE_UNITS, STATE_UNITS, STATES
from trim.condition import TrimCondition
from trim.operating_point import BALANCE, OperatingPoint
from trim.sweep import PAPER_RANGE
from trim.text import Table, columns, degrees, in_degrees

TRIM_SCHEMA = "hfa.trim/1"


def margins(condition: TrimCondition, point: OperatingPoint) -> dict[str, float]:
    """Input -> distance to the nearer of its limits, in its own unit; negative beyond the limit."""
    result = {}
    for name in INPUTS:
        value = getattr(point.inputs, name)
        lowest, highest = condition.limits_of(name)
        result[name] = min(value - lowest, highest - value)
    return result


def trim_data(aircraft: Aircraft, condition: TrimCondition, point: OperatingPoint) -> dict[str, Any]:
    """Everything in a trim report, ready for JSON: radians, feet, pounds, as stored in the point."""
    loads = aircraft.loads(point.states, point.inputs)
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
        "warnings": warnings(point),
    }


def warnings(point: OperatingPoint) -> list[str]:
    """What a user should know before trusting a model at this point."""
    found = []
    if abs(point.states.dihedral) > PAPER_RANGE * (1 + 1e-12):
        found.append(
            f"dihedral {math.degrees(point.states.dihedral):.6g} deg lies beyond the paper's range, "
            f"which ends at {math.degrees(PAPER_RANGE):.0f} deg"
        )
    return found


def trim_table(point: OperatingPoint) -> Table:
    """Header and rows (kind, name, value, unit) of an operating point, angles in radians."""
    rows: list[tuple[Any, ...]] = [
        *(("state", name, getattr(point.states, name), getattr(STATE_UNITS, name)) for name in STATES),
        *(("input", name, getattr(point.inputs, name), getattr(INPUT_UNITS, name)) for name in INPUTS),
        *(("residual", name, value, getattr(RATE_UNITS, name)) for name, value in point.residuals.items()),
    ]
    return ("kind", "name", "value", "unit"), rows


def trim_text(aircraft: Aircraft, condition: TrimCondition, point: OperatingPoint) -> str:
    """The trim report on a terminal, angles in degrees."""
    loads = aircraft.loads(point.states, point.inputs)
    left = margins(condition, point)
    parts = [
        f"Trim, {point.dynamics} dynamics: {point.status}",
        columns(
            ("state", "value", "unit"),
            [(name, *degrees(getattr(point.states, name), getattr(STATE_UNITS, name))) for name in STATES],
        ),
        columns(
            ("input", "value", "unit", "margin"),
            [
                (
                    name,
                    *degrees(getattr(point.inputs, name), getattr(INPUT_UNITS, name)),
                    degrees(left[name], getattr(INPUT_UNITS, name))[0],
                )
                for name in INPUTS
            ],
        ),
        columns(
            ("equation", "residual", "unit", "scaled"),
            [
                (
                    f"rate of {name}",
                    f"{value:.2e}",
                    getattr(RATE_UNITS, name),
                    f"{point.scaled_residuals[name]:.2e}",
                )
                for name, value in point.residuals.items()
            ],
        ),
        columns(
            ("load", "aircraft", "center panel", "outer panel", "unit"),
            [
                ("lift", f"{loads.lift:.4f}", f"{loads.center.lift:.4f}", f"{loads.outer.lift:.4f}", "lbf"),
                ("drag", f"{loads.drag:.4f}", f"{loads.center.drag:.4f}", f"{loads.outer.drag:.4f}", "lbf"),
                ("thrust", f"{loads.thrust:.4f}", "", "", "lbf"),
                ("lift/drag", f"{loads.lift / loads.drag:.3f}", "", "", "1"),
                ("pitching moment", f"{loads.pitching_moment:.4f}", "", "", "ft lbf"),
                ("hinge moment", "", "", f"{loads.hinge_moment:.4f}", "ft lbf"),
            ],
        ),
    ]
    return "\n\n".join(parts + [f"Note: {warning}" for warning in warnings(point)])
