"""The data and the records of a report in SI units, number by number with its unit.

The units of an array are the lists beside or above it in the data (`state_units`, `input_units`).
That of a number is `unit` beside it, an entry of the table of units of its table
(`performance_units` of `performance`), or what the model declares for its name."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from hfa_aircraft.model import Model
from hfa_support.reporting.report import Report
from hfa_support.reporting.text import RowsMade, Table
from hfa_support.reporting.unit_system import entries_in_force, in_force, unit_in_force

#: Arrays -> the units of their last axes: the kind, of its list of units, and - where an entry is
#: per that unit.
_AXES = {
    "A A_band A_difference": "state -state",
    "B B_band B_difference": "state -input",
    "C": "output -state",
    "D": "output -input",
    "E": "state -disturbance",
    "F": "output -disturbance",
    "P P_exact P_lower P_upper": "-state -state",
    "K K_exact gains": "input -state",
    "W weights": "weight",
    "disturbance_gain": "-state",  # of a disturbance in the rates as the game has them, in feet
    "half_widths state_offsets": "state",
    "input_offsets": "input",
    "output_offsets": "output",
    "values": "variable",
    "operating_states initial": "all_states",
    "operating_inputs": "all_inputs",
}
#: The same of a controller, whose data has `signal_units`: x' = A x + B y + W u, u = C x + D y.
_OF_CONTROLLER = {
    "B": "state -signal",
    "C": "input -state",
    "D": "input -signal",
    "W": "state -input",
}
#: Tables of rates, and of values, by the names of the model's signals.
_RATES = ("residuals", "rates")
_VALUES = (
    *(
        "margins",
        "imposed",
        "limits",
        "envelope",
        "final",
        "largest_deviation",
        "rms_error",
        "peak_error",
    ),
    *("peak_deviation", "largest_difference_from_linear", "effort", "scheduled"),
)
#: What a flight meets: arrays of the states of the linear model, or of their rates.
_SHAPES = ("constant", "slope", "sine", "cosine")
#: Columns of records whose unit stands in the column "unit".
_IN_UNIT = ("value", "band", "learned", "exact", "printed", "computed")
#: Tables that state their own units: of what was typed, and of what is compared with the print.
_AS_THEY_ARE = ("provenance", "regeneration")
#: In a table with one unit beside its numbers, what is not in it.
_APART = ("time", "sign", "zeros", "poles", "frequency")


def in_si(report: Report, model: Model) -> Report:
    """Data and records in SI units, which must be in force. model: whose names the data has."""
    return replace(
        report, data=_table(report.data, _declared(model)), records=_records(report.records)
    )


def _declared(model: Model) -> dict[str, Any]:
    """Key of data -> the units of what is in it: one, those of the last axis, or a table of these
    by name."""
    linear, rates = (
        model.units(model.linear),
        {name: model.rate_unit(name) for name in model.states},
    )
    signals = {name: signal.unit for name, signal in model.signals.items()}
    states, inputs = model.units(tuple(model.states)), model.units(tuple(model.inputs))
    air = signals.get("updraft", "1")
    length, speed = (
        dict.fromkeys(("length", "scale"), air.removesuffix("/s")),
        ("peak", "intensity", "speed"),
    )
    return {
        **{"all_states_units": states, "all_inputs_units": inputs},
        **dict.fromkeys(_RATES, rates),
        **dict.fromkeys(_VALUES, signals),
        **dict.fromkeys(("reference", "noise"), dict.fromkeys(_SHAPES, linear)),
        "disturbance": dict.fromkeys(_SHAPES, tuple(rates[name] for name in model.linear)),
        "gust": {**length, **dict.fromkeys(speed, air)},
        "actuators": dict.fromkeys(("lowest", "highest", "rate"), inputs),
        "history": {"states": states, "inputs": inputs, "updrafts": air, "errors": linear},
    }


def _table(data: Mapping[str, Any], above: Mapping[str, Any]) -> dict[str, Any]:
    """above: the units that are declared, and the lists of units of the tables that this one is
    in."""
    known = {**above, **{key: each for key, each in data.items() if _is_units(key, each)}}
    return {key: _entry(key, value, data, known) for key, value in data.items()}


def _entry(key: str, value: Any, data: Mapping[str, Any], known: Mapping[str, Any]) -> Any:
    if key in _AS_THEY_ARE:
        return value
    if _is_units(key, value):
        return _unit_names(value)
    if "unit" in data and _is_numbers(value):
        return value if key in _APART else _scaled(value, data["unit"])
    axes = [
        (known.get(f"{kind}_units", ()), power)
        for kind, power in _axes(key, "signal_units" in known)
    ]
    if axes and value is not None and all(len(units) for units, _ in axes):
        found = entries_in_force(np.array(value, dtype=float), *axes)
        return found if isinstance(value, np.ndarray) else found.tolist()
    units = data.get(f"{key.removesuffix('s')}_units", known.get(key))
    if isinstance(units, str):
        return _scaled(value, units)
    if not _is_table(value):
        return value
    if isinstance(units, Mapping):
        return _by_name(value, units)
    return (
        _table(value, known)
        if isinstance(value, Mapping)
        else [_table(each, known) for each in value]
    )


def _axes(key: str, of_controller: bool) -> list[tuple[str, int]]:
    """The kinds of the last axes of an array, with their powers; none of what is no array."""
    said = next((axes for names, axes in _AXES.items() if key in names.split()), "")
    words = _OF_CONTROLLER.get(key, said) if of_controller else said
    return [(each.strip("-"), -1 if each.startswith("-") else 1) for each in words.split()]


def _by_name(values: Any, units: Mapping[str, Any]) -> Any:
    """A table of numbers, arrays, rows (place, number) of a condition, and tables of these; or a
    list of tables."""
    if not isinstance(values, Mapping):
        return [_by_name(each, units) for each in values]
    found: dict[str, Any] = {}
    for name, value in values.items():
        unit = units.get(name, "1")
        if _is_table(value):
            found[name] = _by_name(value, units)
        elif (
            isinstance(unit, str)
            and isinstance(value, list)
            and value
            and isinstance(value[0], list)
        ):
            found[name] = [[place, _scaled(each, unit)] for place, each in value]
        else:
            found[name] = _scaled(value, unit)
    return found


def _scaled(value: Any, unit: Any) -> Any:
    """A number, an array, or lists of them, in one unit or with those of the last axis; other
    values unchanged."""
    if not isinstance(unit, str):
        return entries_in_force(np.asarray(value, dtype=float), (unit, 1))
    if isinstance(value, (list, tuple)):
        return [_scaled(each, unit) for each in value]
    return in_force(value, unit) if isinstance(value, np.ndarray) or _is_numbers(value) else value


def _unit_names(units: Any) -> Any:
    if isinstance(units, Mapping):
        return dict(zip(units, map(_unit_names, units.values()), strict=True))
    return unit_in_force(units) if isinstance(units, str) else [*map(_unit_names, units)]


def _is_units(key: str, value: Any) -> bool:
    """Whether this is a unit, or a list or a table of units."""
    return (key == "unit" or key.endswith("_units")) and not _is_numbers(value)


def _is_table(value: Any) -> bool:
    """Whether it is a table, or a list of tables."""
    rows = isinstance(value, (list, tuple)) and len(value) > 0
    return isinstance(value[0] if rows else value, Mapping)


def _is_numbers(value: Any) -> bool:
    if isinstance(value, (list, tuple)):
        return all(map(_is_numbers, value))
    return isinstance(value, (int, float)) and not isinstance(value, bool)


def _records(table: Table) -> Table:
    """Converts columns with their unit in brackets, and the columns `_IN_UNIT` of rows that have a
    column "unit"."""
    in_brackets = [name.partition(" [")[2].removesuffix("]") for name in table.header]
    pairs = zip(table.header, in_brackets, strict=True)
    header = tuple(name.replace(f"[{unit}]", f"[{unit_in_force(unit)}]") for name, unit in pairs)

    place = table.header.index("unit") if "unit" in table.header else None

    def row(index: int) -> tuple[Any, ...]:
        cells = list(table.rows[index])
        own = "" if place is None else cells[place]
        for i, (name, unit) in enumerate(zip(table.header, in_brackets, strict=True)):
            if unit := unit or own * (name in _IN_UNIT):
                cells[i] = _scaled(cells[i], unit)
        if place is not None:
            cells[place] = unit_in_force(own)
        return tuple(cells)

    return Table(header, RowsMade(len(table.rows), row))
