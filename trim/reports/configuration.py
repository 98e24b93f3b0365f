"""What a trim is a trim of: mass, inertias, sizes, flap and gear."""

from __future__ import annotations

import math
from collections.abc import Collection
from typing import Any, NamedTuple

from hfa_aircraft.model import Model
from hfa_aircraft.rigid.aircraft import inertia_doubt
from hfa_support.reporting.rows import Lacking, Row
from hfa_support.reporting.text import digits, shown_value
from hfa_support.units import si_factor, si_unit
from trim.reports.trimmed import Trimmed

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
#: Parameter of a table -> its entry, where that has another name.
_ENTRY_OF_PARAMETER = {"cg": "center_of_gravity"}
PARAMETER_OF_ENTRY = {entry: name for name, entry in _ENTRY_OF_PARAMETER.items()}
#: Entries that are optional, because 0 or unimportant where they are missing.
_OPTIONAL = ("center_of_gravity_y", "Ixz")


class Quantity(NamedTuple):
    """Number with its unit, or a word, such as that on a gear, with the unit "".

    value: a number, or a word
    unit: unit of the number
    """

    value: Any
    unit: str


def configuration_of(trimmed: Trimmed) -> dict[str, Quantity]:
    """Return mass, center of gravity, inertias and sizes at a trim as far as known, by name, in the
    units of the condition.

    The values are those of `About.configuration`, or of parameters, outputs and inputs with these
    names. Without a mass, it is the weight divided by the gravity.
    """
    point = trimmed.point
    model = point.model
    native = model.native
    configuration: dict[str, Quantity] = {}
    in_si = native is not model
    if native.about.configuration is not None:
        vectors = ((model.states, point.x), (model.inputs, point.u), (model.parameters, model.p))
        native_vectors = [model.native_values(tuple(names), vector) for names, vector in vectors]
        for name, (value, unit) in native.about.configuration(*native_vectors).items():
            factor = si_factor(unit) if in_si else 1.0
            number = value if isinstance(value, str) else float(value) * factor
            configuration[name] = Quantity(number, si_unit(unit) if in_si else unit)
    parameters = dict(zip(model.parameters, model.p.tolist(), strict=True))
    for name in _ENTRIES:
        if name not in configuration and name in (*parameters, *model.outputs, *model.inputs):
            value = parameters[name] if name in parameters else point[name]
            configuration[name] = Quantity(value, model.unit(name))
    if "mass" not in configuration and "weight" in model.outputs and parameters.get("gravity"):
        unit = {"lbf": "slug", "N": "kg"}.get(model.unit("weight"), "")
        if unit:
            configuration["mass"] = Quantity(point["weight"] / parameters["gravity"], unit)
    return configuration


def configuration_rows(trimmed: Trimmed) -> list[Row | Lacking]:
    """Return the rows of the configuration at a trim, with what is unknown of an aircraft.

    Parameters that are not as the model was loaded follow.
    """
    model = trimmed.point.model
    entries = configuration_of(trimmed)
    labels = {name: label for name, label in _ENTRIES.items() if name in entries}
    notes = {name: _lever_angle(model, name, entry.value) for name, entry in entries.items()}
    for parameter, loaded in model.changed.items():
        name = _ENTRY_OF_PARAMETER.get(parameter, parameter)
        value, unit = model.parameters[parameter].start, model.unit(parameter)
        texts = (_lever_angle(model, parameter, value), f"as loaded: {shown_value(loaded, unit)}")
        notes[name] = ", ".join(filter(None, texts))
        if name not in entries:
            entries[name] = Quantity(value, unit)
            labels[name] = parameter
    rows: list[Row | Lacking] = [
        Row(label, *entries[name], notes.get(name, ""), digits=6) for name, label in labels.items()
    ]
    for name, label in labels.items():
        full = model.signals[name].full if name in model.signals else 0.0
        if full:  # the angle of a lever, whose value is a share
            rows.append(
                Row(f"{label} angle", entries[name].value * math.radians(full), "rad", rare=True)
            )
    if entries.keys() & _ENTRIES.keys() or "alpha" in trimmed.roles:
        rows += [Lacking(label, "") for label in _missing_labels(entries)]
    return rows


def _missing_labels(entries: Collection[str]) -> list[str]:
    """Return the labels of the entries that are unknown; "c.g." if its position is."""
    missing = [label for name, label in _ENTRIES.items() if name not in (*entries, *_OPTIONAL)]
    labels = [label for label in missing if not label.startswith("c.g.")]
    has_center = any(name.startswith("center_of_gravity") for name in entries)
    return labels if has_center else ["c.g.", *labels]


def configuration_lines(trimmed: Trimmed) -> list[str]:
    """Return a sentence on inertias that no rigid body has, unless the first lines contain it."""
    doubt = inertias_doubt(trimmed)
    is_in_first_lines = doubt in trimmed.model.doubts or holds_inertias(trimmed)
    return [doubt] if doubt and not is_in_first_lines else []


def _lever_angle(model: Model, name: str, value: Any) -> str:
    """Return the angle of what a lever moves as text: "15 of 40 deg", or "" if the signal is none.

    value: share of the travel of the lever
    """
    signal = model.signals.get(name)
    if signal is None or not signal.full:
        return ""
    return f"{digits(value * signal.full)} of {digits(signal.full)} deg"


def holds_inertias(trimmed: Trimmed) -> bool:
    """Return whether the inertias are parameters, which `--hold` sets."""
    return {"Ixx", "Iyy", "Izz"} <= {*trimmed.model.parameters}


def inertias_doubt(trimmed: Trimmed) -> str:
    """Return a sentence if no rigid body has the inertias, or ""."""
    configuration = configuration_of(trimmed)
    if not {"Ixx", "Iyy", "Izz"} <= {*configuration}:
        return ""
    xx, yy, zz = (configuration[name].value for name in ("Ixx", "Iyy", "Izz"))
    xz = configuration["Ixz"].value if "Ixz" in configuration else 0.0
    return inertia_doubt([[xx, 0.0, -xz], [0.0, yy, 0.0], [-xz, 0.0, zz]])
