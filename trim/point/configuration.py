"""What a trim is a trim of: mass, inertias and sizes, atmosphere, condition of the derivatives."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Any

from hfa_aircraft.model import Model, recognized
from hfa_aircraft.rigid.motion import inertia_doubt
from hfa_support.reporting.text import Table, beside_unit, digits, shown_unit, shown_value
from hfa_support.units import conversion, si_factor, si_unit
from trim.point.performance import Quantity

if TYPE_CHECKING:
    from trim.point.operating_point import OperatingPoint

#: Name of an entry -> name on the sheet. Models name signals or `About.configuration` so.
_ENTRIES = {
    "mass": "mass",
    "center_of_gravity": "c.g.",
    "center_of_gravity_x": "c.g. x",
    "center_of_gravity_y": "c.g. y",
    "center_of_gravity_z": "c.g. z",
    "Ixx": "Ixx",
    "Iyy": "Iyy",
    "Izz": "Izz",
    "Ixz": "Ixz",
    "reference_area": "S",
    "reference_span": "b",
    "reference_chord": "c",
    "flap": "flap",
    "gear": "gear",
}
#: Entries that are optional, because 0 or unimportant where they are missing.
_OPTIONAL = ("center_of_gravity_y", "Ixz")
#: Relative difference of equal values.
_SAME = 1e-6
#: Ratio of specific heats and gas constant of air, J/(kg K).
_HEAT_RATIO, _GAS_CONSTANT = 1.4, 287.053


def configuration_of(point: OperatingPoint) -> dict[str, Quantity]:
    """Return name -> mass, center of gravity, inertia or size at a trim, as far as known.

    The values are those of `About.configuration`, or of parameters, outputs and inputs with these
    names. Without a mass, it is the weight divided by the gravity.
    """
    model = point.model
    native = model.native
    declared = native.about.configuration
    found: dict[str, Quantity] = {}
    if declared is not None:
        vectors = ((model.states, point.x), (model.inputs, point.u), (model.parameters, model.p))
        values = [model.native_values(tuple(names), vector) for names, vector in vectors]
        for name, (value, unit) in declared(*values).items():
            in_si = native is not model
            factor = si_factor(unit) if in_si else 1.0
            number = value if isinstance(value, str) else float(value) * factor
            found[name] = Quantity(name, number, si_unit(unit) if in_si else unit)
    parameters = dict(zip(model.parameters, model.p.tolist(), strict=True))
    for name in _ENTRIES:
        if name not in found and name in (*parameters, *model.outputs, *model.inputs):
            value = parameters[name] if name in parameters else point[name]
            found[name] = Quantity(name, value, model.unit(name))
    if "mass" not in found and "weight" in model.outputs and parameters.get("gravity"):
        unit = {"lbf": "slug", "N": "kg"}.get(model.unit("weight"), "")
        if unit:
            found["mass"] = Quantity("mass", point["weight"] / parameters["gravity"], unit)
    return {name: found[name] for name in _ENTRIES if name in found}


def configuration_parts(point: OperatingPoint, found: Mapping[str, Quantity]) -> Iterator[Any]:
    """Yield the table of an aircraft's configuration, and a line with unknown entries."""
    is_aircraft = "alpha" in recognized(point.model.states)
    if not found and not is_aircraft:
        return
    rows = [(_ENTRIES[name], _shown(each), shown_unit(each.unit)) for name, each in found.items()]
    missing = [label for name, label in _ENTRIES.items() if name not in (*found, *_OPTIONAL)]
    if not {*missing}.isdisjoint({"c.g.", "c.g. x", "c.g. z"}):
        has_center = any(name.startswith("center_of_gravity") for name in found)
        others = (label for label in missing if not label.startswith("c.g."))
        missing = [*(["c.g."] * (not has_center)), *others]
    line = f"{', '.join(missing)}: not in this model"
    doubt = _inertia_doubt(point.model, found)
    line = "\n".join([line] * bool(missing) + [doubt] * bool(doubt))
    table = Table(("configuration", "value", "unit"), rows)
    if rows and line:
        yield table, line  # one block
    elif rows:
        yield table
    else:
        yield line


def _shown(quantity: Quantity) -> str:
    """Return a number with six digits, or a word."""
    if isinstance(quantity.value, str):
        return quantity.value
    return shown_value(quantity.value, quantity.unit, ".6g")


def _inertia_doubt(model: Model, found: Mapping[str, Quantity]) -> str:
    """Return a sentence if no rigid body has the inertias and the model does not say so, or ""."""
    if not {"Ixx", "Iyy", "Izz"} <= {*found}:
        return ""
    xx, yy, zz = (found[name].value for name in ("Ixx", "Iyy", "Izz"))
    xz = found["Ixz"].value if "Ixz" in found else 0.0
    doubt = inertia_doubt([[xx, 0.0, -xz], [0.0, yy, 0.0], [-xz, 0.0, zz]])
    return "" if doubt in model.about.doubts else doubt


def atmosphere_of(point: OperatingPoint) -> str:
    """Return a line on the air at a trim, or "" for a model without a speed.

    Density and temperature follow from dynamic pressure, speed and Mach number.
    """
    model = point.model
    name = model.about.atmosphere
    speed = recognized(model.states).get("speed", "")
    if not speed or not {"dynamic_pressure", "mach"} <= {*model.outputs}:
        missing = "atmosphere: not in this model" if speed else ""
        return f"atmosphere: {name}" if name else missing
    to_pascal = conversion(model.unit("dynamic_pressure"), "N/m^2")
    to_speed = conversion(model.unit(speed), "m/s")
    if not (name and to_pascal and to_speed and point["mach"] and point[speed]):
        return f"atmosphere: {name}" if name else ""
    velocity = point[speed] * to_speed
    density = 2.0 * point["dynamic_pressure"] * to_pascal / velocity**2
    temperature = (velocity / point["mach"]) ** 2 / (_HEAT_RATIO * _GAS_CONSTANT)
    unit = "kg/m^3" if model.unit(speed) == "m/s" else "slug/ft^3"
    in_unit = density * (conversion("kg/m^3", unit) or 1.0)
    return f"atmosphere: {name}; {in_unit:.4g} {unit}, {temperature:.4g} K"


def reference_of(point: OperatingPoint) -> dict[str, dict[str, Any]]:
    """Return name -> value at the trim, value of the model's derivatives, and their difference."""
    compared = {}
    for name, value in point.model.domain.reference.items():
        here = point[name]
        difference = here - value if math.isfinite(value) else math.nan
        compared[name] = {"value": here, "reference": value, "difference": difference}
    return compared


def reference_line(point: OperatingPoint, compared: Mapping[str, Mapping[str, Any]]) -> str:
    """Return a line on the distance from the condition of the derivatives: "alpha 2.8 deg, 0.1
    above the table's".
    """
    words, same = [], []
    for name, entry in compared.items():
        unit = point.model.unit(name)
        here, apart = (
            float(shown_value(entry[key], unit, ".12g")) for key in ("value", "difference")
        )
        if abs(apart) <= _SAME * max(abs(here), 1.0):
            same.append(name)
            continue
        shown = beside_unit(digits(here, 4), unit)
        side = "above" if apart > 0.0 else "below"
        words.append(f"{name} {shown}, {digits(abs(apart), 4)} {side} the table's")
    if same:
        words.append(f"{', '.join(same)} as in the table")
    return f"condition of the derivatives: {'; '.join(words)}" if words else ""
