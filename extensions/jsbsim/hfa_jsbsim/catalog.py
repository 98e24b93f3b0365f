"""Catalog of JSBSim's built-in properties, from `properties.json`.

`python -m hfa_jsbsim.catalog` of commit 3367509be wrote this file from the package jsbsim. It lists
the properties of small test aircraft with engines of all kinds, whose files define no properties. A
property of some engines has their kinds and thrusters after its access rights. That the cut-off of
all engines stops those with a turbine alone was found by flights of JSBSim.
"""

from __future__ import annotations

import json
import re
from collections.abc import Sequence
from functools import lru_cache
from pathlib import Path
from typing import Any

DATA = Path(__file__).with_name("properties.json")
#: Number of an engine, tank or wheel in a name.
_NUMBER = re.compile(r"\[\d+\]")
_OF_ENGINE = re.compile(r"propulsion/engine(?:\[(\d+)\])?/")
#: Suffixes of names that JSBSim defines for components: failures, and whether a limit is reached.
_OF_COMPONENTS = (
    *("/malfunction/fail_zero", "/malfunction/fail_hardover", "/malfunction/fail_stuck"),
    *("/malfunction/fail_low", "/malfunction/fail_high", "/saturated"),
    "/initial-integrator-value",
)


@lru_cache
def _properties() -> dict[str, str]:
    """Return name of a built-in property -> its access rights and the kinds of its engines."""
    data: dict[str, Any] = json.loads(DATA.read_text())
    return data["properties"]


def access(name: str, engines: Sequence[tuple[str, str]]) -> str:
    """Return the access rights "R", "RW" or "W" of a built-in JSBSim property, "" for other names
    and for properties that the engine with this number does not have.

    engines: kind and thruster of each engine
    """
    if of_component(name):
        return "RW"
    # Such as "RW piston_engine propeller"; without kinds, all engines have the property.
    rights, *kinds = _properties().get(without_numbers(name), "").split() or [""]
    if engine := _OF_ENGINE.match(name):
        number = int(engine[1] or 0)
        engines = engines[number : number + 1]
    elif not kinds:
        return rights
    has_it = any(not kinds or not {*kinds}.isdisjoint(each) for each in engines)
    return rights if has_it else ""


def of_component(name: str) -> bool:
    """Return whether a property has a name that JSBSim gives to values of a control component."""
    return name.endswith(_OF_COMPONENTS)


def without_numbers(name: str) -> str:
    """Return the name of a property without the numbers of engines, tanks and wheels."""
    return _NUMBER.sub("", name)
