"""What a search over a design may change, what it flies, and what it must keep; its file."""

from __future__ import annotations

import copy
import json
import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from controller.design.design import NAMED, Actuator, read_design
from hfa_model import VARIANTS
from hfa_support import BadInputError
from hfa_support.files import read_toml, write_text
from studies.servo.feedforward import shaped_design

#: The designs that were searched: name -> file.
DESIGNS = {
    name: str(Path(__file__).parent / "designs" / f"{name.replace('-', '_')}.toml")
    for name in ("servo-gusts", "servo-states")
} | {"servo": str(Path(__file__).parent / "designs" / "servo_three.toml")}
_ACTUATOR = ("order", "bandwidth", "damping", "effectiveness")
_POSITIVE = ("low", "high", "each", "intensity", "scale", "length", "rate", "margin", "fastest", "evaluations")


class Variable(NamedTuple):
    """A number of the design that the search may choose: the entries that get it, and its limits, > 0."""

    name: str
    entries: tuple[str, ...]
    low: float
    high: float


class InCommands(NamedTuple):
    """One linear flight: dihedral, rad, the actuator of every input, commands (K, q) held for `each` s."""

    dihedral: float
    actuator: Actuator
    ends: np.ndarray
    each: float = 70.0


class InTurbulence(NamedTuple):
    """A linear flight in Dryden turbulence of `intensity`, ft/s, and `scale`, ft.

    objective: state -> cost of an rms of 1.
    """

    dihedral: float
    actuator: Actuator
    objective: Mapping[str, float]
    intensity: float = 3.0
    scale: float = 1750.0


class InGust(NamedTuple):
    """A 1-cosine gust of `length`, ft, and `peak`, ft/s, negative downward, that the nonlinear aircraft must stand.

    dynamics: of the aircraft, "" for those of the search.
    """

    dihedral: float
    actuator: Actuator
    length: float
    peak: float
    dynamics: str = ""


@dataclass(frozen=True, eq=False)
class Tuning:
    """min (Σ_cases Σ_outputs (objective · rms error)^p + Σ_turbulence Σ_states (objective · rms)^p)^(1/p), and keep the
    limits.

    p: power, at least 1; the larger, the more the worst error counts alone. start: entries of the design that the
    search starts from. objective: output -> cost of an rms error of 1 in its unit. angles: rad, where the corners are
    closed, for all of `dynamics` (() for those of the search). abscissa: largest at any corner, 1/s. rate: largest of
    an input in any case, rad/s. margin: smallest disk margin at inputs and sensors, fastest: largest |pole| of a loop,
    1/s, both with the actuators of any flight. evaluations: how many. seed: of the search.
    """

    name: str
    start: Mapping[str, Any]
    variables: tuple[Variable, ...]
    cases: tuple[InCommands, ...]
    objective: Mapping[str, float]
    angles: tuple[float, ...]
    abscissa: float = -1e-3
    rate: float = math.inf
    evaluations: int = 1000
    seed: int = 0
    turbulence: tuple[InTurbulence, ...] = ()
    gusts: tuple[InGust, ...] = ()
    margin: float = 0.0
    fastest: float = math.inf
    dynamics: tuple[str, ...] = ()
    power: float = 1.0

    @property
    def places(self) -> tuple[tuple[float, Actuator], ...]:
        """Angle and actuator of every linear flight, each once."""
        found = [(each.dihedral, each.actuator) for each in self.cases]
        return tuple(dict.fromkeys([*found, *((each.dihedral, each.actuator) for each in self.turbulence)]))

    def entries_at(self, values: np.ndarray) -> dict[str, Any]:
        """The entries of the design with these values of the variables."""
        entries = copy.deepcopy(dict(self.start))
        for variable, value in zip(self.variables, values.tolist(), strict=True):
            for path in variable.entries:
                *tables, last = path.split(".")
                place = entries
                for table in tables:
                    place = place.setdefault(table, {})
                place[last] = value
        return entries

    def first_values(self) -> np.ndarray:
        """The values of the start, brought within their limits. BadInputError when the start has no such number."""
        found = []
        for variable in self.variables:
            place: Any = self.start
            for part in variable.entries[0].split("."):
                place = place.get(part) if isinstance(place, dict) else None
            if isinstance(place, bool) or not isinstance(place, (int, float)):
                raise BadInputError(
                    f"{self.name}: variable {variable.name}: the design has no number {variable.entries[0]} to start "
                    "from; correct the name, or put the number into the design"
                )
            found.append(min(max(float(place), variable.low), variable.high))
        return np.array(found)


def design_entries(name: str, folder: Path = Path()) -> dict[str, Any]:
    """Entries of a design: one of the package or of `DESIGNS` by its name, or a file, relative to a folder."""
    return read_design(DESIGNS[name] if name in DESIGNS else name if name in NAMED else str(folder / name))


def load_tuning(path: str) -> Tuning:
    """Read a tuning file: the fields of `Tuning` by their names, angles in deg, rate in deg/s.

    design: name or file of the start. [variables.NAME]: entries, low, high. [objective]. [[cases]], [[turbulence]],
    [[gusts]]: dihedral (deg), order, bandwidth, damping, effectiveness and the fields of the flight; [cases.ends]:
    output = list of commands (angles in deg). BadInputError names the file and the entry that is wrong.
    """
    try:
        data = read_toml(path)
        _refuse_numbers(data, "")
        if not isinstance(data["angles"], list):
            raise ValueError(f"angles is {data['angles']}; give a list of degrees")
        design = data.pop("design")
        start = design_entries(design, Path(path).parent)
        made, _ = shaped_design(design, start)
        outputs, states = made.integrals, made.plant_states
        found = Tuning(
            name=path,
            start=start,
            variables=tuple(_variable(name, **table) for name, table in data.pop("variables").items()),
            cases=tuple(_flight(InCommands, table, outputs) for table in data.pop("cases")),
            objective=_objective(data.pop("objective"), outputs),
            angles=tuple(math.radians(angle) for angle in data.pop("angles")),
            rate=math.radians(data.pop("rate", math.inf)),
            turbulence=tuple(_flight(InTurbulence, table, states) for table in data.pop("turbulence", [])),
            gusts=tuple(_flight(InGust, table, ()) for table in data.pop("gusts", [])),
            dynamics=tuple(data.pop("dynamics", ())),
            **data,
        )
        for name in (*found.dynamics, *(gust.dynamics for gust in found.gusts if gust.dynamics)):
            VARIANTS[name]
        if not (found.cases and found.variables and found.angles and found.power >= 1.0 and found.abscissa < 0.0):
            raise ValueError("give at least one of cases, variables and angles, power >= 1, abscissa < 0")
        np.random.default_rng(found.seed)
        shaped_design(design, found.entries_at(found.first_values()))
    except KeyError as error:
        raise BadInputError(f"{path}: {error} is missing or unknown; see studies/servo/README.md") from error
    except OSError as error:
        raise BadInputError(f"{path}: there is no readable file of that name") from error
    except (BadInputError, TypeError, ValueError, AttributeError) as error:
        raise BadInputError(f"{path}: {str(error).removeprefix(f'{path}: ')}; correct the entry") from error
    return found


def _refuse_numbers(value: Any, path: str) -> None:
    """ValueError names the first number that is not finite, or not positive where it must be."""
    entries = value.items() if isinstance(value, dict) else enumerate(value, 1) if isinstance(value, list) else ()
    for key, each in entries:
        place = f"{path}.{key}" if path else str(key)
        if isinstance(each, (int, float)) and not (math.isfinite(each) and (each > 0.0 or key not in _POSITIVE)):
            raise ValueError(f"{place} is {each}; give a {'positive' if key in _POSITIVE else 'finite'} number")
        _refuse_numbers(each, place)


def _variable(name: str, entries: list[str], low: float, high: float) -> Variable:
    if not (entries and low < high):
        raise ValueError(f"variables.{name}: give entries, and low below high")
    return Variable(name, tuple(entries), low, high)


def _objective(table: Mapping[str, float], known: tuple[str, ...]) -> dict[str, float]:
    for name, size in table.items():
        if name not in known or not size >= 0.0:
            raise ValueError(f"objective.{name} is {size}; give numbers that are not negative, of {', '.join(known)}")
    return dict(table)


def _flight(kind: Any, table: Mapping[str, Any], names: tuple[str, ...]) -> Any:
    """A flight of this kind; names: of the outputs that are commanded, or of the states of the objective."""
    table = dict(table)
    actuator = Actuator(**{key: table.pop(key) for key in _ACTUATOR if key in table})
    if "ends" in table:
        ends = table.pop("ends")
        sizes = [math.radians(1.0) if name == "dihedral" else 1.0 for name in names]
        table["ends"] = np.array(
            [size * np.array(ends[name], float) for name, size in zip(names, sizes, strict=True)]
        ).T
    if "objective" in table:
        table["objective"] = _objective(table["objective"], names)
    return kind(dihedral=math.radians(table.pop("dihedral")), actuator=actuator, **table)


def save_design(path: Path, entries: Mapping[str, Any]) -> None:
    """Write the entries of a design as a design file, one dotted key a line; whole or not at all."""
    write_text(path, "".join(f"{line}\n" for line in _toml(entries, "")))


def _toml(table: Mapping[str, Any], path: str) -> Iterator[str]:
    for name, value in table.items():
        if isinstance(value, Mapping):
            yield from _toml(value, f"{path}{name}.")
        else:
            yield f"{path}{name} = {repr(value) if isinstance(value, float) else json.dumps(value)}"
