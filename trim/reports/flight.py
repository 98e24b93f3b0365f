"""The flight at a trim: airspeeds, air, load factor, and distance from the data of the aircraft."""

from __future__ import annotations

import math
from collections.abc import Iterator

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
from trim.point.operating_point import is_in_range
from trim.point.status import BALANCE
from trim.reports.trimmed import Trimmed

#: Outputs of the flight: relative to the ground, which are read first in a steady wind, and to the
#: air. They are not repeated among the loads.
_OVER_GROUND = ("ground_speed", "track")
_OF_AIR = ("mach", "dynamic_pressure", "load_factor")
OUTPUTS = (*_OVER_GROUND, *_OF_AIR)


def flight_rows(trimmed: Trimmed) -> Iterator[Row | Lacking]:
    """Yield the rows of the flight: airspeeds, air, load factor, unbalanced rates, distances from
    the condition of the derivatives, and ranges in which the model is valid.
    """
    if "speed" in trimmed.roles:
        yield from airspeed_rows(trimmed)
        parameters = trimmed.model.parameters.items()
        in_wind = any(name.startswith("wind_") and each.start for name, each in parameters)
        yield from output_rows(trimmed, _OVER_GROUND, rare=not in_wind)
        yield from output_rows(trimmed, _OF_AIR)
        yield from air_rows(trimmed)
    elif trimmed.model.about.atmosphere:
        yield Row("atmosphere", trimmed.model.about.atmosphere)
    yield from unbalanced_rates(trimmed)
    yield from distances_from_the_table(trimmed)
    yield from validity_rows(trimmed)


def output_rows(trimmed: Trimmed, names: tuple[str, ...], rare: bool = False) -> Iterator[Row]:
    """Yield a row for each of the named outputs that the model has, in its units."""
    given = trimmed.point.model
    for name in names:
        if name in given.outputs:
            value = without_rounding(trimmed.point[name], given.signal(name).nominal)
            yield Row(name.replace("_", " "), value, given.unit(name), rare=rare)


def airspeed_rows(trimmed: Trimmed) -> Iterator[Row | Lacking]:
    """Yield the true, the calibrated and the equivalent airspeed, kt, or what is missing for the
    last two. A speed without a known unit has no row of the true airspeed.
    """
    speed = trimmed.roles["speed"]
    knots = conversion_factor(trimmed.unit(speed), "kt")
    if knots is not None:
        yield Row("true airspeed", trimmed[speed] * knots, "kt", "KTAS")
    pressure = dynamic_pressure(trimmed)
    if isinstance(pressure, str):
        yield Lacking("calibrated airspeed", pressure)
        yield Lacking("equivalent airspeed", pressure)
        return
    yield Row("calibrated airspeed", calibrated_airspeed(pressure, trimmed["mach"]), "kt", "KCAS")
    yield Row("equivalent airspeed", equivalent_airspeed(pressure), "kt", "KEAS")


def dynamic_pressure(trimmed: Trimmed) -> float | str:
    """Return the dynamic pressure, N/m², or what is missing for it or for the Mach number."""
    names = ("dynamic_pressure", "mach")
    if reason := trimmed.lacks(*names) or trimmed.zero(*names):
        return reason
    unit = trimmed.unit("dynamic_pressure")
    factor = conversion_factor(unit, "N/m^2")
    if factor is None:
        return f"no unit of pressure in {unit}"
    return trimmed["dynamic_pressure"] * factor


def air_rows(trimmed: Trimmed) -> Iterator[Row | Lacking]:
    """Yield density and temperature, which follow from dynamic pressure, speed and Mach number, or
    else the name of the atmosphere.
    """
    atmosphere = trimmed.model.about.atmosphere
    if not atmosphere:
        yield Lacking("atmosphere", "")
        return
    speed = trimmed.roles["speed"]
    unit = trimmed.unit(speed)
    to_metres = conversion_factor(unit, "m/s")
    pressure = dynamic_pressure(trimmed)
    if isinstance(pressure, str) or to_metres is None or not trimmed[speed]:
        yield Row("atmosphere", atmosphere)
        return
    velocity = trimmed[speed] * to_metres
    density = 2.0 * pressure / velocity**2  # kg/m³
    if unit == "m/s":
        yield Row("density", density, "kg/m^3", atmosphere)
    else:
        slugs_per_foot3 = density * (conversion_factor("kg/m^3", "slug/ft^3") or 1.0)
        yield Row("density", slugs_per_foot3, "slug/ft^3", atmosphere)
    temperature = (velocity / trimmed["mach"]) ** 2 / (HEAT_RATIO * GAS_CONSTANT)
    yield Row("temperature", temperature, "K")


def unbalanced_rates(trimmed: Trimmed) -> Iterator[Row]:
    """Yield the rates that the condition does not balance and that are not 0."""
    model = trimmed.point.model
    balanced = trimmed.point.trim_problem.asked.rates
    for name, rate in trimmed.rates.items():
        if name not in balanced and abs(rate) > BALANCE * model.rate_scale(name):
            yield Row(f"{name}_dot", rate, model.rate_unit(name), "not balanced")


def distances_from_the_table(trimmed: Trimmed) -> Iterator[Row]:
    """Yield the difference of each value from that for which a table's derivatives are."""
    model = trimmed.point.model
    for name, stated in model.domain.reference.items():
        unit = model.unit(name)
        text = digits_with_unit(stated, unit, 4) if math.isfinite(stated) else "unknown"
        difference = trimmed.point[name] - stated
        is_same = _is_as_in_the_table(trimmed, name)
        yield Row(f"{name} from the table's", difference, unit, f"table: {text}", rare=is_same)


def same_as_the_table(trimmed: Trimmed) -> list[str]:
    """Return a list with a sentence on the values that are those of a table's derivatives."""
    reference = trimmed.point.model.domain.reference
    same = [name for name in reference if _is_as_in_the_table(trimmed, name)]
    return [f"condition of the derivatives: {', '.join(same)} as in the table"] if same else []


def _is_as_in_the_table(trimmed: Trimmed, name: str) -> bool:
    """Return whether a value is that of a table's derivatives, up to `NEAR`."""
    model = trimmed.point.model
    stated = model.domain.reference[name]
    difference = abs(trimmed.point[name] - stated)
    return difference <= NEAR * (model.signal(name).nominal + abs(stated))


def validity_rows(trimmed: Trimmed) -> Iterator[Row]:
    """Yield for each range of validity whether the trim is in it."""
    model = trimmed.point.model
    for name, (lowest, highest, source) in model.domain.range.items():
        unit = model.unit(name)
        ends = " to ".join(shown_value(end, unit, ".5g") for end in (lowest, highest))
        is_inside = is_in_range(model, name, trimmed.point[name])
        yield Row(
            f"{name} in its range",
            "inside" if is_inside else "OUTSIDE",
            note=f"{beside_unit(ends, unit)}, {source}",
            tone="" if is_inside else "bad",
        )
