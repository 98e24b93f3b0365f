"""The data and the records of a report in the units that are asked for, number by number with its unit."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from hfa_model.reporting.report import Report
from hfa_model.reporting.text import RowsMade, Table
from hfa_model.reporting.unit_system import entries_in_force, in_force, system_in_force, unit_in_force
from hfa_model.vectors import INPUT_UNITS, RATE_UNITS, STATE_UNITS, UNITS

#: Array -> its last axes: the list of units beside it (or these units), and the power of the unit in an entry.
_STATE, _INPUT, _OUTPUT, _GUST = "state_units", "input_units", "output_units", "disturbance_units"
_ARRAYS: dict[str, tuple[tuple[str | tuple[str, ...], int], ...]] = {
    **dict.fromkeys(("A", "A_band"), ((_STATE, 1), (_STATE, -1))),
    **dict.fromkeys(("B", "B_band"), ((_STATE, 1), (_INPUT, -1))),
    "C": ((_OUTPUT, 1), (_STATE, -1)),
    "D": ((_OUTPUT, 1), (_INPUT, -1)),
    "E": ((_STATE, 1), (_GUST, -1)),
    "F": ((_OUTPUT, 1), (_GUST, -1)),
    "P": ((_STATE, -1), (_STATE, -1)),
    "disturbance_gain": ((_STATE, -1),),  # of a disturbance in the rates as the game has them, in feet
    "K": ((_INPUT, 1), (_STATE, -1)),
    "state_offsets": ((_STATE, 1),),
    "input_offsets": ((_INPUT, 1),),
    "output_offsets": ((_OUTPUT, 1),),
    "operating_states": ((tuple(STATE_UNITS), 1),),
    "operating_inputs": ((tuple(INPUT_UNITS), 1),),
    "values": (("variable_units", 1),),
}
_RATES = RATE_UNITS._asdict()
_MOMENTS = ("pitching_moment", "hinge_moment", "center_moment", "outer_moment")
#: Table of numbers by name -> their units, where no table of units stands beside it.
_BY_NAME: dict[str, Mapping[str, str]] = {
    "residuals": _RATES,
    "rates": _RATES,
    "margins": UNITS,
    "imposed": UNITS,
    "limits": UNITS,
}


def in_units_in_force(report: Report) -> Report:
    """Data with `units`, and records, in the system that `shown_in` says."""
    data = {**report.data, "units": system_in_force()}
    if system_in_force() == "english":
        return replace(report, data=data)
    return replace(report, data=_tree(data, {}), records=_records(report.records))


def _tree(data: Mapping[str, Any], above: Mapping[str, Any]) -> dict[str, Any]:
    """above: the lists of units of the tables that this one is in."""
    known = {
        **above,
        **{key: value for key, value in data.items() if key.endswith("_units") and not _is_numbers(value)},
    }
    return {key: _entry(key, value, data, known) for key, value in data.items()}


def _entry(key: str, value: Any, data: Mapping[str, Any], known: Mapping[str, Any]) -> Any:
    if key == "provenance":
        return value
    if (key == "unit" or key.endswith("_units")) and not _is_numbers(value):
        return _names(value)
    if "unit" in data and _is_numbers(value):
        return _scaled(value, data["unit"])
    axes = [(known.get(units, ()) if isinstance(units, str) else units, power) for units, power in _ARRAYS.get(key, ())]
    if axes and all(len(units) for units, _ in axes):
        found = entries_in_force(np.array(value, dtype=float), *axes)
        return found if isinstance(value, np.ndarray) else found.tolist()
    one = data.get(f"{key.removesuffix('s')}_units", _BY_NAME.get(key))
    if key == "loads":
        one = {name: "ft lbf" if name in _MOMENTS else "lbf" for name in value}
    if isinstance(value, Mapping):
        return _tree(value, known) if one is None else _by_name(value, one)
    if isinstance(value, list) and value and isinstance(value[0], Mapping):
        return [_tree(each, known) if one is None else _by_name(each, one) for each in value]
    return value


def _by_name(values: Mapping[str, Any], units: Mapping[str, str]) -> dict[str, Any]:
    """A table of numbers, or of rows (dihedral, number) of a condition."""
    found = {}
    for name, value in values.items():
        unit = units.get(name, "1")
        if isinstance(value, list) and value and isinstance(value[0], list):
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
    """A number or lists of them; what is none stays."""
    if isinstance(value, (list, tuple)):
        return [_scaled(each, unit) for each in value]
    return in_force(value, unit) if _is_numbers(value) else value


def _records(table: Table) -> Table:
    """Columns with their unit in brackets, and rows with a column "unit" for what stands under value and band."""
    in_brackets = [name.partition(" [")[2].removesuffix("]") for name in table.header]
    pairs = zip(table.header, in_brackets, strict=True)
    header = tuple(name.replace(f"[{unit}]", f"[{unit_in_force(unit)}]") for name, unit in pairs)
    place = table.header.index("unit") if "unit" in table.header else None

    def row(index: int) -> tuple[Any, ...]:
        cells = table.rows[index]
        units = in_brackets
        if place is not None:
            units = [cells[place] if name in ("value", "band") else "" for name in table.header]
        found = [_scaled(cell, unit) for cell, unit in zip(cells, units, strict=True)]
        if place is not None:
            found[place] = unit_in_force(cells[place])
        return tuple(found)

    return Table(header, RowsMade(len(table.rows), row))
