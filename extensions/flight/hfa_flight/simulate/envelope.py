"""Envelope of a flight, first departure from the envelope, and inputs beyond their control limits.

An envelope consists of `hfa_aircraft.limits.Limits` on the states of a model and on outputs. In
moving air, the limits of speed and flow angles apply to those relative to the air.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from hfa_aircraft.batch_simulation import RESOLVED, FlightOutcome, has_decayed
from hfa_aircraft.limits import Limits
from hfa_aircraft.model import Model
from hfa_aircraft.signals import record
from hfa_flight.air.gust_equations import IN_AIR, in_gusts, relative_to_air
from hfa_flight.air.sensors import at_trim
from hfa_flight.simulate.history import Deviations
from hfa_support.errors import BadInputError, pair_of, refuse_unknown
from hfa_support.matrices import quadratic_forms
from hfa_support.reporting.results import Result
from hfa_support.reporting.text import beside_unit, short_number, with_unit
from trim.point.operating_point import OperatingPoint

#: A flight without an envelope diverges if an error grows by more than this factor from the first
#: quarter of the flight to the last: with an unstable linear loop, more than a drift at a constant
#: rate, else more than a drift with t^4.
_FACTOR_IF_UNSTABLE, _FACTOR_IF_STABLE = 4.0, 256.0
#: Smallest number of steps after the last excitation by which a flight is judged.
_FEWEST_STEPS = 8
#: Smallest error of a flight that diverges, in nominal values.
_VISIBLE_ERROR = 0.01
#: What the first line of flights without an envelope says, and how a state gets a limit.
NO_LIMIT = "no state has a limit"
GIVE_LIMIT = "hfa fly --envelope NAME=LOW:HIGH (Python: envelope=) gives a state a limit"


class Departure(NamedTuple):
    """The first departure of a flight from the envelope, or the end of one that diverges.

    state: name of the variable
    time: s
    value: value at that time, in `unit`
    limit: the exceeded limit, in `unit`; inf or -inf if the flight diverges without a limit
    assumed: whether the limit is an assumption of the reader of the aircraft
    """

    state: str
    time: float
    value: float
    limit: float
    unit: str
    assumed: bool = False

    def text(self) -> str:
        """Return the departure as a sentence, with angles in degrees."""
        is_past_limit = np.isfinite([self.value, self.limit]).all()
        return f"{'left the envelope' if is_past_limit else 'diverged'}: {self.cause()}"

    def cause(self) -> str:
        """Return state, limit and time as text, such as "alpha above 20 deg at 1.9 s"."""
        when = f"at {self.time:.4g} s"
        if not np.isfinite(self.value):
            return f"{self.state} is not finite {when}"
        if not np.isfinite(self.limit):
            value = beside_unit(short_number(self.value, self.unit), self.unit)
            return f"{self.state} {value} {when}"
        side = "below" if self.value < self.limit else "above"
        limit = beside_unit(short_number(self.limit, self.unit), self.unit)
        return f"{self.state} {side} {limit}{' (assumed)' * self.assumed} {when}"


class ControlExcess(NamedTuple):
    """An input beyond a control limit.

    input: name of the input
    value: the value with the largest excess, in `unit`
    limit: the exceeded limit, in `unit`
    """

    input: str
    value: float
    limit: float
    unit: str

    def text(self) -> str:
        """Return name, value and limit as text, with angles in degrees."""
        value = beside_unit(short_number(self.value, self.unit), self.unit)
        return f"{self.input} {value} beyond {short_number(self.limit, self.unit)}"


def limits_text(lowest: float, highest: float, unit: str) -> str:
    """Return limits as text such as "-20 to 20", with angles in degrees.

    The text is "none" if both limits are infinite.
    """
    if np.isinf([lowest, highest]).all():
        return "none"
    return f"{short_number(lowest, unit)} to {short_number(highest, unit)}"


def flight_envelope(
    model: Model,
    point: OperatingPoint,
    changes: Mapping[str, tuple[float, float]] | None = None,
    *,
    of_outputs: bool = True,
) -> Limits:
    """Return the limits of the states within which the equations of a model are valid, and of
    outputs.

    For each state, the first of these limits that exists is used:

    - the limits in `changes`,
    - the limits that the model computes for a trim (`Domain.envelope`),
    - `min` and `max` of the state.

    point: the trim
    changes: state or output -> (lowest, highest), absolute. A speed or a flow angle has the limits
        of the state: in moving air they are of the one relative to the air, by either name
    of_outputs: whether outputs may have limits

    Raises BadInputError if a name is unknown, a lowest limit is not below the highest, or the trim
    is outside the envelope.
    """
    moving = in_gusts(model)
    known = (*model.states, *moving.outputs) if of_outputs else tuple(model.states)
    state_of = {output: state for state, output in relative_to_air(model).items()}
    pairs = {name: (signal.min, signal.max) for name, signal in model.states.items()}
    if model.domain.envelope is not None:
        parameters = record(tuple(model.parameters))(*model.p.tolist())
        pairs |= model.domain.envelope(point.states, parameters)
    for key, pair in (changes or {}).items():
        name = state_of.get(key, key)
        refuse_unknown("the envelope has no variable", name, known)
        if name != key and name in (changes or {}):
            raise BadInputError(f"the envelope has {key} and {name}; give one of the two")
        pairs[name] = pair_of(f"the envelope of {key}", pair)
        if not pairs[name][0] < pairs[name][1]:
            raise BadInputError(
                f"the envelope of {key} is {pair}; give two different numbers, the lower first"
            )
    envelope = Limits.of(moving, tuple(pairs), pairs)
    for sentence in envelope.broken(at_trim(point, envelope.names), verb="at trim is"):
        raise BadInputError(f"{sentence}; widen the envelope or choose another trim")
    return envelope


def in_moving_air(envelope: Limits) -> Limits:
    """Return an envelope of speed and flow angles relative to the air, in place of the states."""
    in_air = relative_to_air(envelope.model)
    return replace(envelope, names=tuple(in_air.get(name, name) for name in envelope.names))


def note_on_air(envelope: Limits) -> str:
    """Return a note on states and limits in moving air."""
    in_air = [name for name in envelope.names if name in IN_AIR]
    limits = f"the envelope limits {', '.join(in_air)}" if in_air else "no limit is"
    return f"speed and flow angles are relative to the ground; {limits}, relative to the air"


def is_limited(envelope: Limits) -> bool:
    """Return whether any state has a limit."""
    return bool(np.isfinite([envelope.lowest, envelope.highest]).any())


def envelope_data(envelope: Limits) -> dict[str, list[float]]:
    """Return the envelope for files: variable -> [lowest, highest]."""
    pairs = np.column_stack([envelope.lowest, envelope.highest]).tolist()
    return dict(zip(envelope.names, pairs, strict=True))


def outside(envelope: Limits, limited: np.ndarray) -> np.ndarray:
    """Return a mask (N,), True at each time at which a variable exceeds a limit or is not finite.

    limited: (N, n), absolute values of the variables
    """
    return np.asarray(~(envelope.within(limited) & np.isfinite(limited)).all(axis=-1))


def departure(envelope: Limits, times: np.ndarray, limited: np.ndarray) -> Departure | None:
    """Return the first departure, or None if there is none.

    If several variables exceed their limits at that time, the one with the largest excess relative
    to its range (`_ranges`) is returned. A value that is not finite has the largest excess.

    limited: (N, n), absolute values of the variables
    """
    # In the usual case, the least and largest values of all rows are inside.
    if not outside(envelope, np.array([limited.min(axis=0), limited.max(axis=0)])).any():
        return None
    row = int(np.argmax(outside(envelope, limited)))
    values = limited[row]
    with np.errstate(invalid="ignore"):  # infinite values without limits
        beyond = np.maximum(values - envelope.highest, envelope.lowest - values)
        excess = beyond / _ranges(envelope)
    index = int(np.argmax(np.where(np.isfinite(values), excess, np.inf)))
    value = float(values[index])
    limits = envelope.lowest if value < envelope.lowest[index] else envelope.highest
    name = envelope.names[index]
    unit = envelope.model.unit(name)
    assumed = bool(envelope.assumed[index])
    return Departure(name, float(times[row]), value, float(limits[index]), unit, assumed)


def _ranges(limits: Limits) -> np.ndarray:
    """Return the range of each variable, or its nominal value if a limit is missing, (k,)."""
    width = limits.highest - limits.lowest
    return np.where(np.isfinite(width), width, limits.model.nominal(limits.names))


def divergence(
    flight: Deviations, point: OperatingPoint, growth: float, driven_until: float
) -> Departure | None:
    """Return the end of a flight without an envelope that diverges, or None if it does not.

    The state is the one with the largest error in the last quarter, in nominal values.

    point: the trim
    growth: largest growth of a mode of the linear loop, 1/s, or 0 if no mode is known to grow
    driven_until: time at which the last excitation ends, s. The quarters are those of the flight
        after it, or of the whole flight if no time or few steps remain
    """
    times, end = flight.times, float(flight.times[-1])
    begin = driven_until if np.sum(times >= driven_until) >= _FEWEST_STEPS else 0.0
    quarter = (end - begin) / 4.0
    in_first_quarter = (times >= begin) & (times <= begin + quarter)
    before = np.abs(flight.errors[in_first_quarter]).max(axis=0)
    after = np.abs(flight.errors[times >= end - quarter]).max(axis=0)
    model = point.model
    nominal = model.nominal(model.linear)
    # With an unstable mode, growth beyond a drift at a constant rate is that of the mode; without a
    # known one, only growth beyond that of t^4 counts. A slower mode does not show in this flight.
    grows_by_e = growth * (end - begin) > 1.0
    factor = _FACTOR_IF_UNSTABLE if grows_by_e else _FACTOR_IF_STABLE
    sizes = np.where(after > factor * before, after / nominal, 0.0)
    index = int(np.argmax(sizes))
    if sizes[index] < _VISIBLE_ERROR:
        return None
    name = model.linear[index]
    (place,) = model.state_places((name,))
    value = float(flight.states[-1, place] + point.x[place])
    limit = float(np.copysign(np.inf, flight.states[-1, place]))
    return Departure(name, end, value, limit, model.unit(name))


def refuse_start(envelope: Limits, limited: np.ndarray) -> None:
    """Raise BadInputError if a flight begins outside its envelope.

    limited: (n,), absolute initial values of the variables
    """
    start = departure(envelope, np.zeros(1), limited[None])
    if start is not None:
        value = with_unit(start.value, start.unit)
        limit = with_unit(start.limit, start.unit)
        raise BadInputError(
            f"the initial {start.state} is {value}, beyond the limit of {limit}; choose an"
            " initial condition inside the envelope, or widen the envelope"
        )


def share_at_limits(model: Model, inputs: np.ndarray) -> dict[str, float]:
    """Return the share of the time during which each input is at or beyond a control limit.

    inputs: (N, m), absolute
    """
    limits = Limits.of(model, tuple(model.inputs))
    reached = np.logical_or(*limits.at_limits(inputs))
    shares = reached.sum(axis=0) / max(len(inputs), 1)
    return dict(zip(model.inputs, shares.tolist(), strict=True))


def control_excesses(model: Model, inputs: np.ndarray) -> tuple[ControlExcess, ...]:
    """Return the largest excess of each input that exceeds a control limit during a flight.

    The results are sorted by excess relative to the range (`_ranges`), largest first.

    inputs: (N, m), absolute
    """
    limits = Limits.of(model, tuple(model.inputs))
    # Of each input, the least or the largest value, whichever is farther beyond its limit.
    under = limits.lowest - inputs.min(axis=0)
    over = inputs.max(axis=0) - limits.highest
    values = np.where(under > over, inputs.min(axis=0), inputs.max(axis=0))
    passed = np.where(under > over, limits.lowest, limits.highest)
    beyond = np.flatnonzero(~limits.within(values))
    if not beyond.size:
        return ()
    excess = np.abs(values - passed)[beyond] / _ranges(limits)[beyond]
    found = []
    for index in beyond[np.argsort(-excess, kind="stable")].tolist():
        name = limits.names[index]
        value, limit = float(values[index]), float(passed[index])
        found.append(ControlExcess(name, value, limit, model.unit(name)))
    return tuple(found)


#: Largest cost-to-go z'Pz at the end of a flight that has returned, relative to the whole cost,
#: flown and to go, and to the largest cost-to-go before.
TOLERANCE = 0.05
SHARE_OF_LARGEST = 0.2
#: Deviations in nominal values at which the aircraft is at its trim, whatever the cost.
_AT_TRIM_DEVIATION = 1e-9
RULE = (
    "A flight has returned to the trim if its linear cost-to-go z'Pz at the end is at most "
    f"{100 * TOLERANCE:g} % of its cost, and {100 * SHARE_OF_LARGEST:g} % of the largest before."
)


def has_returned(model: Model, z: np.ndarray, P: np.ndarray, spent: float) -> bool:
    """Return whether a flight has returned to the trim at its end.

        z'Pz <= .05 (spent + z'Pz) and z'Pz <= .2 largest z'Pz before, or |z| <= 1e-9 nominal
        values in every state

    The cost alone grows also at an equilibrium far from the trim.

    model: the aircraft
    z: deviations of the linear states during the flight, (N, k)
    P: cost of the linear optimum, (k, k)
    spent: cost up to the end
    """
    nominal = model.nominal(model.linear)
    with np.errstate(over="ignore", invalid="ignore"):  # a flight may diverge
        to_go = quadratic_forms(z, P)
        decayed = has_decayed(to_go[-1], spent + to_go[-1], TOLERANCE)
        decayed &= has_decayed(to_go[-1], to_go.max(), SHARE_OF_LARGEST)
    return bool(decayed or (np.abs(z[-1]) <= _AT_TRIM_DEVIATION * nominal).all())


@dataclass(frozen=True, eq=False, kw_only=True)
class FlightRow(Result):
    """Flight of a policy from an initial condition to a trim, without its time history.

    policy: name of the policy.
    cost: cost of the flight and of the linear policy after it, or inf if the flight leaves the
        envelope or has not returned to the trim.
    departure: first departure from the envelope (state, time, value, limit), or None if the flight
        stays within.
    saturated: names of the inputs that reach a limit.
    seconds: duration of the simulation, s.
    integration_error: sum of the errors of the steps that could not be made short enough, relative
        to the largest deviation in nominal values.
    best: cost of the best flight from the same initial condition, or None if none was found.
    """

    policy: str
    cost: float
    departure: Departure | None
    saturated: tuple[str, ...]
    seconds: float
    integration_error: float = 0.0
    best: float | None = None

    @property
    def converges(self) -> bool:
        """True if the flight stays within the envelope and returns to the trim."""
        return math.isfinite(self.cost)

    @property
    def over_best(self) -> float | None:
        """Cost relative to that of the best flight, or None without one of them."""
        return self.cost / self.best if self.converges and self.best is not None else None

    @property
    def resolved(self) -> bool:
        """True if the error of the integration does not change three digits of the cost."""
        return self.integration_error <= RESOLVED

    @property
    def loss(self) -> str:
        """How the flight ends, or "" if it converges."""
        if self.departure is not None:
            return "leaves the envelope"
        return "" if self.converges else f"not at the trim after {self.seconds:.3g} s"

    def outcome(self) -> str:
        """Return the outcome in words, with the state and limit of a departure."""
        departure = "" if self.departure is None else self.departure.text()
        return departure or self.loss or FlightOutcome.CONVERGED

    def _entries(self) -> dict[str, Any]:
        """Return the entries of the file, name -> value."""
        return {
            "policy": self.policy,
            "converges": self.converges,
            "cost": self.cost if self.converges else None,
            "over_best": self.over_best,
            "departure": self.departure,
            "saturated": self.saturated,
            "seconds": self.seconds,
            "resolved": self.resolved,
        }
