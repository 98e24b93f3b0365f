"""What a trim imposes and what it leaves free: a condition on states, inputs and their rates."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from hfa_model.atmosphere import HIGHEST_ALTITUDE
from hfa_model.printed_matrices import published_data
from hfa_model.vectors import INPUT_SCALES, INPUTS, STATE_SCALES, STATES, UNITS, Input, State
from hfa_support.errors import BadInputError, is_finite, pair_of, refuse_unknown, shown
from hfa_support.linear_table import LinearTable
from hfa_support.reporting.text import shown_unit, shown_value

#: The variables of a trim: the states with the pitch angle replaced by the flight-path angle γ = θ - α, and the inputs.
VARIABLES: tuple[str, ...] = tuple("gamma" if name == "pitch" else name for name in STATES) + INPUTS
SCALES: dict[str, float] = STATE_SCALES._asdict() | INPUT_SCALES._asdict() | {"gamma": STATE_SCALES.pitch}
#: The rates that a steady flight balances. The altitude changes with γ and is not among them.
BALANCED: tuple[str, ...] = tuple(name for name in STATES if name != "altitude")

#: Limits of the controls, assumed: the paper states none. Throttle in units of thrust, deflections in rad.
CONTROL_LIMITS = Input(
    throttle=(0.0, 200.0),
    aileron_center=(-math.radians(20), math.radians(20)),
    aileron_outer=(-math.radians(20), math.radians(20)),
    elevator_center=(-math.radians(30), math.radians(30)),
    elevator_outer=(-math.radians(30), math.radians(30)),
)
#: Where the equations are meant to hold: attached flow, the atmosphere's altitudes.
STATE_LIMITS = State(
    speed=(1.0, 500.0),
    alpha=(-math.radians(20), math.radians(20)),
    altitude=(0.0, HIGHEST_ALTITUDE),
    pitch=(-math.radians(60), math.radians(60)),
    pitch_rate=(-math.inf, math.inf),
    dihedral=(-math.radians(60), math.radians(60)),
    dihedral_rate=(-math.inf, math.inf),
)
#: Of every state and input. The flight-path angle has none of its own: the pitch angle θ = α + γ limits it.
LIMITS: dict[str, tuple[float, float]] = STATE_LIMITS._asdict() | CONTROL_LIMITS._asdict()


#: The paper calls its linear model applicable up to this dihedral angle (Section 5.1), rad.
PAPER_RANGE = math.radians(15.0)
#: The same with room for rounding: what lies beyond it is warned of.
PAPER_LIMIT = PAPER_RANGE * (1 + 1e-12)


@dataclass(frozen=True)
class TrimCondition:
    """f(X, U) = rates, with some of X, γ, U imposed and the others free within limits.

    imposed: variable -> value. tables: variable -> its values over the dihedral angle, rad; `at` makes numbers of them.
    free: the unknowns; together they name every one of `VARIABLES` once. rates: state -> imposed value of its rate; the
    rates of `BALANCED` unless given. A rate that is left out is not balanced. limits: variable, or pitch -> (lowest,
    highest); `LIMITS` for what is not named. begin: variable -> where the search for it begins. name: of a condition
    from a file. English units and radians. BadInputError when a name is unknown, a value is not finite or lies outside
    its limits, or a variable is named twice or not at all.
    """

    imposed: Mapping[str, float]
    free: tuple[str, ...]
    rates: Mapping[str, float] = field(default_factory=lambda: dict.fromkeys(BALANCED, 0.0))
    limits: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    begin: Mapping[str, float] = field(default_factory=dict)
    tables: Mapping[str, LinearTable] = field(default_factory=dict)
    name: str = field(default="", compare=False)

    def __post_init__(self) -> None:
        """Name what is wrong before anything is solved."""
        held: dict[str, Any] = {**self.imposed, **self.tables}
        for names, known in (((*held, *self.free), VARIABLES), (self.limits, (*VARIABLES, "pitch"))):
            for name in names:
                refuse_unknown("unknown trim variable", name, known)
        for name in VARIABLES:
            times = (name in self.imposed) + (name in self.tables) + self.free.count(name)
            if times != 1:
                what = "neither imposed nor free"
                if times > 1:
                    what = "both imposed and free" if name in held else "named free twice"
                raise BadInputError(f"{name} is {what}; name it once")
        if not self.rates:
            raise BadInputError("no rate is imposed; name at least one of " + ", ".join(STATES))
        for name, value in self.rates.items():
            refuse_unknown("unknown rate", name, STATES)
            _refuse_infinite(f"the rate of {name}", value)
        for name, ends in self.limits.items():
            lowest, highest = pair_of(f"limits of {name}", ends)
            if not lowest < highest:
                raise BadInputError(
                    f"limits of {name} are {describe(name, lowest)} to {describe(name, highest)}; "
                    "the first must be the lower one"
                )
        for name, value in held.items():
            for each in value.values.tolist() if isinstance(value, LinearTable) else [value]:
                _refuse_infinite(name, each)
                _check(name, each, self._own_limits(name))

    def at(self, dihedral: float | None = None, hold: Mapping[str, float] | None = None) -> TrimCondition:
        """The condition in numbers at a dihedral angle, rad (None for its own), with the values of `hold` imposed.

        A free dihedral angle begins there. BadInputError outside the angles of a table, or where a value lies outside
        its limits.
        """
        angle = self.imposed.get("dihedral", self.begin.get("dihedral", 0.0)) if dihedral is None else dihedral
        own = {"dihedral": angle} if "dihedral" in self.imposed else {}
        values = {name: float(self.values_at(name, angle)) for name in self.tables}
        imposed = {**self.imposed, **values, **own, **(hold or {})}
        free = tuple(name for name in self.free if name not in imposed)
        begin = {**self.begin, "dihedral": angle} if "dihedral" in free else self.begin
        return replace(self, imposed=imposed, free=free, begin=begin, tables={})

    def values_at(self, name: str, dihedral: float | np.ndarray) -> np.ndarray:
        """What is imposed on a variable at one dihedral angle or at many, rad."""
        table = self.tables.get(name)
        if table is None:
            return np.full(np.shape(dihedral), self.imposed[name])
        asked, (first, last) = np.atleast_1d(dihedral), table.places[[0, -1]]
        outside = asked[(asked < first - 1e-12) | (asked > last + 1e-12)]
        if outside.size:
            raise BadInputError(
                f"condition {self.name}: {name} is given from {math.degrees(first):g} to "
                f"{math.degrees(last):g} deg of dihedral; {math.degrees(outside[0]):g} deg lies outside"
            )
        return table.at(dihedral)

    def to_dict(self) -> dict[str, Any]:
        """How it differs from the paper's level flight, as JSON data; tables as [dihedral, value] rows."""
        imposed = {name: value for name, value in self.imposed.items() if LEVEL_FLIGHT.imposed.get(name) != value}
        tables = {name: np.column_stack([each.places, each.values]).tolist() for name, each in self.tables.items()}
        rates, paper = dict(self.rates), LEVEL_FLIGHT.imposed
        begin = {
            name: self.begin[name] for name in self.free if self.begin.get(name, paper.get(name)) != paper.get(name)
        }
        changes: dict[str, Any] = {
            "imposed": {**imposed, **tables},
            "free": [name for name in self.free if name not in LEVEL_FLIGHT.free],
            "limits": {name: list(limits) for name, limits in self.limits.items()},
            "begin": begin,
            "rates": {} if rates == dict.fromkeys(BALANCED, 0.0) else rates,
        }
        return {name: change for name, change in changes.items() if change}

    def in_words(self) -> str:
        """The same for people: speed 60 ft/s, alpha free, throttle within 0 and 50; empty for the paper's flight."""
        changes = self.to_dict()
        words = [
            f"{name} {'over the dihedral' if isinstance(value, list) else describe(name, value)}"
            for name, value in changes.get("imposed", {}).items()
        ]
        words += [f"{name} free" for name in changes.get("free", ())]
        words += [
            f"{name} within {describe(name, low)} and {describe(name, high)}"
            for name, (low, high) in changes.get("limits", {}).items()
        ]
        return ", ".join(words)

    def check_pitch(self) -> None:
        """BadInputError when pitch = alpha + gamma lies beyond its limits, or they leave no alpha or gamma.

        Not asked of every condition: `release` may yet set free what stands in the way.
        """
        if "alpha" in self.imposed and "gamma" in self.imposed:
            alpha, gamma = self.imposed["alpha"], self.imposed["gamma"]
            parts = f" (alpha is {describe('alpha', alpha)}, gamma is {describe('gamma', gamma)})"
            _check("pitch", alpha + gamma, self._own_limits("pitch"), parts)
        for name in self.free:
            lowest, highest = self.limits_of(name)
            if not lowest < highest:
                raise BadInputError(f"the limits of pitch, alpha and gamma leave no {name}; widen one of them")

    def limits_of(self, name: str) -> tuple[float, float]:
        """Lowest and highest value of a variable; of alpha and gamma what the limits of pitch = alpha + gamma leave."""
        lowest, highest = self._own_limits(name)
        if name not in ("alpha", "gamma"):
            return lowest, highest
        other = "gamma" if name == "alpha" else "alpha"
        least, most = (self.imposed[other],) * 2 if other in self.imposed else self._own_limits(other)
        pitch = self._own_limits("pitch")
        return max(lowest, pitch[0] - most), min(highest, pitch[1] - least)

    def _own_limits(self, name: str) -> tuple[float, float]:
        return self.limits.get(name, LIMITS.get(name, (-math.inf, math.inf)))


def _refuse_infinite(name: str, value: object) -> None:
    if not is_finite(value):
        raise BadInputError(f"{name} is {shown(value)}; give a finite number")


def _check(name: str, value: float, limits: tuple[float, float], parts: str = "") -> None:
    lowest, highest = limits
    if not lowest <= value <= highest:
        raise BadInputError(
            f"{name} is {describe(name, value)}{parts}; it must lie between {describe(name, lowest)} "
            f"and {describe(name, highest)}"
        )


def level_flight(
    dihedral: float,
    *,
    speed: float | None = None,
    altitude: float | None = None,
    alpha: float | None = None,
    gamma: float = 0.0,
    limits: Mapping[str, tuple[float, float]] | None = None,
) -> TrimCondition:
    """The paper's trim (Section 5.1): speed, altitude, α = θ and dihedral imposed, center aileron at zero;
    throttle, outer aileron and both elevators free. Four equations, four unknowns.

    Angles in rad, speed in ft/s, altitude in ft; what is not given is the paper's. gamma: flight-path angle.
    """
    paper = published_data()["trim"]
    imposed = {
        "speed": paper["speed"] if speed is None else speed,
        "alpha": math.radians(paper["alpha_deg"]) if alpha is None else alpha,
        "altitude": paper["altitude"] if altitude is None else altitude,
        "gamma": gamma,
        "pitch_rate": paper["pitch_rate"],
        "dihedral": dihedral,
        "dihedral_rate": paper["dihedral_rate"],
        "aileron_center": 0.0,
    }
    free = tuple(name for name in VARIABLES if name not in imposed)
    return TrimCondition(imposed, free, limits=dict(limits or {}))


#: The paper's, with a flat wing: `at` takes another dihedral angle.
LEVEL_FLIGHT = level_flight(0.0)


def release(
    condition: TrimCondition,
    *,
    free: tuple[str, ...] = (),
    hold: Mapping[str, float | LinearTable] | None = None,
    limits: Mapping[str, tuple[float, float]] | None = None,
) -> TrimCondition:
    """The same condition with the named variables set free, others held at the given values, and further limits.

    The search for a variable set free begins at the value that it was held at.
    """
    hold = dict(hold or {})
    for name in (*free, *hold):
        refuse_unknown("unknown trim variable", name, VARIABLES)
    both = sorted(set(free) & set(hold))
    if both:
        raise BadInputError(f"{both[0]} is both set free and held; name it once")
    tables = {**condition.tables, **{name: each for name, each in hold.items() if isinstance(each, LinearTable)}}
    values = {**condition.imposed, **{name: each for name, each in hold.items() if not isinstance(each, LinearTable)}}
    held_at = values | {name: float(table.values[0]) for name, table in tables.items()}
    return replace(
        condition,
        imposed={name: each for name, each in values.items() if name not in free and hold.get(name, each) is each},
        tables={name: each for name, each in tables.items() if name not in free and hold.get(name, each) is each},
        free=tuple(name for name in VARIABLES if name in free or (name in condition.free and name not in hold)),
        limits={**condition.limits, **(limits or {})},
        begin={**condition.begin, **{name: held_at[name] for name in free if name in held_at}},
    )


def describe(name: str, value: float) -> str:
    """A value with its unit as an engineer reads it: angles in degrees."""
    unit = UNITS[name]
    return shown_value(value, unit) + ("" if unit == "1" else f" {shown_unit(unit)}")
