"""Limits of a flight: the envelope of the states and which state left it first; inputs beyond their
control limits; an oscillation that does not decay although nothing drives it any more."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from controller.flight.policies import OpenLoop
from hfa_aircraft.model import Model, record
from hfa_support.errors import BadInputError, pair_of, refuse_unknown
from hfa_support.reporting.text import short_number, shown_unit
from trim.point.operating_point import OperatingPoint

if TYPE_CHECKING:
    from controller.flight.closed_loop import ClosedLoop
    from controller.flight.simulation import Flight

#: The state whose limits count on this output where the air moves: alpha through the air, not over
#: ground.
ALPHA, ANGLE_OF_ATTACK = "alpha", "angle_of_attack"
#: Said where the air moves.
OVER_GROUND = (
    f"alpha is over ground; the envelope limits {ANGLE_OF_ATTACK}, which is through the air"
)
#: An oscillation: about its line of least squares it changes sign this often in each of the last
#: two quarters ...
CROSSINGS = 4
#: ... its amplitude in the last one is at least so much of that in the one before ...
LASTING = 0.9
#: ... and of the signal's nominal size.
VISIBLE = 0.01


class Departure(NamedTuple):
    """What left the envelope first: its name (`limited_names`), the time in s, its value, the limit
    it passed, unit."""

    state: str
    time: float
    value: float
    limit: float
    unit: str

    def text(self) -> str:
        """In degrees for angles."""
        return f"left the envelope: {self.state} first, at {self.time:.4g} s, {_beyond(*self[2:])}"


class ControlExcess(NamedTuple):
    """An input that went beyond one of its control limits: its farthest value and that limit."""

    input: str
    value: float
    limit: float
    unit: str

    def text(self) -> str:
        """In degrees for angles."""
        return f"{self.input} {_beyond(*self[1:])}"


def _beyond(value: float, limit: float, unit: str) -> str:
    return f"{_shown(value, unit)} beyond {short_number(limit, unit)}"


def _shown(value: float, unit: str) -> str:
    return short_number(value, unit) + ("" if unit == "1" else f" {shown_unit(unit)}")


def limits_text(lowest: float, highest: float, unit: str) -> str:
    """Between which values something must stay, degrees for angles."""
    if np.isinf([lowest, highest]).all():
        return "none"
    return f"{short_number(lowest, unit)} to {short_number(highest, unit)}"


def control_limits(model: Model) -> np.ndarray:
    """Lowest and highest value of each input, (2, m)."""
    return np.array([(each.min, each.max) for each in model.inputs.values()]).T


def control_excesses(model: Model, inputs: np.ndarray) -> tuple[ControlExcess, ...]:
    """Inputs beyond their limits, the farthest first as a share of the range between both; inputs:
    (N, m), absolute."""
    (low, high), lowest, highest = control_limits(model), inputs.min(axis=0), inputs.max(axis=0)
    below = low - lowest > highest - high  # the side on which an input is farther beyond
    values, limits = np.where(below, lowest, highest), np.where(below, low, high)
    with np.errstate(invalid="ignore"):  # of inputs without limits, which are never beyond them
        share = np.abs(values - limits) / (high - low)
    found = sorted(np.flatnonzero(beyond_control_limits(model, values)), key=lambda i: -share[i])
    names = tuple(model.inputs)
    return tuple(
        ControlExcess(names[i], float(values[i]), float(limits[i]), model.unit(names[i]))
        for i in found
    )


def beyond_control_limits(model: Model, inputs: np.ndarray) -> np.ndarray:
    """Whether each of inputs (.., m), absolute, lies beyond its limits, by more than rounding."""
    low, high = control_limits(model)
    return np.asarray(
        (inputs < low - 1e-9 * (1 + np.abs(low))) | (inputs > high + 1e-9 * (1 + np.abs(high)))
    )


def flown_through_air(model: Model) -> bool:
    """Whether a model has an alpha over ground and one through the air."""
    return ALPHA in model.states and ANGLE_OF_ATTACK in model.outputs


def limited_names(model: Model, moving_air: bool) -> tuple[str, ...]:
    """What each limit counts on: the states, alpha replaced by `ANGLE_OF_ATTACK` where the air
    moves."""
    instead = {ALPHA: ANGLE_OF_ATTACK} if moving_air and flown_through_air(model) else {}
    return tuple(instead.get(name, name) for name in model.states)


@dataclass(frozen=True)
class Envelope:
    """lowest, highest: absolute limits of every state of a model, by name; of alpha: through the
    air."""

    lowest: Any
    highest: Any
    model: Model

    def to_dict(self, moving_air: bool = False) -> dict[str, list[float]]:
        """Name of `limited_names` -> [lowest, highest]."""
        pairs = zip(limited_names(self.model, moving_air), self.lowest, self.highest, strict=True)
        return {name: [float(low), float(high)] for name, low, high in pairs}

    def limits_text(self, index: int) -> str:
        """The limits of a state, degrees for angles."""
        return limits_text(
            self.lowest[index], self.highest[index], self.model.unit(list(self.model.states)[index])
        )

    def refuse_start(self, limited: np.ndarray, moving_air: bool = False) -> None:
        """BadInputError when a flight begins outside; limited: one row, (1, n), as of
        `departure`."""
        found = self.departure(np.zeros(1), limited, moving_air)
        if found is not None:
            said = f"the flight begins with {found.state} {_beyond(*found[2:])}"
            raise BadInputError(f"{said}; begin inside the envelope, or widen it")

    def outside(self, limited: np.ndarray) -> np.ndarray:
        """Which rows of (N, n) are not within all limits; a number that is not finite is not."""
        within = (
            (limited >= np.array(self.lowest))
            & (limited <= np.array(self.highest))
            & np.isfinite(limited)
        )
        return np.asarray(~within.all(axis=-1))

    def departure(
        self, times: np.ndarray, limited: np.ndarray, moving_air: bool = False
    ) -> Departure | None:
        """The first row outside, and its state with the largest excess in half-widths; None without
        one.

        limited: (N, n), absolute states, alpha through the air.
        """
        if not self.outside(np.array([limited.min(axis=0), limited.max(axis=0)])).any():
            return None
        row = int(np.argmax(self.outside(limited)))
        lowest, highest, at = np.array(self.lowest), np.array(self.highest), limited[row]
        width = np.where(np.isfinite(highest - lowest), highest - lowest, 1.0)
        excess = np.maximum(at - highest, lowest - at) / width
        index = int(np.argmax(np.where(np.isfinite(at), excess, np.inf)))
        value = float(at[index])
        limit = lowest[index] if value < lowest[index] else highest[index]
        name = limited_names(self.model, moving_air)[index]
        return Departure(
            name,
            float(times[row]),
            value,
            float(limit),
            self.model.unit(tuple(self.model.states)[index]),
        )


def flight_envelope(
    aircraft: Model,
    point: OperatingPoint,
    changes: Mapping[str, tuple[float, float]] | None = None,
) -> Envelope:
    """Where the equations of an aircraft are meant to hold, about a trim: min and max of its
    states, and what its model limits about a trim (`Model.envelope`).

    changes: state -> (lowest, highest), absolute, replaces a pair; `ANGLE_OF_ATTACK` is another
    name of alpha's. BadInputError for a name that is no state, or when the trim lies outside."""
    model = aircraft
    pairs = {name: (each.min, each.max) for name, each in model.states.items()}
    if model.envelope is not None:
        pairs |= model.envelope(point.states, model.layout.record("p", model.p.tolist()))
    for given, pair in (changes or {}).items():
        name = ALPHA if given == ANGLE_OF_ATTACK else given
        refuse_unknown("the envelope has no state", name, tuple(model.states))
        pairs[name] = pair_of(f"the envelope of {given}", pair)
    for name, (lowest, highest) in pairs.items():
        at = getattr(point.states, name)
        if not lowest <= at <= highest:
            found, low, high = (model.describe(name, value) for value in (at, lowest, highest))
            raise BadInputError(
                f"the trim has {name} {found}, outside the envelope's {low} to {high}"
            )
    values = record(tuple(model.states))
    lowest, highest = (
        values(**{name: pair[side] for name, pair in pairs.items()}) for side in (0, 1)
    )
    return Envelope(lowest, highest, model)


class LimitCycle(NamedTuple):
    """The input or state that oscillates most, in nominal sizes: amplitude, half of peak to peak,
    and rad/s."""

    name: str
    amplitude: float
    frequency: float
    unit: str

    def text(self) -> str:
        """In degrees for angles."""
        size = _shown(self.amplitude, self.unit)
        return f"limit cycle: {self.name} goes on by ±{size} at {self.frequency:.3g} rad/s; the flight has not settled"


def limit_cycle(loop: ClosedLoop, flight: Flight) -> LimitCycle | None:
    """The oscillation that is left at the end of a flight; None without one or without a law, or
    while something drives the flight."""
    times, model = flight.times, loop.plant.point.model
    begin = times[-1] / 2
    if (
        len(times) < 8 * CROSSINGS
        or loop.scenario.driven_until > begin
        or isinstance(loop.law.policy, OpenLoop)
    ):
        return None
    found = []
    values = np.hstack([flight.inputs, flight.states])
    quarters = [(times >= begin) & (times < 1.5 * begin), times >= 1.5 * begin]
    for name, column in zip((*model.inputs, *model.states), values.T, strict=True):
        sizes, crossings = [], []
        for part in quarters:
            t, x = times[part] - times[part].mean(), column[part]
            x = x - x.mean() - t * (t @ (x - x.mean())) / (t @ t)
            sizes.append(float(np.ptp(x)) / 2)
            crossings.append(int(np.count_nonzero(np.diff(np.signbit(x)))))
        share = sizes[1] / model.signals[name].nominal
        if min(crossings) >= CROSSINGS and sizes[1] >= LASTING * sizes[0] and share >= VISIBLE:
            frequency = np.pi * crossings[1] / (times[-1] / 4)
            found.append((share, LimitCycle(name, sizes[1], float(frequency), model.unit(name))))
    return max(found)[1] if found else None
