"""Designs in TOML files: those that come with the package, and the user's own."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import fields
from typing import Any

from controller.design.design import Actuator, Design, Feedforward
from hfa_model.vectors import INPUTS
from hfa_support.errors import BadInputError, said_of, shortened, shown
from hfa_support.files import names_of, read_named, table_of

#: Designs that come with the package: name -> file.
NAMED = {
    "paper": "paper.toml",
    "simvfa-1": "simvfa_1.toml",
    "simvfa-2": "simvfa_2.toml",
    "servo": "servo.toml",
}
_KEYS = ("description", "source", "inputs", "integrals", "disturbance", "delta")
_TABLES = ("actuators", "weights", "sensors", "sensor_lags", "feedforward")
_OF_FEEDFORWARD = ("importance", "weights", "rates")


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
    return read_named("design", name, NAMED, "controller.designs", (*_KEYS, *_TABLES))


def design_of(name: str, data: Mapping[str, Any]) -> Design:
    """The design of the entries of a file; BadInputError as `load_design`."""
    weights = table_of(name, data, "weights")
    odd = sorted(set(weights) - {"states", "inputs"})
    if odd:
        raise BadInputError(
            f"{name}: unknown entry weights.{shortened(odd[0])}; give [weights.states] and [weights.inputs]"
        )
    delta = data.get("delta", math.inf)
    if isinstance(delta, bool) or not isinstance(delta, (int, float)) or not delta > 0:
        raise BadInputError(f"{name}: delta is {shown(delta)}; give a positive number, or inf for no disturbance")
    return Design(
        name=name,
        inputs=names_of(name, data, "inputs", INPUTS),
        integrals=names_of(name, data, "integrals"),
        disturbances=_disturbances(name, data),
        delta=float(delta),
        actuators=_actuators(name, "actuators", table_of(name, data, "actuators")),
        state_weights=_numbers(name, weights, "states", "weight"),
        input_weights=_numbers(name, weights, "inputs", "weight"),
        sensors=_numbers(name, data, "sensors", "noise"),
        sensor_lags=_numbers(name, data, "sensor_lags", "lag"),
        feedforward=_feedforward(name, data) if "feedforward" in data else None,
    )


def _disturbances(where: str, data: Mapping[str, Any]) -> dict[str, float]:
    value = data.get("disturbance", "states")
    return _numbers(where, data, "disturbance", "intensity") if isinstance(value, dict) else {str(value): 1.0}


def _feedforward(where: str, data: Mapping[str, Any]) -> Feedforward:
    table = dict(table_of(where, data, "feedforward"))
    made: dict[str, Any] = {
        key: _numbers(where, table, key, f"{key} of the feedforward, that") for key in _OF_FEEDFORWARD if key in table
    }
    if "actuators" in table:
        made["actuators"] = _actuators(where, "feedforward.actuators", table_of(where, table, "actuators"))
    plain = {key: value for key, value in table.items() if key not in made}
    settings = _fields(where, "feedforward", plain, Feedforward)
    with said_of(f"{where}: feedforward"):
        return Feedforward(**settings, **made)


def _actuators(where: str, entry: str, tables: Mapping[str, Any]) -> dict[str, Actuator]:
    made = {}
    for key, table in tables.items():
        place = f"{entry}.{shortened(key)}"
        settings = _fields(where, place, table, Actuator)
        with said_of(f"{where}: {place}"):
            made[key] = Actuator(**settings)
    return made


def _fields(where: str, entry: str, table: Any, kind: type[Actuator | Feedforward]) -> dict[str, Any]:
    """The numbers of a table that makes a value of this kind."""
    known = [each.name for each in fields(kind)]
    if not isinstance(table, dict):
        raise BadInputError(f"{where}: {entry} is {shown(table)}; make it the table [{entry}]")
    for name, value in table.items():
        if name not in known:
            raise BadInputError(f"{where}: unknown entry {entry}.{shortened(name)}; choose from {', '.join(known)}")
        if isinstance(value, bool) or not isinstance(value, (int, float)):
            raise BadInputError(f"{where}: {entry}.{name} is {shown(value)}; give a number")
    return dict(table)


def _numbers(where: str, data: Mapping[str, Any], key: str, what: str) -> dict[str, float]:
    found = {}
    for name, value in table_of(where, data, key).items():
        number = isinstance(value, (int, float)) and not isinstance(value, bool)
        if not (number and 0.0 <= value < 1e100):
            raise BadInputError(
                f"{where}: the {what} of {shortened(name)} is {shown(value)}; give a number that is not negative"
            )
        found[name] = float(value)
    return found
