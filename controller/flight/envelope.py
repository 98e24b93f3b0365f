"""The flight envelope: between which values each state must stay, and which state left first."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from hfa_model.parameters import Parameters
from hfa_model.support.errors import BadInputError
from hfa_model.support.text import degrees
from hfa_model.vectors import STATE_UNITS, STATES, State
from trim.point.condition import STATE_LIMITS, describe
from trim.point.operating_point import OperatingPoint

#: Altitude that a flight may gain or lose, ft.
ALTITUDE_BAND = 1000.0
#: Slowest and fastest flight, as fractions of the trimmed speed.
SLOWEST, FASTEST = 0.5, 2.0


class Departure(NamedTuple):
    """Which state left the envelope first: its name, the time in s, its value and the limit that it passed."""

    state: str
    time: float
    value: float
    limit: float


@dataclass(frozen=True)
class Envelope:
    """lowest, highest: absolute limits of every state, in the units of `STATES`."""

    lowest: State
    highest: State

    def to_dict(self) -> dict[str, list[float]]:
        """State -> [lowest, highest]."""
        return {
            name: [float(low), float(high)] for name, low, high in zip(STATES, self.lowest, self.highest, strict=True)
        }

    def inside(self, states: np.ndarray) -> np.ndarray:
        """Which rows of (N, 7) absolute states are within all limits; a number that is not finite is not."""
        return np.asarray(((states >= np.array(self.lowest)) & (states <= np.array(self.highest))).all(axis=-1))

    def refuse_start(self, states: np.ndarray) -> None:
        """BadInputError when a flight from these absolute states, (7,), begins outside."""
        found = self.departure(np.zeros(1), states[None])
        if found is not None:
            (value, unit), (limit, _) = (
                degrees(x, getattr(STATE_UNITS, found.state)) for x in (found.value, found.limit)
            )
            raise BadInputError(
                f"the flight begins with {found.state} {float(value):.6g}, beyond the limit of {float(limit):.6g} "
                f"{unit}; begin inside the envelope, or widen it"
            )

    def departure(self, times: np.ndarray, states: np.ndarray) -> Departure | None:
        """The first row of (N, 7) absolute states outside, and its state with the largest excess in half-widths."""
        outside = ~self.inside(states)
        if not outside.any():
            return None
        row = int(np.argmax(outside))
        lowest, highest = np.array(self.lowest), np.array(self.highest)
        excess = np.maximum(states[row] - highest, lowest - states[row]) / (highest - lowest)
        index = int(np.argmax(np.where(np.isfinite(excess), excess, np.inf)))
        value = float(states[row, index])
        limit = lowest[index] if value < lowest[index] else highest[index]
        return Departure(STATES[index], float(times[row]), value, float(limit))


def flight_envelope(
    parameters: Parameters, point: OperatingPoint, changes: Mapping[str, tuple[float, float]] | None = None
) -> Envelope:
    """Where the equations are meant to hold, about a trim.

    Speed: half to double the trimmed one. Altitude: within `ALTITUDE_BAND`. Alpha, pitch, dihedral: `STATE_LIMITS`
    of the trim. Pitch rate: V tan(α_max)/l_b, at which the tail, a boom behind, meets the air at the largest α.
    Dihedral rate: V tan(α_max)/(s/3), at which the hinges do. The equations leave out both angles or grow by them,
    so that beyond these rates they mean little. changes: state -> (lowest, highest), absolute, replaces a pair.
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
    for name, pair in (changes or {}).items():
        if name not in pairs:
            raise BadInputError(f"the envelope has no state {name!r}; choose from {', '.join(STATES)}")
        pairs[name] = pair
    for name, (lowest, highest) in pairs.items():
        if not lowest <= getattr(at, name) <= highest:
            found, low, high = (describe(name, value) for value in (getattr(at, name), lowest, highest))
            raise BadInputError(f"the trim has {name} {found}, outside the envelope's {low} to {high}")
    return Envelope(*(State(**{name: pair[side] for name, pair in pairs.items()}) for side in (0, 1)))
