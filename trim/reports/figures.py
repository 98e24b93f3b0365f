"""Rows of a sheet that describe the flight: air, performance and stability."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from itertools import chain

from hfa_aircraft.limits import NEAR
from hfa_aircraft.rigid.atmosphere import (
    GAS_CONSTANT,
    HEAT_RATIO,
    calibrated_airspeed,
    equivalent_airspeed,
)
from hfa_support.reporting.rows import Lacking, Row
from hfa_support.reporting.text import beside_unit, digits_with_unit, shown_value, without_rounding
from hfa_support.units import conversion_factor
from trim.point.operating_point import beyond_range
from trim.point.status import BALANCE
from trim.reports.trimmed import Quantity, Trimmed

#: Outputs of the flight: relative to the ground, which are read first in a steady wind, and to the
#: air. They are not repeated among the loads.
_GROUND_OUTPUTS = ("ground_speed", "track")
_AIR_OUTPUTS = ("mach", "dynamic_pressure", "load_factor")
OUTPUTS = (*_GROUND_OUTPUTS, *_AIR_OUTPUTS)
#: Outputs from which airspeeds, density and temperature follow.
_OF_THE_AIR = ("dynamic_pressure", "mach")


def flight_rows(trimmed: Trimmed) -> Iterator[Row | Lacking]:
    """Return the rows of the flight other than variables: airspeeds, air, load factor, unbalanced
    rates, distances from the condition of the derivatives, and ranges in which the model is valid.
    """
    rows: list[Iterator[Row | Lacking]] = []
    if (airspeed := trimmed.airspeed) is not None:
        rows.append(airspeed_rows(trimmed, airspeed))
        rows.append(output_rows(trimmed, _GROUND_OUTPUTS, rare=not trimmed.in_wind))
        rows.append(output_rows(trimmed, _AIR_OUTPUTS))
        rows.append(air_rows(trimmed, airspeed))
    elif trimmed.model.about.atmosphere:
        rows.append(iter([Row("atmosphere", trimmed.model.about.atmosphere)]))
    rows += [unbalanced_rates(trimmed), domain_rows(trimmed)]
    return (row for row in chain(*rows) if row.name not in trimmed.point.margins)


def output_rows(trimmed: Trimmed, names: tuple[str, ...], rare: bool = False) -> Iterator[Row]:
    """Yield a row for each of the named outputs that the model has, in the units of the condition.

    rare: whether only a full sheet prints the rows
    """
    model = trimmed.point.model
    for name in names:
        if name in model.outputs:
            value = without_rounding(trimmed.point[name], model.signal(name).nominal)
            yield Row(name.replace("_", " "), value, model.unit(name), rare=rare)


def airspeed_rows(trimmed: Trimmed, airspeed: Quantity) -> Iterator[Row | Lacking]:
    """Yield the true, the calibrated and the equivalent airspeed, kt, or what is missing for the
    last two. A speed without a known unit has no row of the true airspeed.
    """
    knots = conversion_factor(airspeed.unit, "kt")
    if knots is not None:
        yield Row("true airspeed", airspeed.value * knots, "kt", "KTAS")
    if reason := trimmed.lacks(nonzero=_OF_THE_AIR):
        yield Lacking("calibrated airspeed", reason)
        yield Lacking("equivalent airspeed", reason)
        return
    pressure = dynamic_pressure(trimmed)
    yield Row("calibrated airspeed", calibrated_airspeed(pressure, trimmed["mach"]), "kt", "KCAS")
    yield Row("equivalent airspeed", equivalent_airspeed(pressure), "kt", "KEAS")


def dynamic_pressure(trimmed: Trimmed) -> float:
    """Return the dynamic pressure, N/m²; nan if its unit is unknown."""
    factor = conversion_factor(trimmed.unit("dynamic_pressure"), "N/m^2")
    return trimmed["dynamic_pressure"] * (factor or math.nan)


def air_rows(trimmed: Trimmed, airspeed: Quantity) -> Iterator[Row | Lacking]:
    """Yield density and temperature, which follow from dynamic pressure, speed and Mach number, or
    else the name of the atmosphere.
    """
    atmosphere = trimmed.model.about.atmosphere
    if not atmosphere:
        yield Lacking("atmosphere", "")
        return
    velocity = airspeed.value * (conversion_factor(airspeed.unit, "m/s") or 0.0)
    if trimmed.lacks(nonzero=_OF_THE_AIR) or not velocity:
        yield Row("atmosphere", atmosphere)
        return
    density = 2.0 * dynamic_pressure(trimmed) / velocity**2  # kg/m³
    unit = "kg/m^3" if airspeed.unit == "m/s" else "slug/ft^3"
    yield Row("density", density * (conversion_factor("kg/m^3", unit) or 1.0), unit, atmosphere)
    temperature = (velocity / trimmed["mach"]) ** 2 / (HEAT_RATIO * GAS_CONSTANT)
    yield Row("temperature", temperature, "K")


def unbalanced_rates(trimmed: Trimmed) -> Iterator[Row]:
    """Yield the rates that the condition does not balance and that are not 0."""
    model = trimmed.point.model
    balanced = trimmed.point.trim_problem.asked.rates
    for name, rate in trimmed.rates.items():
        if name not in balanced and abs(rate) > BALANCE * model.rate_scale(name):
            yield Row(f"{name}_dot", rate, model.rate_unit(name), "not balanced")


def domain_rows(trimmed: Trimmed) -> Iterator[Row]:
    """Yield a row for each variable of a table of derivatives, with its difference from the
    condition of the table, and a row for each range of validity, with whether the trim is inside
    the range.
    """
    model = trimmed.point.model
    for name, stated in model.domain.reference.items():
        unit = model.unit(name)
        text = digits_with_unit(stated, unit, 4) if math.isfinite(stated) else "unknown"
        difference = trimmed.point[name] - stated
        is_same = abs(difference) <= NEAR * (model.signal(name).nominal + abs(stated))
        yield Row(f"{name} from the table's", difference, unit, f"table: {text}", rare=is_same)
    for name, (lowest, highest, source) in model.domain.range.items():
        unit = model.unit(name)
        ends = " to ".join(shown_value(end, unit, ".5g") for end in (lowest, highest))
        is_inside = not beyond_range(model, {name: trimmed.point[name]})
        yield Row(
            f"{name} in its range",
            "inside" if is_inside else "OUTSIDE",
            note=f"{beside_unit(ends, unit)}, {source}",
            tone="" if is_inside else "bad",
        )


#: Unit of a power in a model -> unit on the sheet, and factor.
_SHOWN_POWERS = {"lbf ft/s": ("hp", 1.0 / 550.0), "N m/s": ("kW", 1e-3)}
#: Unit of a speed in a model -> unit of a rate of climb on the sheet.
_SHOWN_CLIMBS = {"ft/s": ("ft/min", 60.0), "m/s": ("m/s", 1.0)}
#: Outputs that the loads begin with, and all outputs that rows with a name of their own show.
_LOAD_OUTPUTS = ("weight", "lift", "drag", "thrust", "thrust_force")
_SHOWN_ELSEWHERE = (*OUTPUTS, *_LOAD_OUTPUTS, "largest_lift_coefficient")
#: Name of the row V/Vs, and why a stalled trim does not have it.
_SPEED_RATIO = "speed / stall speed"
_BEYOND_LARGEST_LIFT = "beyond the largest lift"
#: Difference of the load factor from 1 that four printed digits show.
_SHOWN_LOAD_DIFFERENCE = 1e-3


def performance_rows(trimmed: Trimmed) -> list[Row | Lacking]:
    """Return the rows of loads and, for an aircraft, of L/D, thrust, climb, power and stall."""
    rows: list[Row | Lacking] = [*output_rows(trimmed, _LOAD_OUTPUTS)]
    if trimmed.airspeed is not None and not math.isnan(trimmed.alpha):
        rows += [*lift_and_drag(trimmed, trimmed.airspeed), *thrust(trimmed, trimmed.airspeed)]
        rows += stall(trimmed, trimmed.airspeed)
    return rows


def other_outputs(trimmed: Trimmed, rows: Iterable[Row | Lacking]) -> Iterator[Row]:
    """Yield the outputs of a model that no other row of its sheet shows.

    rows: rows of the loads
    """
    model = trimmed.point.model
    # Imposed outputs are rows of the variables. Names of rows have blanks, "thrust force".
    known = {*_SHOWN_ELSEWHERE, *model.variables, *trimmed.point.trim_problem.asked.imposed}
    known |= {row.name.replace(" ", "_") for row in rows}
    others = tuple(name for name in model.outputs if name not in known)
    yield from output_rows(trimmed, others, rare=True)


def lift_and_drag(trimmed: Trimmed, airspeed: Quantity) -> Iterator[Row | Lacking]:
    """Yield L/D, the power D V, and the coefficients of lift and drag."""
    if reason := trimmed.lacks("lift", "drag"):
        yield Lacking("L/D", reason)
        yield Lacking("power required", reason)
    else:
        no_ratio = trimmed.lacks(nonzero=("drag",))
        yield (
            Lacking("L/D", no_ratio) if no_ratio else Row("L/D", trimmed["lift"] / trimmed["drag"])
        )
        unit = f"{trimmed.unit('drag')} {airspeed.unit}"
        shown, factor = _SHOWN_POWERS.get(unit, (unit, 1.0))
        yield Row("power required", trimmed["drag"] * airspeed.value * factor, shown)
    if not trimmed.lacks("lift", nonzero=("dynamic_pressure", "reference_area")):
        force = trimmed["dynamic_pressure"] * trimmed["reference_area"]
        yield Row("lift coefficient", trimmed["lift"] / force)
        if "drag" in trimmed.model.outputs:
            yield Row("drag coefficient", trimmed["drag"] / force)


def thrust(trimmed: Trimmed, airspeed: Quantity) -> Iterator[Row | Lacking]:
    """Yield the thrust with all engine inputs at their highest values, its excess over the present
    thrust, and the rate of climb that this excess permits at constant speed, excess V cos α /
    weight.
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
    if reason := trimmed.lacks(nonzero=("weight",)):
        yield Lacking("rate of climb left", reason)
        return
    shown, factor = _SHOWN_CLIMBS.get(airspeed.unit, (airspeed.unit, 1.0))
    climb = excess * math.cos(trimmed.alpha) * airspeed.value / trimmed["weight"]
    yield Row("rate of climb left", climb * factor, shown, "at constant speed")


def stall(trimmed: Trimmed, airspeed: Quantity) -> Iterator[Row | Lacking]:
    """Yield the largest lift coefficient, the ratio of speed to stall speed, and the stall speed at
    1 g, V sqrt(W / largest lift). The ratio is that at 1 g and, if the load factor of the trim
    differs from 1, also that at this load factor; without a weight, it is that at the lift of the
    trim.
    """
    largest = trimmed.largest_lift
    if isinstance(largest, str):
        yield Lacking(_SPEED_RATIO, largest)
        return
    force = trimmed["dynamic_pressure"] * trimmed["reference_area"]
    yield Row("largest lift coefficient", largest.lift / force, note=largest.where)
    if largest.lift <= 0.0:
        return

    # Speed over stall speed: lift is proportional to V².
    outputs = trimmed.model.outputs
    weight = trimmed["weight"] if "weight" in outputs else math.nan
    if largest.trim_is_beyond:
        yield Lacking(_SPEED_RATIO, _BEYOND_LARGEST_LIFT)
    elif weight > 0.0:
        ratio = math.sqrt(largest.lift / weight)
        yield Row(_SPEED_RATIO, ratio, note="V/Vs, stall at 1 g")
        load = trimmed["load_factor"] if "load_factor" in outputs else 1.0
        if load > 0.0 and abs(load - 1.0) > _SHOWN_LOAD_DIFFERENCE:
            at_load = ratio / math.sqrt(load)
            yield Row(f"{_SPEED_RATIO} at n", at_load, note="V/Vs, stall at this load factor")
    elif trimmed["lift"] > 0.0:
        ratio = math.sqrt(largest.lift / trimmed["lift"])
        yield Row(_SPEED_RATIO, ratio, note="V/Vs, stall at this lift")

    # Stall speed at 1 g, as equivalent airspeed if the air is known.
    knots = conversion_factor(airspeed.unit, "kt")
    if weight > 0.0 and knots is not None:
        stall_per_speed = math.sqrt(weight / largest.lift)
        true = airspeed.value * knots * stall_per_speed
        shown, note = true, "Vs, KTAS"
        if not trimmed.lacks(nonzero=_OF_THE_AIR):
            shown = equivalent_airspeed(dynamic_pressure(trimmed)) * stall_per_speed
            note = f"Vs, KEAS; {true:.4g} KTAS"
        yield Row("stall speed at 1 g", shown, "kt", note)


def stall_lines(trimmed: Trimmed) -> list[str]:
    """Return a sentence if the trim is stalled, or none. A trim is stalled if its lift falls with
    alpha, or if its CL exceeds a declared CL_max, beyond which a linear table continues.
    """
    if not trimmed.point.ok or trimmed.airspeed is None:
        return []
    largest = trimmed.largest_lift
    if isinstance(largest, str):
        return []
    force = trimmed["dynamic_pressure"] * trimmed["reference_area"]
    CL, CL_max = trimmed["lift"] / force, largest.lift / force
    if largest.trim_is_beyond and largest.lift > 0.0:
        return [f"STALLED: {_BEYOND_LARGEST_LIFT}, CL {CL_max:.4g} {largest.where}"]
    if CL_max < CL:
        return [f"STALLED: CL {CL:.4g} is above CL_max {CL_max:.4g} of the table"]
    return []


#: Methods of the control gradients.
_METHOD_PER_G = "steady pull-up; lags follow"
_METHOD_PER_KNOT = "trims 0.5 kt slower and faster"
#: Rows that require derivatives.
_ROWS_OF_DERIVATIVES = (
    "static margin",
    "neutral point behind c.g.",
    "control per g",
    "control per knot",
)


def stability_rows(trimmed: Trimmed) -> Iterator[Row | Lacking]:
    """Yield static margin and neutral point, and the control per load factor and per knot."""
    if trimmed.airspeed is None or math.isnan(trimmed.alpha):
        return
    reason = "" if {"speed", "alpha"} <= {*trimmed.roles} else "no states speed and alpha"
    if trimmed.fault:
        reason = "a derivative is not a number"
    if reason:
        yield from (Lacking(name, reason) for name in _ROWS_OF_DERIVATIVES)
        return
    yield from static_margin(trimmed)
    yield from control_gradients(trimmed)


def static_margin(trimmed: Trimmed) -> Iterator[Row | Lacking]:
    """Yield the slopes of lift and pitching moment, the static margin -(∂M/∂α) / (c ∂L/∂α) with the
    other rigid-body states and the inputs fixed while lags follow, and the neutral point, margin
    times chord behind the center of gravity.
    """
    divisors = ("dynamic_pressure", "reference_area", "reference_chord")
    if reason := trimmed.lacks("lift", "pitching_moment", nonzero=divisors):
        yield Lacking("static margin", reason)
        yield Lacking("neutral point behind c.g.", reason)
        return
    chord = trimmed["reference_chord"]
    steady = trimmed.quasi_steady
    place = steady.states.index(trimmed.roles["alpha"])
    lift_slope, moment_slope = (
        float(steady.C[steady.outputs.index(name), place]) for name in ("lift", "pitching_moment")
    )
    force = trimmed["dynamic_pressure"] * trimmed["reference_area"]
    yield Row("CL_alpha", lift_slope / force, "1/rad")
    yield Row("Cm_alpha", moment_slope / (force * chord), "1/rad")
    if lift_slope:
        margin = -moment_slope / (lift_slope * chord)
        yield Row("static margin", margin, "chord")
        yield Row("neutral point behind c.g.", margin * chord, trimmed.unit("reference_chord"))


def control_gradients(trimmed: Trimmed) -> Iterator[Row | Lacking]:
    """Yield the changes of the pitching input per load factor and per knot."""
    pull_up = trimmed.pull_up
    if pull_up is None:
        for name in ("control per g", "CAP", "control per knot"):
            yield Lacking(name, "no input pitches the aircraft without delay")
        return
    unit = trimmed.unit(pull_up.name)
    control = pull_up.name.replace("_", " ")
    if "load_factor" not in trimmed.model.outputs:
        yield Lacking("control per g", "no output load_factor")
        yield Lacking("CAP", "no output load_factor")
    elif pull_up.load_factor:  # not 0, at which no control would be enough
        yield Row(f"{control} per g", 1.0 / pull_up.load_factor, f"{unit}/g", _METHOD_PER_G)
    change = trimmed.change_per_knot(pull_up.name)
    if change is None:
        reason = "no trims 0.5 kt slower and faster that free the control"
        yield Lacking("control per knot", reason)
    else:
        yield Row(f"{control} per knot", change, f"{unit}/kt", _METHOD_PER_KNOT)
