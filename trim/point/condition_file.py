"""Reading of trim conditions from files."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from hfa_aircraft.model import Model
from hfa_support.errors import BadInputError, prefix_errors, shown
from hfa_support.files import NUMBER, checked, read_named
from hfa_support.matrices import LinearTable
from trim.point.condition import TrimCondition, release

#: Entries of a condition file, with their types.
_FILE = {
    "description": str,
    "source": str,
    "impose": {str: None},
    "free": [str],
    "limits": {str: [NUMBER]},
}


def read_condition(name: str, usual: TrimCondition, shipped: Mapping[str, Path]) -> TrimCondition:
    """Return the trim condition in a file of changes to the default condition.

    name: path of the user's file, or name of a file in the package
    usual: the default condition
    shipped: name -> file of the package, for the conditions of the paper's aircraft

    The table [impose] has entries variable = value, or variable = [[breakpoint, value], ...]. An
    angle is in degrees if its name has the suffix _deg (alpha_deg), otherwise in rad. `free` is a
    list of variables. The table [limits] has entries variable = [lowest, highest], also with _deg.

    Raises BadInputError, which names the file, the entry and the fault, if the file is not a valid
    condition.
    """
    data = read_named("condition", name, shipped, _FILE)
    model = usual.model
    hold: dict[str, Any] = {}
    for key, value in data.get("impose", {}).items():
        variable, factor = _variable(model, name, key)
        if isinstance(value, list):
            hold[variable] = _table(model, name, key, value, factor)
        else:
            hold[variable] = checked(name, value, NUMBER, key) * factor
    limits: dict[str, Any] = {}
    for key, ends in data.get("limits", {}).items():
        variable, factor = _variable(model, name, key, also=model.states)
        limits[variable] = tuple(end * factor for end in ends)
    free = tuple(_variable(model, name, key).name for key in data.get("free", []))
    with prefix_errors(name):
        return replace(release(usual, free=free, hold=hold, limits=limits), name=name)


class _Variable(NamedTuple):
    """Variable that a key of a condition file names, and the factor from the file to its unit."""

    name: str
    factor: float


def _variable(model: Model, file: str, key: str, also: Collection[str] = ()) -> _Variable:
    """Return the variable that a key such as "speed" or "alpha_deg" names.

    also: names that are permitted in addition to those of the variables

    Raises BadInputError for an unknown name, and for "_deg" after one that is no angle.
    """
    name = key.removesuffix("_deg")
    model.refuse_unheld(f"{file}: unknown trim variable", name, tuple(also))
    if name == key:
        return _Variable(name, model.native_factor(name))
    if not model.unit(name).startswith("rad"):
        raise BadInputError(f"{file}: {key} is not an angle; write {name}, in {model.unit(name)}")
    return _Variable(name, math.pi / 180.0)


def _table(model: Model, file: str, key: str, value: Any, factor: float) -> LinearTable:
    """Return the rows [breakpoint, value] of a key as a table over the scheduling variable.

    value: the rows, with breakpoints in degrees if the scheduling variable is an angle
    factor: factor from the unit of the file to that of the variable

    Raises BadInputError if `value` does not consist of such rows.
    """
    rows = checked(file, value, [[NUMBER]], key)
    if not rows or any(len(row) != 2 for row in rows):
        raise BadInputError(f"{file}: {key} is {shown(value)}; give [{model.schedule}, value] rows")
    breakpoints, values = np.array(rows).T
    if model.schedule and model.unit(model.schedule).startswith("rad"):
        breakpoints = np.radians(breakpoints)
    with prefix_errors(f"{file}: {key}"):
        return LinearTable(breakpoints, values * factor)
