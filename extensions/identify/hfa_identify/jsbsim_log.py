"""Columns of a CSV log of JSBSim: labels with units in parentheses, and names of properties."""

from __future__ import annotations

import re
from collections.abc import Sequence

from hfa_aircraft.model import Model
from hfa_support.units import conversion

#: Label of the time, the first column of a log.
TIME = "Time"
#: Label of a log without its unit -> name in models.
_LABELS = {
    TIME: "time",
    "Aileron Command": "aileron",
    "Elevator Command": "elevator",
    "Rudder Command": "rudder",
    "Flap Command": "flap",
    "Elevator Position": "elevator",
    "Rudder Position": "rudder",
    "Flap Position": "flap",
    "P": "roll_rate",
    "Q": "pitch_rate",
    "R": "yaw_rate",
    "V_{Total}": "speed",
    "Alpha": "alpha",
    "Beta": "beta",
    "Phi": "roll",
    "Theta": "pitch",
    "Psi": "yaw",
    "Altitude ASL": "altitude",
    "q bar": "dynamic_pressure",
}
_PROPERTIES = "/fdm/jsbsim/"
#: Unit in a label, or at the end of a property's name -> unit.
_UNITS = {"norm": "1", "psf": "lbf/ft^2", "kts": "kt", "fps": "ft/s", "lbs": "lbf"}


def log_columns(labels: Sequence[str], model: Model) -> list[tuple[str, float] | None]:
    """Return (name in the model, factor to its unit) of each column, None for one that is left out.

    Columns that the model lacks, or has in another kind of unit (a command in place of an angle),
    are left out, and so are further columns of one name.

    labels: first row of the log
    """
    known = {*model.inputs, *model.states, *model.outputs}
    found: set[str] = set()
    columns: list[tuple[str, float] | None] = []
    for label in labels:
        name, unit = _name_and_unit(label.strip(), model)
        factor = 1.0 if name == "time" else None
        if name in known:
            factor = conversion(_UNITS.get(unit, unit), model.unit(name)) if unit else 1.0
        columns.append((name, factor) if factor is not None and name not in found else None)
        found |= {name} if factor is not None else set()
    return columns


def _name_and_unit(label: str, model: Model) -> tuple[str, str]:
    """Return the name in the model that a label stands for, or "", and its unit, "" without one."""
    if label.startswith(_PROPERTIES):
        path = label.removeprefix(_PROPERTIES)
        unit = re.sub(r"\[\d+\]$", "", path).rpartition("-")[2]
        return model.about.aliases.get(path, ""), unit
    match = re.fullmatch(r"(.*?)(?:\s*\(([^()]*)\))?", label)
    words, unit = (match[1], match[2] or "") if match else (label, "")
    return _LABELS.get(words, model.about.aliases.get(words, "")), unit
