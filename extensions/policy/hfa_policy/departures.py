"""Departures of flights from the envelope, and trims at its edge."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from hfa_aircraft.limits import Limits
from hfa_flight.envelope import Departure, departure, flight_envelope
from hfa_policy.flights import SampledFlight
from hfa_support.errors import BadInputError
from hfa_support.native.bound import RowFunction
from hfa_support.reporting.text import short_number, shown_unit
from trim.point.operating_point import OperatingPoint


def departure_text(left: Departure) -> str:
    """Return a departure as text, such as "altitude below 0 ft at 0.02 s"."""
    when = f"at {left.time:.4g} s"
    if not math.isfinite(left.value):
        return f"{left.state} is not a number {when}"
    suffix = "" if left.unit == "1" else f" {shown_unit(left.unit)}"
    side = "below" if left.value < left.limit else "above"
    limit = f"{short_number(left.limit, left.unit)}{suffix}" + " (assumed)" * left.assumed
    return f"{left.state} {side} {limit} {when}"


def departure_at(envelope: Limits, states: np.ndarray, time: float) -> str:
    """Return the departure of a flight as text: the violated limit of a state, and the time.

    states: (n,), states outside the envelope
    time: s
    """
    left = departure(envelope, np.array([time]), states[None], False)
    assert left is not None
    return departure_text(left)


def first_departure(
    flight: SampledFlight, rows: np.ndarray, envelope: Limits, seconds: float, pushed: float
) -> tuple[int, Departure | None]:
    """Return the index and the departure of the flight that leaves the envelope first.

    The result is (0, None) if all flights stay inside.

    rows: initial rows of the flights (`flights.py`)
    seconds: duration of the flights, s
    pushed: end of the disturbance pulse, s
    """
    X, *_, push, _ = flight.slices
    advance = RowFunction(flight.sample())
    moving = rows.copy()
    for number in range(round(seconds / flight.dt) + 1):
        left = ~envelope.within(moving[:, X]).all(axis=1)
        if left.any():
            first = int(np.argmax(left))
            times = np.array([number * flight.dt])
            return first, departure(envelope, times, moving[first, X][None], False)
        if number == round(pushed / flight.dt):
            moving[:, push] = 0.0
        moving = advance(moving)[0]
    return 0, None


def refuse_edges(points: Sequence[OperatingPoint]) -> None:
    """Raise BadInputError for a trim at the edge of the envelope.

    At such a trim, a state whose rate depends on other linear states is at its limit. Flights with
    small deviations from such a trim leave the envelope immediately.
    """
    for point in points:
        model = point.model
        envelope = flight_envelope(model, point)
        values = np.array(point.states)
        at_lowest = envelope.at_lowest(values)
        edges = np.flatnonzero(at_lowest | envelope.at_highest(values)).tolist()
        if not edges:
            continue
        A = model.at(point.states, point.inputs).A
        linear = [list(model.states).index(name) for name in model.linear]
        for index in edges:
            others = [number for number in linear if number != index]
            if not A[index, others].any():
                continue
            name = envelope.names[index]
            which, side = ("lowest", "above") if at_lowest[index] else ("highest", "below")
            raise BadInputError(
                f"the trim is at the {which} limit of {name}, "
                f"{model.describe(name, float(values[index]))}, so every flight leaves the "
                f"envelope immediately; choose a trim with {name} {side} this limit"
            )
