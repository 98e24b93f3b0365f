"""A flight condition from a file: what a trim or a sweep imposes, leaves free and limits, in place of the paper's."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np

from hfa_support.errors import BadInputError, shown
from hfa_support.linear_table import LinearTable
from hfa_support.model import Model
from hfa_support.schema import NUMBER, checked, read_named
from trim.point.condition import LEVEL_FLIGHT, TrimCondition, release

#: Conditions that come with the package: name -> file.
NAMED = {"paper": "paper.toml", "simvfa-64": "simvfa_64.toml", "simvfa-30": "simvfa_30.toml"}
_FILE = {"description": str, "source": str, "impose": {str: None}, "free": [str], "limits": {str: [NUMBER]}}


def load_condition(name: str, usual: TrimCondition = LEVEL_FLIGHT) -> TrimCondition:
    """A condition that comes with the package, by its name in `NAMED`, or one of the user's, by its file; it changes
    the usual one.

    [impose]: variable = value, or variable = [[dihedral, value], ...]; angles in degrees under the variable's name
    with _deg behind it (alpha_deg), in rad without. free: list of variables. [limits]: variable = [lowest, highest],
    likewise. BadInputError names the file, the entry and the fault.
    """
    data = read_named("condition", name, NAMED, "trim.conditions", _FILE)
    model = usual.model
    held = dict(_imposed(name, model, key, value) for key, value in data.get("impose", {}).items())
    free = tuple(_variable(name, model, key)[0] for key in data.get("free", []))
    limits = dict(_limits(name, model, key, value) for key, value in data.get("limits", {}).items())
    return replace(release(usual, free=free, hold=held, limits=limits), name=name)


def _variable(where: str, model: Model, key: str, also: Iterable[str] = ()) -> tuple[str, float]:
    """The variable that a key names, and the factor from its unit."""
    name = key.removesuffix("_deg")
    model.refuse_unheld(f"{where}: unknown trim variable", name, tuple(also))
    if name == key:
        return name, 1.0
    if not model.unit(name).startswith("rad"):
        raise BadInputError(f"{where}: {key} is no angle; write {name}, in {model.unit(name)}")
    return name, math.pi / 180.0


def _imposed(where: str, model: Model, key: str, value: Any) -> tuple[str, float | LinearTable]:
    name, factor = _variable(where, model, key)
    if not isinstance(value, list):
        return name, checked(where, value, NUMBER, key) * factor
    if len(value) < 2 or not all(isinstance(row, list) and len(row) == 2 for row in value):
        raise BadInputError(
            f"{where}: {key} is {shown(value)}; give a number or at least two [{model.schedule}, value] rows"
        )
    angles, values = zip(*checked(where, value, [[NUMBER]], key), strict=True)
    by = model.schedule
    if any(later <= earlier for earlier, later in pairwise(angles)):
        raise BadInputError(f"{where}: the {by} values of {key} do not increase; sort its rows")
    places = np.radians(angles) if by and model.unit(by).startswith("rad") else np.array(angles)
    return name, LinearTable(places, np.array(values) * factor)


def _limits(where: str, model: Model, key: str, value: Any) -> tuple[str, tuple[float, float]]:
    name, factor = _variable(where, model, key, model.states)
    if not isinstance(value, list) or len(value) != 2:
        raise BadInputError(f"{where}: the limits of {key} are {shown(value)}; give [lowest, highest]")
    lowest, highest = (each * factor for each in value)
    return name, (lowest, highest)
