"""The data and the records of a report in the units that are asked for, number by number with its unit."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from hfa_model.aircraft import HFA
from hfa_support.model import Model
from hfa_support.reporting.report import Report
from hfa_support.reporting.text import RowsMade, Table
from hfa_support.reporting.unit_system import entries_in_force, in_force, system_in_force, unit_in_force

#: Array -> its last axes: the list of units beside it (or these units), and the power of the unit in an entry.
_STATE, _INPUT, _OUTPUT, _GUST = "state_units", "input_units", "output_units", "disturbance_units"
_SENSOR, _SIGNAL = "sensor_units", "signal_units"
_Axes = tuple[tuple[str | tuple[str, ...], int], ...]
_ARRAYS: dict[str, _Axes] = {
    **dict.fromkeys(("A", "A_band", "A_difference"), ((_STATE, 1), (_STATE, -1))),
    **dict.fromkeys(("B", "B_band", "B_difference"), ((_STATE, 1), (_INPUT, -1))),
    "C": ((_OUTPUT, 1), (_STATE, -1)),
    "D": ((_OUTPUT, 1), (_INPUT, -1)),
    "E": ((_STATE, 1), (_GUST, -1)),
    "F": ((_OUTPUT, 1), (_GUST, -1)),
    "P": ((_STATE, -1), (_STATE, -1)),
    "disturbance_gain": ((_STATE, -1),),  # of a disturbance in the rates as the game has them, in feet
    **dict.fromkeys(("P_exact", "P_lower", "P_upper"), ((_STATE, -1), (_STATE, -1))),
    **dict.fromkeys(("K", "K_exact", "gains"), ((_INPUT, 1), (_STATE, -1))),
    **dict.fromkeys(("W", "weights"), (("weight_units", 1),)),
    "half_widths": ((_STATE, 1),),
    "X": ((_STATE, -1), (_STATE, -1)),
    "Y": ((_STATE, 1), (_STATE, 1)),
    "Ak": ((_STATE, 1), (_STATE, -1)),
    "Bk": ((_STATE, 1), (_SENSOR, -1)),
    "Ck": ((_INPUT, 1), (_STATE, -1)),
    "noise": ((_SENSOR, 2),),
    "state_offsets": ((_STATE, 1),),
    "input_offsets": ((_INPUT, 1),),
    "output_offsets": ((_OUTPUT, 1),),
    **dict.fromkeys(("operating_states", "initial"), (("all_state_units", 1),)),
    "operating_inputs": (("all_input_units", 1),),
    "values": (("variable_units", 1),),
}
#: The same of a controller, whose table has `signal_units`: x' = A x + B y + W u, u = C x + D y.
_CONTROLLER: dict[str, _Axes] = {
    **_ARRAYS,
    "B": ((_STATE, 1), (_SIGNAL, -1)),
    "C": ((_INPUT, 1), (_STATE, -1)),
    "D": ((_INPUT, 1), (_SIGNAL, -1)),
    "W": ((_STATE, 1), (_INPUT, -1)),
}
#: Columns of records whose unit stands in the column "unit".
_IN_UNIT = ("value", "band", "learned", "exact", "printed", "computed")
_MOMENTS = ("pitching_moment", "hinge_moment", "center_moment", "outer_moment")
#: Tables that state their own units: of what was typed, and of what is compared with the print.
_AS_THEY_ARE = ("provenance", "regeneration")
#: In a table with one unit beside its numbers, what is not in it.
_APART = ("time", "sign", "zeros", "poles", "frequency")
#: Name in `known` of `_by_name_of` a model.
_NAMED = "named"


def _by_name_of(model: Model) -> dict[str, Mapping[str, str | tuple[str, ...]]]:
    """Table of numbers by name -> their units, and of arrays those of the last axis, where none stand beside them; so
    for the tables within it."""
    signals = {name: each.unit for name, each in model.signals.items()}
    rates = {name: model.rate_unit(name) for name in model.states}
    of_signal = ("constant", "slope", "sine", "cosine")
    air = signals.get("updraft", "1")
    length = dict.fromkeys(("length", "scale"), air.removesuffix("/s"))
    inputs = model.units(tuple(model.inputs))
    states: str | tuple[str, ...] = model.units(tuple(model.states))
    history = {"states": states, "inputs": inputs, "updrafts": air}
    return {
        **dict.fromkeys(("residuals", "rates"), rates),
        **dict.fromkeys(("margins", "imposed", "limits", "envelope", "final", "largest_deviation"), signals),
        **dict.fromkeys(("rms_error", "peak_error", "peak_deviation", "effort", "scheduled"), signals),
        "largest_difference_from_linear": signals,
        **dict.fromkeys(("reference", "noise"), dict.fromkeys(of_signal, model.units(model.linear))),
        "disturbance": dict.fromkeys(of_signal, tuple(rates[name] for name in model.linear)),
        "gust": {**length, **dict.fromkeys(("peak", "intensity", "speed"), air)},
        "actuators": dict.fromkeys(("lowest", "highest", "rate"), inputs),
        "history": {**history, "errors": model.units(model.linear)},
    }


def in_units_in_force(report: Report, model: Model = HFA) -> Report:
    """Data with `units`, and records, in the system that `shown_in` says. model: whose names are in them."""
    data = {**report.data, "units": system_in_force()}
    if system_in_force() == "english":
        return replace(report, data=data)
    whole = {f"all_{kind}_units": model.units(tuple(getattr(model, f"{kind}s"))) for kind in ("state", "input")}
    known = {_NAMED: _by_name_of(model), **whole}
    return replace(report, data=_tree(data, known), records=_records(report.records))


def _tree(data: Mapping[str, Any], above: Mapping[str, Any]) -> dict[str, Any]:
    """above: the lists of units of the tables that this one is in."""
    known = {
        **above,
        **{key: value for key, value in data.items() if key.endswith("_units") and not _is_numbers(value)},
    }
    if _SENSOR in data:
        known[_OUTPUT] = data[_SENSOR]
    return {key: _entry(key, value, data, known) for key, value in data.items()}


def _entry(key: str, value: Any, data: Mapping[str, Any], known: Mapping[str, Any]) -> Any:
    if key in _AS_THEY_ARE:
        return value
    if (key == "unit" or key.endswith("_units")) and not _is_numbers(value):
        return _names(value)
    if "unit" in data and _is_numbers(value):
        return value if key in _APART else _scaled(value, data["unit"])
    arrays = _CONTROLLER if _SIGNAL in known else _ARRAYS
    axes = [(known.get(units, ()) if isinstance(units, str) else units, power) for units, power in arrays.get(key, ())]
    if axes and value is not None and all(len(units) for units, _ in axes):
        found = entries_in_force(np.array(value, dtype=float), *axes)
        return found if isinstance(value, np.ndarray) else found.tolist()
    one = data.get(f"{key.removesuffix('s')}_units", known[_NAMED].get(key))
    if isinstance(one, str):
        return _scaled(value, one)
    if key == "loads":
        one = {name: "ft lbf" if name in _MOMENTS else "lbf" for name in value}
    if isinstance(value, Mapping):
        return _tree(value, known) if one is None else _by_name(value, one)
    if isinstance(value, list) and value and isinstance(value[0], Mapping):
        return [_tree(each, known) if one is None else _by_name(each, one) for each in value]
    return value


def _by_name(values: Mapping[str, Any], units: Mapping[str, str | tuple[str, ...]]) -> dict[str, Any]:
    """A table of numbers, of arrays, of rows (dihedral, number) of a condition; and the tables within it."""
    found: dict[str, Any] = {}
    for name, value in values.items():
        unit = units.get(name, "1")
        if isinstance(value, Mapping):
            found[name] = _by_name(value, units)
        elif isinstance(value, (list, tuple)) and value and isinstance(value[0], Mapping):
            found[name] = [_by_name(each, units) for each in value]
        elif isinstance(unit, tuple):
            found[name] = entries_in_force(np.asarray(value, dtype=float), (unit, 1))
        elif isinstance(value, list) and value and isinstance(value[0], list):
            found[name] = [[angle, _scaled(each, unit)] for angle, each in value]
        else:
            found[name] = _scaled(value, unit)
    return found


def _names(units: Any) -> Any:
    if isinstance(units, str):
        return unit_in_force(units)
    if isinstance(units, Mapping):
        return {name: unit_in_force(unit) for name, unit in units.items()}
    return [unit_in_force(unit) for unit in units]


def _is_numbers(value: Any) -> bool:
    if isinstance(value, (list, tuple)):
        return all(map(_is_numbers, value))
    return isinstance(value, (int, float)) and not isinstance(value, bool)


def _scaled(value: Any, unit: str) -> Any:
    """A number, an array, or lists of them; other values are returned unchanged."""
    if isinstance(value, np.ndarray):
        return in_force(value, unit)
    if isinstance(value, (list, tuple)):
        return [_scaled(each, unit) for each in value]
    return in_force(value, unit) if _is_numbers(value) else value


def _records(table: Table) -> Table:
    """Converts columns with their unit in brackets, and the columns `_IN_UNIT` of rows that have a column "unit"."""
    in_brackets = [name.partition(" [")[2].removesuffix("]") for name in table.header]
    pairs = zip(table.header, in_brackets, strict=True)
    header = tuple(name.replace(f"[{unit}]", f"[{unit_in_force(unit)}]") for name, unit in pairs)
    place = table.header.index("unit") if "unit" in table.header else None

    def row(index: int) -> tuple[Any, ...]:
        cells = table.rows[index]
        units = in_brackets
        if place is not None:
            units = [cells[place] if name in _IN_UNIT else "" for name in table.header]
        found = [_scaled(cell, unit) if unit else cell for cell, unit in zip(cells, units, strict=True)]
        if place is not None:
            found[place] = unit_in_force(cells[place])
        return tuple(found)

    return Table(header, RowsMade(len(table.rows), row))
