"""Designs in TOML files: those that come with the package, and the user's own."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import fields
from typing import Any

from controller.design.design import Actuator, Design, Feedforward
from hfa_model.vectors import INPUTS
from hfa_support.errors import said_of, shortened
from hfa_support.schema import NUMBER, Number, checked, read_named

#: Designs that come with the package: name -> file.
NAMED = {
    "paper": "paper.toml",
    "simvfa-1": "simvfa_1.toml",
    "simvfa-2": "simvfa_2.toml",
    "servo": "servo.toml",
}
_WEIGHTS = {str: Number(0.0, 1e100)}
_ACTUATORS = {str: {each.name: NUMBER for each in fields(Actuator)}}
_FEEDFORWARD = {each.name: NUMBER for each in fields(Feedforward)} | {
    "actuators": _ACTUATORS,
    **dict.fromkeys(("importance", "weights", "rates"), _WEIGHTS),
}
_FILE = {
    "description": str,
    "source": str,
    "inputs": [str],
    "integrals": [str],
    "disturbance": None,
    "delta": Number(0.0, above=True, infinite=True),
    "actuators": _ACTUATORS,
    "weights": {"states": _WEIGHTS, "inputs": _WEIGHTS},
    "sensors": _WEIGHTS,
    "sensor_lags": _WEIGHTS,
    "feedforward": _FEEDFORWARD,
}


def load_design(name: str) -> Design:
    """A design that comes with the package, by its name in `NAMED`, or one of the user's, by its file.

    inputs, integrals: lists of names. disturbance: where it enters, "states", "updraft" or "commands", or the table
    [disturbance] of several with their intensities. delta: a number, inf for none. [actuators.INPUT]: order, bandwidth
    (rad/s), damping, effectiveness. [weights.states], [weights.inputs]: name = weight. [sensors]: output or state =
    intensity of its noise, [sensor_lags]: its lag in s. [feedforward]: lag (s), stages, bandwidth (rad/s) and damping
    of the command filter, [feedforward.actuators.NAME] as above, [feedforward.importance]: NAME = number,
    [feedforward.weights], [feedforward.rates]: output = number.
    BadInputError names the file, the entry and what is wrong with it.
    """
    return design_of(name, read_design(name))


def read_design(name: str) -> dict[str, Any]:
    """The entries of a design file as they stand there."""
    return dict(read_named("design", name, NAMED, "controller.designs", _FILE))


def design_of(name: str, data: Mapping[str, Any]) -> Design:
    """The design of the entries of a file; BadInputError as `load_design`."""
    data = checked(name, data, _FILE)
    entering = data.get("disturbance", "states")
    several = entering if isinstance(entering, dict) else {checked(name, entering, str, "disturbance"): 1.0}
    weights = data.get("weights", {})
    return Design(
        name=name,
        inputs=tuple(data.get("inputs", INPUTS)),
        integrals=tuple(data.get("integrals", ())),
        disturbances=checked(name, several, _WEIGHTS, "disturbance"),
        delta=data.get("delta", math.inf),
        actuators=_actuators(name, "actuators", data.get("actuators", {})),
        state_weights=weights.get("states", {}),
        input_weights=weights.get("inputs", {}),
        sensors=data.get("sensors", {}),
        sensor_lags=data.get("sensor_lags", {}),
        feedforward=_feedforward(name, data["feedforward"]) if "feedforward" in data else None,
    )


def _feedforward(where: str, table: dict[str, Any]) -> Feedforward:
    actuators = _actuators(where, "feedforward.actuators", table.get("actuators", {}))
    with said_of(f"{where}: feedforward"):
        return Feedforward(**_whole(table) | ({"actuators": actuators} if actuators else {}))


def _actuators(where: str, entry: str, tables: Mapping[str, Any]) -> dict[str, Actuator]:
    made = {}
    for key, table in tables.items():
        with said_of(f"{where}: {entry}.{shortened(key)}"):
            made[key] = Actuator(**_whole(table))
    return made


def _whole(table: dict[str, Any]) -> dict[str, Any]:
    """Counts, as integers where they are whole."""
    counts = {key: int(table[key]) for key in ("order", "stages") if key in table and table[key] == int(table[key])}
    return table | counts
