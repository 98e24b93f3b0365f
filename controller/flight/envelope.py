"""Limits of a flight: the envelope of the states and which state left it first; inputs beyond their control limits."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

import casadi as ca
import numpy as np

from hfa_model.kinematics import angle_of_attack
from hfa_model.parameters import Parameters
from hfa_model.vectors import INPUTS, STATE_UNITS, STATES, UNITS, State
from hfa_support.errors import BadInputError, pair_of, refuse_unknown
from hfa_support.native.bound import RowsFunction, cached_per_thread
from hfa_support.reporting.text import degrees, short_number, shown_unit
from trim.point.condition import CONTROL_LIMITS, STATE_LIMITS, describe
from trim.point.operating_point import OperatingPoint

#: Altitude that a flight may gain or lose, ft.
ALTITUDE_BAND = 1000.0
#: Slowest and fastest flight, as fractions of the trimmed speed.
SLOWEST, FASTEST = 0.5, 2.0


#: What the limits of alpha count on where the air moves: alpha through the air, not over ground.
ANGLE_OF_ATTACK = "angle_of_attack"
#: Said where the air moves.
OVER_GROUND = f"alpha is over ground; the envelope limits {ANGLE_OF_ATTACK}, which is through the air"


class Departure(NamedTuple):
    """What left the envelope first: its name (`limited_names`), the time in s, its value and the limit it passed."""

    state: str
    time: float
    value: float
    limit: float

    def text(self) -> str:
        """In degrees for angles."""
        unit = UNITS[self.state]
        value, limit = short_number(self.value, unit), short_number(self.limit, unit)
        return f"left the envelope: {self.state} first, at {self.time:.4g} s, {value} {shown_unit(unit)} beyond {limit}"


class ControlExcess(NamedTuple):
    """An input that went beyond one of `CONTROL_LIMITS`: its farthest value and that limit."""

    input: str
    value: float
    limit: float

    @property
    def share(self) -> float:
        """How far beyond, as a share of the range between the two limits."""
        lowest, highest = getattr(CONTROL_LIMITS, self.input)
        return float(abs(self.value - self.limit) / (highest - lowest))

    def text(self) -> str:
        """In degrees for angles."""
        unit = UNITS[self.input]
        return (
            f"{self.input} {short_number(self.value, unit)} {shown_unit(unit)} beyond {short_number(self.limit, unit)}"
        )


def control_excesses(lowest: np.ndarray, highest: np.ndarray) -> tuple[ControlExcess, ...]:
    """Inputs beyond their limits, the farthest first; lowest, highest: of each input in a flight, (5,), absolute."""
    low, high = np.array(CONTROL_LIMITS).T
    below = low - lowest > highest - high  # the side on which an input is farther beyond
    values, limits = np.where(below, lowest, highest), np.where(below, low, high)
    beyond = beyond_control_limits(values)
    found = [ControlExcess(INPUTS[i], float(values[i]), float(limits[i])) for i in np.flatnonzero(beyond)]
    return tuple(sorted(found, key=lambda each: -each.share))


def beyond_control_limits(inputs: np.ndarray) -> np.ndarray:
    """Whether each of inputs (.., 5), absolute, lies beyond `CONTROL_LIMITS`, by more than rounding."""
    low, high = np.array(CONTROL_LIMITS).T
    return np.asarray((inputs < low - 1e-9 * (1 + np.abs(low))) | (inputs > high + 1e-9 * (1 + np.abs(high))))


def limited_names(moving_air: bool) -> tuple[str, ...]:
    """What each of the seven limits counts on: the states, alpha replaced by `ANGLE_OF_ATTACK` where the air moves."""
    return tuple(ANGLE_OF_ATTACK if moving_air and name == "alpha" else name for name in STATES)


def angles_of_attack(states: np.ndarray, updrafts: np.ndarray | None) -> np.ndarray:
    """Alpha through the air, (N,), rad, of absolute states (N, 7) in updrafts (N,), ft/s; None: still air."""
    if updrafts is None:
        return np.asarray(states[:, STATES.index("alpha")])
    return _angle_of_attack()(len(states), states, updrafts[:, None])[0].ravel()


@cached_per_thread(1)
def _angle_of_attack() -> RowsFunction:
    """(x (7,), w) -> alpha through the air: asked at every tick of a flight, so that it is built once."""
    x, w = ca.SX.sym("x", len(STATES)), ca.SX.sym("w")
    return RowsFunction(ca.Function("angle_of_attack", [x, w], [angle_of_attack(State(*ca.vertsplit(x)), w)]))


@dataclass(frozen=True)
class Envelope:
    """lowest, highest: absolute limits of every state, in the units of `STATES`; of alpha: through the air.

    Its methods take updrafts, in which the states are, ft/s, as `angles_of_attack` does; None: still air, where alpha
    over ground is alpha through the air.
    """

    lowest: State
    highest: State

    def to_dict(self, moving_air: bool = False) -> dict[str, list[float]]:
        """Name of `limited_names` -> [lowest, highest]."""
        pairs = zip(limited_names(moving_air), self.lowest, self.highest, strict=True)
        return {name: [float(low), float(high)] for name, low, high in pairs}

    def limits_text(self, index: int) -> str:
        """The limits of a state, degrees for angles."""
        unit = STATE_UNITS[index]
        return f"{short_number(self.lowest[index], unit)} to {short_number(self.highest[index], unit)}"

    def inside(self, states: np.ndarray, updrafts: np.ndarray | None = None) -> np.ndarray:
        """Which rows of (N, 7) absolute states are within all limits; a number that is not finite is not."""
        limited = _limited(states, updrafts)
        return np.asarray(((limited >= np.array(self.lowest)) & (limited <= np.array(self.highest))).all(axis=-1))

    def refuse_start(self, states: np.ndarray, updrafts: np.ndarray | None = None) -> None:
        """BadInputError when a flight from these absolute states, (7,), in updrafts of one row, begins outside."""
        found = self.departure(np.zeros(1), states[None], updrafts)
        if found is not None:
            (value, unit), (limit, _) = (degrees(x, UNITS[found.state]) for x in (found.value, found.limit))
            raise BadInputError(
                f"the flight begins with {found.state} {float(value):.6g}, beyond the limit of {float(limit):.6g} "
                f"{unit}; begin inside the envelope, or widen it"
            )

    def departure(self, times: np.ndarray, states: np.ndarray, updrafts: np.ndarray | None = None) -> Departure | None:
        """The first row of (N, 7) absolute states outside, and its state with the largest excess in half-widths."""
        outside = ~self.inside(states, updrafts)
        if not outside.any():
            return None
        row = int(np.argmax(outside))
        limited = _limited(states, updrafts)[row]
        lowest, highest = np.array(self.lowest), np.array(self.highest)
        excess = np.maximum(limited - highest, lowest - limited) / (highest - lowest)
        index = int(np.argmax(np.where(np.isfinite(excess), excess, np.inf)))
        value = float(limited[index])
        limit = lowest[index] if value < lowest[index] else highest[index]
        return Departure(limited_names(updrafts is not None)[index], float(times[row]), value, float(limit))


def _limited(states: np.ndarray, updrafts: np.ndarray | None) -> np.ndarray:
    """What the limits count on, (N, 7)."""
    if updrafts is None:
        return states
    limited = states.copy()
    limited[:, STATES.index("alpha")] = angles_of_attack(states, updrafts)
    return limited


def flight_envelope(
    parameters: Parameters, point: OperatingPoint, changes: Mapping[str, tuple[float, float]] | None = None
) -> Envelope:
    """Where the equations are meant to hold, about a trim.

    Speed: half to double the trimmed one. Altitude: within `ALTITUDE_BAND`. Alpha, pitch, dihedral: `STATE_LIMITS`
    of the trim. Pitch rate: V tan(α_max)/l_b, at which the tail, a boom behind, meets the air at the largest α.
    Dihedral rate: V tan(α_max)/(s/3), at which the hinges do. The equations leave out both angles or grow by them,
    so that beyond these rates they mean little. changes: state -> (lowest, highest), absolute, replaces a pair;
    `ANGLE_OF_ATTACK` is another name of alpha's.
    BadInputError for a name that is no state, or when the trim lies outside.
    """
    at = point.states
    steepest = at.speed * math.tan(STATE_LIMITS.alpha[1])
    pitch_rate, dihedral_rate = steepest / parameters.boom_length, steepest / (parameters.panel_span / 3)
    pairs = STATE_LIMITS._asdict() | {
        "speed": (SLOWEST * at.speed, FASTEST * at.speed),
        "altitude": (at.altitude - ALTITUDE_BAND, at.altitude + ALTITUDE_BAND),
        "pitch_rate": (-pitch_rate, pitch_rate),
        "dihedral_rate": (-dihedral_rate, dihedral_rate),
    }
    for given, pair in (changes or {}).items():
        name = "alpha" if given == ANGLE_OF_ATTACK else given
        refuse_unknown("the envelope has no state", name, STATES)
        pairs[name] = pair_of(f"the envelope of {given}", pair)
    for name, (lowest, highest) in pairs.items():
        if not lowest <= getattr(at, name) <= highest:
            found, low, high = (describe(name, value) for value in (getattr(at, name), lowest, highest))
            raise BadInputError(f"the trim has {name} {found}, outside the envelope's {low} to {high}")
    return Envelope(*(State(**{name: pair[side] for name, pair in pairs.items()}) for side in (0, 1)))
