"""The file that says what a search over a design may change, what it simulates and what it must keep."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from controller.design.design import Actuator
from controller.design.design_file import design_of, read_design
from hfa_model.variants import VARIANTS
from hfa_support.errors import BadInputError, refuse_unknown, said_of, shown
from hfa_support.files import finite_number, names_of, read_toml, table_of, write_text
from verification.synthesis.tuning import InCommands, InGust, InTurbulence, Tuning, Variable

_SETTINGS = ("design", "evaluations", "seed", "angles", "abscissa", "rate", "margin", "fastest", "dynamics", "power")
_KEYS = (*_SETTINGS, "variables", "objective", "cases", "turbulence", "gusts")
_ACTUATOR = ("order", "bandwidth", "damping", "effectiveness")
_CASE = ("dihedral", *_ACTUATOR, "each", "ends")
_TURBULENCE = ("dihedral", *_ACTUATOR, "intensity", "scale", "objective")
_GUST = ("dihedral", *_ACTUATOR, "length", "peak", "dynamics")
#: Evaluations of a file that does not say how many.
_EVALUATIONS = 1000
_LARGEST = 10**18


def load_tuning(path: str) -> Tuning:
    """Read a tuning file. design: name or file of the design that the search starts from. evaluations, seed: whole.

    angles: deg, where the corners are closed, dynamics: of which aircraft (that of the search). abscissa: largest
    allowed there, 1/s, below 0. rate: largest allowed rate of an input, deg/s. [variables.NAME]: entries (of the design
    file), low, high. [objective]: output = cost of an rms error of 1 in its unit, power: p of their norm (1, the sum).
    [[cases]]: dihedral (deg), order, bandwidth, damping, effectiveness, each (s, time of a step), [cases.ends]: output
    = list of commands (angles in deg). margin: smallest allowed disk margin, fastest: largest pole of a loop, 1/s.
    [[turbulence]]: dihedral and actuator as above, intensity (ft/s), scale (ft), [turbulence.objective]: state = cost
    of an rms of 1. [[gusts]]: the same, length (ft), peak (ft/s, negative downward) to be stood, dynamics.
    BadInputError names the entry that is wrong.
    """
    try:
        data = read_toml(path)
    except OSError as error:
        raise BadInputError(f"{path}: there is no readable file of that name") from error
    _known(path, "a tuning", data, _KEYS)
    if not isinstance(data.get("design"), str):
        raise BadInputError(f"{path}: design is missing; name the design that the search starts from")
    start = read_design(data["design"])
    design = design_of(data["design"], start)
    objective = _objective(path, "", "integral", data, design.integrals)
    cases = data.get("cases")
    if not isinstance(cases, list) or not cases:
        raise BadInputError(f"{path}: there are no [[cases]]; give at least one")
    abscissa = _number(path, data, "abscissa", -1e-3)
    if not abscissa < 0.0:
        raise BadInputError(f"{path}: abscissa is {abscissa:g}; it must be below 0")
    found = Tuning(
        name=path,
        start=start,
        variables=tuple(_variable(path, name, table) for name, table in _some(path, data, "variables")),
        cases=tuple(_case(path, number, table, design.integrals) for number, table in enumerate(cases, 1)),
        objective=objective,
        angles=tuple(math.radians(finite_number(path, "angles", angle)) for angle in data.get("angles", [])),
        abscissa=abscissa,
        rate=math.radians(_number(path, data, "rate", math.inf, positive=True)),
        evaluations=_whole(path, data, "evaluations", 1, _EVALUATIONS),
        seed=_whole(path, data, "seed", 0, 0),
        turbulence=tuple(_turbulence(path, *each, design.plant_states) for each in _list(path, data, "turbulence")),
        gusts=tuple(_gust(path, *each) for each in _list(path, data, "gusts")),
        margin=_number(path, data, "margin", 0.0, positive="margin" in data),
        fastest=_number(path, data, "fastest", math.inf, positive=True),
        dynamics=names_of(path, data, "dynamics"),
        power=_number(path, data, "power", 1.0),
    )
    if not found.power >= 1.0:
        raise BadInputError(f"{path}: power is {found.power:g}; it must be at least 1")
    for name in found.dynamics:
        refuse_unknown(f"{path}: unknown dynamics", name, VARIANTS)
    if not found.angles:
        raise BadInputError(f"{path}: angles is empty; name at least one angle where the corners are closed")
    design_of(path, found.entries_at(found.first_values()))
    return found


def save_design(path: Path, entries: Mapping[str, Any]) -> None:
    """Write the entries of a design as a design file, whole or not at all."""
    write_text(path, "\n".join(_toml(entries, ())) + "\n")


def _toml(table: Mapping[str, Any], path: tuple[str, ...]) -> list[str]:
    lines = [f"{name} = {_value(value)}" for name, value in table.items() if not isinstance(value, Mapping)]
    if path and lines:
        lines.insert(0, f"\n[{'.'.join(path)}]")
    for name, value in table.items():
        if isinstance(value, Mapping):
            lines += _toml(value, (*path, name))
    return lines


def _value(value: Any) -> str:
    if isinstance(value, list):
        return f"[{', '.join(map(_value, value))}]"
    if isinstance(value, str):
        escaped = value.replace("\\", "\\\\").replace('"', '\\"')
        return f'"{escaped}"'
    return str(value).lower() if isinstance(value, bool) else repr(value)


def _variable(where: str, name: str, table: Any) -> Variable:
    _known(where, f"variables.{name}", table, ("entries", "low", "high"))
    entries = names_of(where, table, "entries")
    low, high = (_number(where, table, key, math.nan, positive=True) for key in ("low", "high"))
    if not entries or not low < high:
        raise BadInputError(f"{where}: variables.{name}: give entries, and low below high")
    return Variable(name, entries, low, high)


def _case(where: str, number: int, table: Any, outputs: tuple[str, ...]) -> InCommands:
    name = f"cases {number}"
    _known(where, name, table, _CASE)
    ends = table_of(where, table, "ends")
    if set(ends) != set(outputs) or not all(isinstance(each, list) for each in ends.values()):
        raise BadInputError(f"{where}: {name}: give [cases.ends] with a list for each of {', '.join(outputs)}")
    steps = [[_internal(finite_number(where, name, value), key) for value in ends[key]] for key in outputs]
    if len({len(each) for each in steps}) != 1 or not steps[0]:
        raise BadInputError(f"{where}: {name}: the lists of ends differ in length; give as many steps to each")
    each = _number(where, table, "each", 70.0, positive=True)
    return InCommands(*_place(where, name, table), each, np.array(steps).T)


def _turbulence(where: str, name: str, table: Any, states: tuple[str, ...]) -> InTurbulence:
    _known(where, name, table, _TURBULENCE)
    objective = _objective(where, f"{name}: ", "state of the plant", table, states)
    intensity = _number(where, table, "intensity", 3.0, positive=True)
    scale = _number(where, table, "scale", 1750.0, positive=True)
    return InTurbulence(*_place(where, name, table), intensity, scale, objective)


def _objective(where: str, name: str, kind: str, table: Mapping[str, Any], known: tuple[str, ...]) -> dict[str, float]:
    """What an rms of 1 costs; none makes the cost smaller."""
    found = {}
    for key, size in _some(where, table, "objective"):
        refuse_unknown(f"{where}: {name}objective: unknown {kind}", key, known)
        found[key] = finite_number(where, f"{name}objective.{key}", size)
        if found[key] < 0.0:
            raise BadInputError(f"{where}: {name}objective.{key} is {size:g}; it must not be negative")
    return found


def _gust(where: str, name: str, table: Any) -> InGust:
    _known(where, name, table, _GUST)
    length = _number(where, table, "length", math.nan, positive=True)
    dynamics = table.get("dynamics", "")
    if "dynamics" in table:
        refuse_unknown(f"{where}: {name}: unknown dynamics", dynamics, VARIANTS)
    return InGust(
        *_place(where, name, table), length, finite_number(where, f"{name}.peak", table.get("peak")), dynamics
    )


def _place(where: str, name: str, table: Mapping[str, Any]) -> tuple[float, Actuator]:
    """Angle, rad, and actuator of a case."""
    settings = {key: table[key] for key in _ACTUATOR if key in table}
    for key, value in settings.items():
        finite_number(where, f"{name}.{key}", value)
    with said_of(f"{where}: {name}"):
        actuator = Actuator(**settings)
    return math.radians(finite_number(where, f"{name}.dihedral", table.get("dihedral"))), actuator


def _list(where: str, data: Mapping[str, Any], key: str) -> list[tuple[str, Any]]:
    """The tables [[key]], each with its name for messages."""
    tables = data.get(key, [])
    if not isinstance(tables, list):
        raise BadInputError(f"{where}: {key} is no list of tables; write [[{key}]]")
    return [(f"{key} {number}", table) for number, table in enumerate(tables, 1)]


def _number(where: str, table: Mapping[str, Any], key: str, default: float, *, positive: bool = False) -> float:
    value = finite_number(where, key, table[key]) if key in table else default
    if positive and not value > 0.0:
        raise BadInputError(f"{where}: {key} is {table.get(key, 'missing')}; give a positive number")
    return value


def _whole(where: str, table: Mapping[str, Any], key: str, least: int, default: int) -> int:
    value = table.get(key, default)
    if not isinstance(value, int) or isinstance(value, bool) or not least <= value <= _LARGEST:
        raise BadInputError(f"{where}: {key} is {shown(value)}; give a whole number from {least} to {_LARGEST:g}")
    return value


def _some(where: str, data: Mapping[str, Any], key: str) -> list[tuple[str, Any]]:
    table = table_of(where, data, key)
    if not table:
        raise BadInputError(f"{where}: [{key}] is empty; name at least one")
    return list(table.items())


def _known(where: str, what: str, table: Any, keys: tuple[str, ...]) -> None:
    if not isinstance(table, dict):
        raise BadInputError(f"{where}: {what} is no table")
    for key in table:
        if key not in keys:
            raise BadInputError(f"{where}: unknown entry {key!r}; {what} has {', '.join(keys)}")


def _internal(value: float, output: str) -> float:
    return math.radians(value) if output == "dihedral" else value
