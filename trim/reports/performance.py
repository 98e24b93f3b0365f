"""Loads and performance at a trim, from outputs with known names.

A model states its forces by outputs with these names: lift and drag (aerodynamic, normal to and
along the flight path), thrust, weight, pitching_moment (aerodynamic, about the center of gravity),
dynamic_pressure, mach, reference_area, reference_chord, largest_lift_coefficient.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator

from hfa_support.reporting.rows import Lacking, Row, Sheet
from hfa_support.units import conversion_factor
from trim.reports.flight import OUTPUTS, dynamic_pressure, output_rows
from trim.reports.trimmed import Trimmed

#: Unit of a power in a model -> unit on the sheet, and factor.
_POWERS = {"lbf ft/s": ("hp", 1.0 / 550.0), "N m/s": ("kW", 1e-3)}
#: Unit of a speed in a model -> unit of a rate of climb on the sheet.
_CLIMBS = {"ft/s": ("ft/min", 60.0), "m/s": ("m/s", 1.0)}
#: Outputs that the loads begin with, and those that other rows have.
_LOADS = ("weight", "lift", "drag", "thrust", "thrust_force")
_KNOWN = (*OUTPUTS, *_LOADS, "largest_lift_coefficient")
#: Rows from which a stall is seen, and why the last one is missing then.
_LIFT, _LARGEST, _RATIO = "lift coefficient", "largest lift coefficient", "speed / stall speed"
_PASSED = "beyond the largest lift"
#: Difference of the load factor from 1 that four printed digits show.
_LOAD = 1e-3


def performance_rows(trimmed: Trimmed) -> list[Row | Lacking]:
    """Return loads, L/D, thrust, climb, power and stall of an aircraft."""
    rows: list[Row | Lacking] = [*output_rows(trimmed, _LOADS)]
    if {"speed", "alpha"} <= {*trimmed.roles}:
        rows += [*lift_and_drag(trimmed), *thrust(trimmed), *stall(trimmed)]
    return rows


def other_outputs(trimmed: Trimmed, rows: Iterable[Row | Lacking]) -> Iterator[Row]:
    """Yield the outputs of a model that no variable, imposed value or row of the loads is."""
    model = trimmed.point.model
    known = {*_KNOWN, *model.variables, *trimmed.point.trim_problem.asked.imposed}
    known |= {row.name.replace(" ", "_") for row in rows}
    others = tuple(name for name in model.outputs if name not in known)
    yield from output_rows(trimmed, others, rare=True)


def lift_and_drag(trimmed: Trimmed) -> Iterator[Row | Lacking]:
    """Yield L/D, the power D V, and the coefficients of lift and drag."""
    speed = trimmed.roles["speed"]
    if reason := trimmed.lacks("lift", "drag"):
        yield Lacking("L/D", reason)
        yield Lacking("power required", reason)
    else:
        reason = trimmed.zero("drag")
        yield Lacking("L/D", reason) if reason else Row("L/D", trimmed["lift"] / trimmed["drag"])
        unit = f"{trimmed.unit('drag')} {trimmed.unit(speed)}"
        shown, factor = _POWERS.get(unit, (unit, 1.0))
        yield Row("power required", trimmed["drag"] * trimmed[speed] * factor, shown)
    if not lacks_coefficient(trimmed):
        force = trimmed["dynamic_pressure"] * trimmed["reference_area"]
        yield Row(_LIFT, trimmed["lift"] / force)
        if "drag" in trimmed.model.outputs:
            yield Row("drag coefficient", trimmed["drag"] / force)


def lacks_coefficient(trimmed: Trimmed) -> str:
    """Return why the lift has no coefficient, or ""."""
    names = ("lift", "dynamic_pressure", "reference_area")
    return trimmed.lacks(*names) or trimmed.zero(*names[1:])


def thrust(trimmed: Trimmed) -> Iterator[Row | Lacking]:
    """Yield the thrust with all engine inputs at their highest values, the excess over the thrust,
    and the rate of climb that it allows at constant speed, excess V cos α / weight.
    """
    available = trimmed.thrust_available
    if isinstance(available, str):
        for name in ("thrust available", "excess thrust", "rate of climb left"):
            yield Lacking(name, available)
        return
    unit = trimmed.unit(trimmed.thrust_name)
    excess = available - trimmed[trimmed.thrust_name]
    yield Row("thrust available", available, unit)
    yield Row("excess thrust", excess, unit)
    if reason := trimmed.lacks("weight") or trimmed.zero("weight"):
        yield Lacking("rate of climb left", reason)
        return
    speed, alpha = (trimmed[trimmed.roles[role]] for role in ("speed", "alpha"))
    given = trimmed.unit(trimmed.roles["speed"])
    shown, factor = _CLIMBS.get(given, (given, 1.0))
    climb = excess * math.cos(alpha) * speed / trimmed["weight"]
    yield Row("rate of climb left", climb * factor, shown, "at constant speed")


def stall(trimmed: Trimmed) -> Iterator[Row | Lacking]:
    """Yield the largest lift coefficient, the speed over the stall speed at 1 g, the same at the
    load factor of the trim if it is another one, and the stall speed at 1 g, V sqrt(W / largest
    lift). Without a weight, the load factor is that of the lift.
    """
    reason = lacks_coefficient(trimmed) or trimmed.zero("lift")
    largest = None if reason else trimmed.largest_lift
    if largest is None:
        yield Lacking(_RATIO, reason or "no CL_max, and lift without a maximum")
        return
    force = trimmed["dynamic_pressure"] * trimmed["reference_area"]
    where = ""
    if math.isfinite(largest.alpha):
        where = f"at alpha {math.degrees(largest.alpha):.4g} deg"
    yield Row(_LARGEST, largest.lift / force, note=where)
    if largest.lift <= 0.0:
        return
    if largest.passed:
        yield Lacking(_RATIO, _PASSED)
    else:
        yield from _speed_ratios(trimmed, largest.lift)
    if _has_weight(trimmed):
        yield from stall_speed(trimmed, math.sqrt(trimmed["weight"] / largest.lift))


def _speed_ratios(trimmed: Trimmed, largest_lift: float) -> Iterator[Row]:
    """Yield the speed over the stall speed at 1 g, and at the load factor of the trim if it is
    another one; without a weight, over the stall speed at the lift of the trim.
    """
    if _has_weight(trimmed):
        ratio = math.sqrt(largest_lift / trimmed["weight"])
        yield Row(_RATIO, ratio, note="V/Vs, stall at 1 g")
        load = trimmed["load_factor"] if "load_factor" in trimmed.model.outputs else 1.0
        if load > 0.0 and abs(load - 1.0) > _LOAD:
            at_load = "V/Vs, stall at this load factor"
            yield Row(f"{_RATIO} at n", ratio / math.sqrt(load), note=at_load)
    elif trimmed["lift"] > 0.0:
        ratio = math.sqrt(largest_lift / trimmed["lift"])
        yield Row(_RATIO, ratio, note="V/Vs, stall at this lift")


def _has_weight(trimmed: Trimmed) -> bool:
    """Return whether the model has the output weight, and it is positive."""
    return "weight" in trimmed.model.outputs and trimmed["weight"] > 0.0


def stall_speed(trimmed: Trimmed, share: float) -> Iterator[Row]:
    """Yield the stall speed at 1 g, kt: a share of the speed."""
    speed = trimmed.roles["speed"]
    knots = conversion_factor(trimmed.unit(speed), "kt")
    if knots is None:
        return
    true = trimmed[speed] * knots * share
    pressure = dynamic_pressure(trimmed)
    if isinstance(pressure, str):
        yield Row("stall speed at 1 g", true, "kt", "Vs, KTAS")
    else:
        from hfa_aircraft.rigid.atmosphere import equivalent_airspeed

        equivalent = equivalent_airspeed(pressure) * share
        yield Row("stall speed at 1 g", equivalent, "kt", f"Vs, KEAS; {true:.4g} KTAS")


def stall_lines_at(trimmed: Trimmed) -> list[str]:
    """Return sentences on a trim beyond the largest lift."""
    if not trimmed.point.ok or not {"speed", "alpha"} <= {*trimmed.roles}:
        return []
    return stall_lines(Sheet.of([("", [*lift_and_drag(trimmed), *stall(trimmed)], ())]))


def stall_lines(sheet: Sheet) -> list[str]:
    """Return sentences on a trim beyond the largest lift, by the rows of its sheet."""
    rows = {row.name: row for row in sheet}
    if _LARGEST not in rows:
        return []
    largest, lift = float(rows[_LARGEST]), float(rows[_LIFT])
    if sheet.lacking.get(_RATIO) == _PASSED:
        return [f"STALLED: {_PASSED}, CL {largest:.4g} {rows[_LARGEST].note}"]
    if lift > largest:
        return [f"STALLED: CL {lift:.4g} is above CL_max {largest:.4g} of the table"]
    return []
