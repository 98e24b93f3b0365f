"""Mass, inertias and sizes of an aircraft, and warnings that they raise about a trim."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from functools import lru_cache
from typing import Any

from hfa_aircraft.control_systems import is_linear_plant
from hfa_aircraft.model import Model
from hfa_aircraft.rigid.aircraft import inertia_warning
from hfa_support.matrices import ROUNDING
from hfa_support.reporting.rows import Lacking, Row
from hfa_support.reporting.text import digits, shown_value
from hfa_support.units import conversion_factor
from trim.reports.balances import balances_of
from trim.reports.trimmed import (
    ENTRIES,
    PARAMETER_OF_ENTRY,
    Trimmed,
    named_value_text,
    value_text,
)

#: Parameter -> its entry, where that has another name.
_ENTRY_OF_PARAMETER = {name: entry for entry, name in PARAMETER_OF_ENTRY.items()}
#: Entries that are optional, because 0 or unimportant where they are missing.
_OPTIONAL_ENTRIES = ("center_of_gravity_y", "Ixz")


def configuration_rows(trimmed: Trimmed) -> list[Row | Lacking]:
    """Return the rows of the configuration at a trim, the angles of its levers, and the entries of
    an aircraft that are unknown.
    """
    known = _known_rows(trimmed)
    rows: list[Row | Lacking] = [*known.values()]
    if "alpha" in trimmed.roles or not known.keys().isdisjoint(ENTRIES):  # an aircraft
        # One coordinate is enough: the others may be 0, as the lateral one of most aircraft.
        if not any(name.startswith("center_of_gravity") for name in known):
            rows.append(Lacking("c.g.", ""))
        for name, label in ENTRIES.items():
            if name not in (*known, *_OPTIONAL_ENTRIES) and not label.startswith("c.g."):
                rows.append(Lacking(label, ""))
    return rows


def _known_rows(trimmed: Trimmed) -> dict[str, Row]:
    """Return entry or parameter -> row: the known entries of the configuration, and the parameters
    that are not as the model was loaded.
    """
    model, entries = trimmed.point.model, trimmed.configuration
    rows = {}
    for name, label in ENTRIES.items():
        if name in entries:
            value, unit = entries[name]
            rows[name] = Row(label, value, unit, _lever_angle(model, name, value), digits=6)
    for parameter, loaded in model.changed.items():
        name = _ENTRY_OF_PARAMETER.get(parameter, parameter)
        value, unit = model.parameters[parameter].start, model.unit(parameter)
        texts = (_lever_angle(model, parameter, value), f"as loaded: {shown_value(loaded, unit)}")
        row = rows.get(name) or Row(parameter, value, unit, digits=6)
        rows[name] = replace(row, note=", ".join(filter(None, texts)))
    return rows


def inertia_lines(trimmed: Trimmed) -> list[str]:
    """Return a sentence if no rigid body has the inertias of the configuration, or []."""
    entries = trimmed.configuration
    if not {"Ixx", "Iyy", "Izz"} <= {*entries}:
        return []
    xx, yy, zz = (entries[name].value for name in ("Ixx", "Iyy", "Izz"))
    xz = entries["Ixz"].value if "Ixz" in entries else 0.0
    line = inertia_warning([[xx, 0.0, -xz], [0.0, yy, 0.0], [-xz, 0.0, zz]])
    return [line] if line else []


def _lever_angle(model: Model, name: str, value: Any) -> str:
    """Return the angle of a lever, such as that of flaps, as "15 of 40 deg", or "" for another
    signal.
    """
    signal = model.signals.get(name)
    if signal is None or not signal.full:  # angle at the value 1
        return ""
    return f"{digits(value * signal.full)} of {digits(signal.full)} deg"


#: Wings begin to stall at lift coefficients above this.
_STALLING_CL = 0.7
#: Entries with the sizes of a wing.
_SIZES = ("reference_area", "reference_chord", "reference_span")
#: Largest usual angle of attack, deg.
_LARGEST_ALPHA = 60.0
#: An aircraft with a smaller speed, as a share of the nominal speed, stands.
_STANDING_SHARE = 1e-2
#: Largest change of the speed, as a share, for which derivatives by the speed are valid.
_VALID_SPEED_CHANGE = 0.1


@lru_cache(maxsize=4)
def warnings_of(trimmed: Trimmed) -> tuple[str, ...]:
    """Return sentences on data and on values of the trim that are probably wrong."""
    said = [*trimmed.point.model.warnings, *_warnings_at(trimmed)]
    # The model has warnings on inertias as loaded, which `--hold` may have changed.
    if "Ixx" in trimmed.model.parameters:
        said += inertia_lines(trimmed)
    return tuple(dict.fromkeys(said))


def _warnings_at(trimmed: Trimmed) -> Iterator[str]:
    """Yield sentences on values that wrong units or signs of data cause."""
    point, model, roles = trimmed.point, trimmed.point.model, trimmed.roles
    if "alpha" in roles and abs(math.degrees(trimmed[roles["alpha"]])) > _LARGEST_ALPHA:
        cure = "hold a speed"
        if model.about.equations == "derivatives":
            cure = "the data may have degrees without a unit"
        yield f"{named_value_text(point, roles['alpha'])}: hardly a flight; {cure}"
    speed = roles.get("speed", "")
    is_aircraft = ("alpha" in roles or "lift" in model.outputs) and not is_linear_plant(model)
    if is_aircraft and speed and abs(point[speed]) < _STANDING_SHARE * model.states[speed].nominal:
        yield f"the speed is {value_text(model, speed, point[speed])}, no flight; hold a speed"
    if {"drag", "lift"} <= {*model.outputs}:
        drag, lift = trimmed["drag"], trimmed["lift"]
        if drag < -ROUNDING * abs(lift):  # the drag is a component of the force that has the lift
            yield f"the drag is {value_text(model, 'drag', drag)}, below 0; check signs and units"
    for name, signal in model.inputs.items() if trimmed.airspeed is not None else ():
        is_force = conversion_factor(signal.unit, "N") is not None
        if is_force and signal.min == -math.inf and point[name] < 0.0:
            force = value_text(model, name, point[name])
            yield f"{name} is {force}, below 0, and has no lower limit; --limit {name}=0:MAX"
    domain = model.domain
    if domain.by_speed and speed in domain.reference:  # derivatives by the speed of a linear table
        stated = domain.reference[speed]
        if abs(point[speed] - stated) > _VALID_SPEED_CHANGE * stated:
            yield (
                f"{', '.join(domain.by_speed)} are for {value_text(model, speed, stated)}, "
                f"{100.0 * abs(point[speed] / stated - 1.0):.0f} % off: forces and thrust are "
                "uncertain here"
            )
    if point.ok and is_aircraft and not trimmed.fault:
        yield from _unusual(trimmed)
    yield from balances_of(trimmed).sentences


def _unusual(trimmed: Trimmed) -> Iterator[str]:
    """Yield a sentence for each figure that no aircraft has, as a wrong unit or sign of data gives;
    the ranges are wide.
    """
    known, roles = trimmed.quantities, trimmed.roles
    area, chord, span, pressure, lift = (
        known[name].value if name in known else math.nan
        for name in (
            "reference_area",
            "reference_chord",
            "reference_span",
            "dynamic_pressure",
            "lift",
        )
    )

    def slope(name: str, role: str) -> float:
        """Return the derivative of a quantity by a state; nan if one of them is unknown."""
        if name not in known or role not in roles:
            return math.nan
        return float(known[name].slopes[trimmed.model.state_places([roles[role]])[0]])

    figures = {
        "S / c^2": (area / (chord or math.nan) ** 2, 0.1, 60.0),
        "S / (b c)": (area / (chord * span or math.nan), 0.3, 2.5),
    }
    force = pressure * area or math.nan
    lift_slope = slope("lift", "alpha") / force
    # A stall reduces any CL_alpha to about 0 or less, which the first lines state.
    if lift_slope > 1.0 or (lift_slope > 0.0 and lift / force < _STALLING_CL):
        figures["CL_alpha"] = (lift_slope, 0.8, 15.0)
    for name, (value, least, most) in figures.items():
        if value < least or value > most:  # nan, of an unknown figure, is neither
            yield f"{name} is {value:.3g}, of aircraft {least:g} to {most:g}; check units"
    if "beta" in roles and slope("p_dot", "p") > 0.0:
        yield "a roll rate increases itself (Cl_p above 0); check its sign"
    # Without angular rates, the yawing moment N = Izz dr/dt - Ixz dp/dt. An unknown Ixz is 0.
    yawing, rolling = slope("r_dot", "beta"), 0.0
    if {"p_dot", "Izz", "Ixz"} <= {*known}:
        rolling = known["Ixz"].value / known["Izz"].value * slope("p_dot", "beta")
    if "speed" in roles and yawing - rolling < -ROUNDING * (abs(yawing) + abs(rolling)):
        yield "sideslip turns the nose out of the wind (body-axis Cn_beta below 0); check it"
