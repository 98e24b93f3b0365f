"""What a trim says."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from hfa_model.aerodynamics import Loads, PanelLoads
from hfa_model.aircraft import Aircraft
from hfa_model.support.report import Report
from hfa_model.support.text import Table, angle_text, degrees, in_degrees
from hfa_model.vectors import INPUT_UNITS, INPUTS, RATE_UNITS, STATE_UNITS, STATES, UNITS
from trim.point.condition import PAPER_RANGE, TrimCondition
from trim.point.operating_point import BALANCE, OperatingPoint

TRIM_SCHEMA = "hfa.trim/1"


def margins(condition: TrimCondition, point: OperatingPoint) -> dict[str, float]:
    """Input or free variable -> distance to the nearer of its limits, in its own unit; negative beyond the limit.

    The pitch angle is there when alpha or gamma is free. What has no limits has no margin.
    """
    values = {**point.inputs._asdict(), **point.states._asdict(), "gamma": point.gamma}
    result = {}
    pitch = ("pitch",) if {"alpha", "gamma"} & set(condition.free) else ()
    for name in dict.fromkeys((*INPUTS, *condition.free, *pitch)):
        lowest, highest = condition.limits_of(name)
        margin = min(values[name] - lowest, highest - values[name])
        if math.isfinite(margin):
            result[name] = margin
    return result


def warnings(point: OperatingPoint) -> list[str]:
    """What a user should know before trusting a model at this point."""
    if abs(point.states.dihedral) <= PAPER_RANGE * (1 + 1e-12):
        return []
    return [
        f"dihedral {angle_text(point.states.dihedral)} lies beyond the paper's range, "
        f"which ends at {angle_text(PAPER_RANGE)}"
    ]


def trim_report(aircraft: Aircraft, condition: TrimCondition, point: OperatingPoint) -> Report:
    """State, inputs, the residual of each equation, loads and margins; angles in degrees for people."""
    loads = aircraft.loads(point.states, point.inputs)
    left = margins(condition, point)
    # The flight-path angle is no state: it stands among them where it is an unknown.
    states = point.states._asdict() | ({"gamma": point.gamma} if "gamma" in condition.free else {})
    load_rows = [
        ("lift", f"{loads.lift:.4f}", f"{loads.center.lift:.4f}", f"{loads.outer.lift:.4f}", "lbf"),
        ("drag", f"{loads.drag:.4f}", f"{loads.center.drag:.4f}", f"{loads.outer.drag:.4f}", "lbf"),
        ("thrust", f"{loads.thrust:.4f}", "", "", "lbf"),
        ("lift/drag", f"{loads.lift / loads.drag:.3f}", "", "", "1"),
        ("pitching moment", f"{loads.pitching_moment:.4f}", "", "", "ft lbf"),
        ("hinge moment", "", "", f"{loads.hinge_moment:.4f}", "ft lbf"),
    ]
    return Report(
        title=_title(point),
        parts=(
            _values("state", states, left),
            _values("input", point.inputs._asdict(), left),
            _residuals(point),
            Table(("load", "aircraft", "center panel", "outer panel", "unit"), load_rows),
        ),
        notes=warnings(point),
        data=_data(condition, point, loads),
        records=_records(point),
    )


def operating_point_report(point: OperatingPoint) -> Report:
    """State, inputs and residuals: what a point knows of itself, without the aircraft and the condition."""
    parts = _values("state", point.states._asdict()), _values("input", point.inputs._asdict()), _residuals(point)
    return Report(_title(point), parts, warnings(point), point.to_dict(), _records(point))


def _title(point: OperatingPoint) -> str:
    return f"Trim, {point.dynamics} dynamics: {point.status}"


def _residuals(point: OperatingPoint) -> Table:
    rows = [
        (f"rate of {name}", f"{value:.2e}", getattr(RATE_UNITS, name), f"{point.scaled_residuals[name]:.2e}")
        for name, value in point.residuals.items()
    ]
    return Table(("equation", "residual", "unit", "scaled"), rows)


def _data(condition: TrimCondition, point: OperatingPoint, loads: Loads) -> dict[str, Any]:
    """Radians, feet, pounds, as stored in the point."""
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


def _records(point: OperatingPoint) -> Table:
    """Header and rows (kind, name, value, unit) of an operating point, angles in radians."""
    rows: list[tuple[Any, ...]] = [
        *(("state", name, getattr(point.states, name), getattr(STATE_UNITS, name)) for name in STATES),
        *(("input", name, getattr(point.inputs, name), getattr(INPUT_UNITS, name)) for name in INPUTS),
        *(("residual", name, value, getattr(RATE_UNITS, name)) for name, value in point.residuals.items()),
    ]
    return Table(("kind", "name", "value", "unit"), rows)


def _values(kind: str, values: Mapping[str, float], left: Mapping[str, float] = {}) -> Table:
    """Values with their units, and margins where there are any."""
    rows = [
        (name, *degrees(value, UNITS[name]), degrees(left[name], UNITS[name])[0] if name in left else "")
        for name, value in values.items()
    ]
    width = 4 if any(name in left for name in values) else 3
    return Table((kind, "value", "unit", "margin")[:width], [row[:width] for row in rows])
