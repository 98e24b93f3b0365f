"""What a search over a design may change, what it simulates, and what it must keep."""

from __future__ import annotations

import copy
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from controller.design.design import Actuator
from hfa_support.errors import BadInputError


class Variable(NamedTuple):
    """A number of the design file that the search may choose: the entries that get it, and its limits, > 0."""

    name: str
    entries: tuple[str, ...]
    low: float
    high: float


class InCommands(NamedTuple):
    """One linear flight: dihedral rad, the actuator of every input, commands (K, q) held for `each` s."""

    dihedral: float
    actuator: Actuator
    each: float
    ends: np.ndarray


class InTurbulence(NamedTuple):
    """A linear flight in Dryden turbulence of `intensity`, ft/s, and `scale`, ft; objective: state -> cost of its rms
    being 1."""

    dihedral: float
    actuator: Actuator
    intensity: float
    scale: float
    objective: Mapping[str, float]


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
    rest.

    p: power, at least 1; the larger, the more the worst counts alone. start: entries of the design file that the search
    starts from. objective: output -> cost of 1 of its unit. angles: rad, where the corners are closed, for all of
    `dynamics` (() for those of the search). abscissa: largest allowed at any corner, 1/s. rate: largest allowed in any
    case, rad/s. margin: smallest allowed disk margin, at inputs and sensors, with the actuators of any case. fastest:
    largest allowed |pole| of a loop in any case, 1/s. evaluations: how many. seed: of the search.
    """

    name: str
    start: Mapping[str, Any]
    variables: tuple[Variable, ...]
    cases: tuple[InCommands, ...]
    objective: Mapping[str, float]
    angles: tuple[float, ...]
    abscissa: float
    rate: float
    evaluations: int
    seed: int
    turbulence: tuple[InTurbulence, ...] = ()
    gusts: tuple[InGust, ...] = ()
    margin: float = 0.0
    fastest: float = np.inf
    dynamics: tuple[str, ...] = ()
    power: float = 1.0

    @property
    def places(self) -> tuple[tuple[float, Actuator], ...]:
        """Angle and actuator of every linear flight, each once."""
        found = [(each.dihedral, each.actuator) for each in self.cases]
        found += [(each.dihedral, each.actuator) for each in self.turbulence]
        return tuple(dict.fromkeys(found))

    def entries_at(self, values: np.ndarray) -> dict[str, Any]:
        """The entries of the design file with these values of the variables."""
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
        """What the start has, brought within the limits. BadInputError when it has no such number."""
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


class Evaluation(NamedTuple):
    """cost: what the search makes small. abscissa: of the worst corner, of the worst loop where one is unstable, 1/s.
    errors: rms by output, rate: rad/s, of each case. rms: by state, of each turbulence. gusts: the share of the
    envelope that each needs, 1 for all of it. margin: smallest of all cases. fastest: 1/s. What was left out is empty,
    0 or inf: all where a loop is unstable, and what comes after a cost that is no longer of interest, which is then a
    lower bound."""

    cost: float
    abscissa: float
    errors: tuple[dict[str, float], ...] = ()
    rates: tuple[float, ...] = ()
    rms: tuple[dict[str, float], ...] = ()
    gusts: tuple[float, ...] = ()
    margin: float = 0.0
    fastest: float = np.inf


class Tuned(NamedTuple):
    """Values of the variables and their evaluation: of the start and of the best one found. seen: all evaluations."""

    first: np.ndarray
    first_evaluation: Evaluation
    best: np.ndarray
    best_evaluation: Evaluation
    seen: tuple[Evaluation, ...]
