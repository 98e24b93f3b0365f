"""Named flight conditions: what a trim imposes, frees and limits, in a TOML file."""

from __future__ import annotations

import math
from itertools import pairwise
from typing import Any

from hfa_model.support.echo import shown
from hfa_model.support.errors import BadInputError
from hfa_model.support.toml_file import finite_number, names_of, read_named, table_of
from hfa_model.vectors import UNITS
from trim.point.condition import VARIABLES
from trim.point.named_condition import NamedCondition

#: Conditions that come with the package: name -> file.
NAMED = {"paper": "paper.toml", "simvfa-64": "simvfa_64.toml", "simvfa-30": "simvfa_30.toml"}
_KEYS = ("description", "source", "impose", "free", "limits")


def load_condition(name: str) -> NamedCondition:
    """A condition that comes with the package, by its name in `NAMED`, or one of the user's, by its file.

    [impose]: variable = value, or variable = [[dihedral, value], ...]; angles in degrees under the variable's name
    with _deg behind it (alpha_deg), in rad without. free: list of variables. [limits]: variable = [lowest, highest],
    likewise. BadInputError names the file, the entry and what is wrong with it.
    """
    data = read_named("condition", name, NAMED, "trim.conditions", _KEYS)
    return NamedCondition(
        name=name,
        imposed=dict(_imposed(name, key, value) for key, value in table_of(name, data, "impose").items()),
        free=tuple(_variable(name, key)[0] for key in names_of(name, data, "free")),
        limits=dict(_limits(name, key, value) for key, value in table_of(name, data, "limits").items()),
    )


def _variable(where: str, key: str, also: tuple[str, ...] = ()) -> tuple[str, float]:
    """The variable that a key names, and the factor from its unit."""
    name = key.removesuffix("_deg")
    if name not in (*VARIABLES, *also):
        raise BadInputError(
            f"{where}: unknown trim variable {shown(key)}; choose from {', '.join((*VARIABLES, *also))}"
        )
    if name == key:
        return name, 1.0
    if not UNITS[name].startswith("rad"):
        raise BadInputError(f"{where}: {key} is no angle; write {name}, in {UNITS[name]}")
    return name, math.pi / 180.0


def _imposed(where: str, key: str, value: Any) -> tuple[str, tuple[tuple[float, ...], tuple[float, ...]]]:
    name, factor = _variable(where, key)
    if not isinstance(value, list):
        return name, ((), (finite_number(where, key, value) * factor,))
    rows = [row if isinstance(row, list) and len(row) == 2 else None for row in value]
    if len(rows) < 2 or None in rows:
        raise BadInputError(f"{where}: {key} is {shown(value)}; give a number or at least two [dihedral, value] rows")
    angles = tuple(finite_number(where, key, row[0]) * math.pi / 180.0 for row in rows if row)
    if any(later <= earlier for earlier, later in pairwise(angles)):
        raise BadInputError(f"{where}: the dihedral angles of {key} do not increase; sort its rows")
    return name, (angles, tuple(finite_number(where, key, row[1]) * factor for row in rows if row))


def _limits(where: str, key: str, value: Any) -> tuple[str, tuple[float, float]]:
    name, factor = _variable(where, key, ("pitch",))
    if not isinstance(value, list) or len(value) != 2:
        raise BadInputError(f"{where}: the limits of {key} are {shown(value)}; give [lowest, highest]")
    lowest, highest = (finite_number(where, key, each) * factor for each in value)
    return name, (lowest, highest)
