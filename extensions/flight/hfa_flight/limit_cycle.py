"""Detection of an oscillation that persists at the end of a flight without excitation."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from hfa_aircraft.model import Model
from hfa_flight.flight_history import Deviations
from hfa_support.reporting.text import short_number, shown_unit

#: A column oscillates if, about its line of least squares, it changes sign at least this often in
#: each of the last two quarters of the flight ...
CROSSINGS = 4
#: ... its amplitude in the last quarter is at least this part of that in the quarter before ...
LASTING = 0.9
#: ... and at least this part of the signal's nominal size.
VISIBLE = 0.01


#: A decay is even if its rate in the last quarter is at least this part of that before ...
_EVEN = 0.5
#: ... and the amplitude falls by more than this part in a quarter of the flight.
_NO_DECAY = 5e-3
#: How often line and frequency are found in turn.
_ROUNDS = 4


class LimitCycle(NamedTuple):
    """The largest oscillation, in nominal sizes.

    name: name of an input or state
    amplitude: half of peak to peak, in `unit`
    frequency: rad/s
    """

    name: str
    amplitude: float
    frequency: float
    unit: str

    def motion(self) -> str:
        """Return the oscillating variable, its amplitude and frequency as text, in degrees for
        angles."""
        size = short_number(self.amplitude, self.unit)
        if self.unit != "1":
            size += f" {shown_unit(self.unit)}"
        return f"{self.name} ±{size} at {self.frequency:.3g} rad/s"

    def text(self) -> str:
        """Return the oscillation in a sentence."""
        return f"limit cycle: {self.motion()}; the flight has not settled"


class Decay(NamedTuple):
    """The largest oscillation, in nominal sizes, that decays at a constant rate.

    name: name of an input or state
    time_to_half: s
    frequency: rad/s
    """

    name: str
    time_to_half: float
    frequency: float

    def text(self) -> str:
        """Return the decay in a sentence."""
        return (
            f"{self.name} oscillates at {self.frequency:.3g} rad/s and decays: half in "
            f"{self.time_to_half:.3g} s"
        )


def limit_cycle(model: Model, flight: Deviations, driven_until: float) -> LimitCycle | None:
    """Return the largest oscillation in the second half of a flight that does not decay, or
    None.
    """
    found = oscillation(model, flight, driven_until)
    return found if isinstance(found, LimitCycle) else None


def oscillation(model: Model, flight: Deviations, driven_until: float) -> LimitCycle | Decay | None:
    """Return the largest oscillation in the second half of a flight, or None.

    A limit cycle takes precedence over a decaying oscillation. The result is also None if the
    excitation ends in the second half, or the flight has too few steps.

    driven_until: s, end of the last signal that excites the flight
    """
    times = flight.times
    middle = times[-1] / 2
    if len(times) < 8 * CROSSINGS or driven_until > middle:
        return None
    third = (times >= middle) & (times < 1.5 * middle)
    fourth = times >= 1.5 * middle
    cycle: LimitCycle | None = None
    decay: Decay | None = None
    shares = {LimitCycle: VISIBLE, Decay: VISIBLE}
    columns = np.hstack([flight.inputs, flight.states]).T
    for name, column in zip((*model.inputs, *model.states), columns, strict=True):
        before = _swings(times[third], column[third])
        after = _swings(times[fourth], column[fourth])
        if before is None or after is None or after.amplitude < LASTING * before.amplitude:
            continue
        share = after.amplitude / model.signals[name].nominal
        is_even = after.rate > max(_EVEN * before.rate, _NO_DECAY / (middle / 2))
        if is_even and share >= shares[Decay]:
            decay = Decay(name, float(np.log(2.0) / after.rate), after.frequency)
            shares[Decay] = share
        elif not is_even and share >= shares[LimitCycle]:
            cycle = LimitCycle(name, after.amplitude, after.frequency, model.unit(name))
            shares[LimitCycle] = share
    return cycle or decay


class _Swings(NamedTuple):
    """An oscillation in whole half-periods.

    amplitude: half of peak to peak, mean
    frequency: rad/s, between the first and the last crossing of the line
    rate: 1/s, at which the amplitude decays, by least squares of its logarithm; negative where it
        grows
    """

    amplitude: float
    frequency: float
    rate: float


def _swings(times: np.ndarray, values: np.ndarray) -> _Swings | None:
    """Return the oscillation about its least-squares line, or None with fewer than `CROSSINGS`
    crossings.
    """
    off_line = values - values.mean()
    off_line = off_line - np.polyval(np.polyfit(times, off_line, 1), times)
    for _ in range(_ROUNDS):
        crossings = np.flatnonzero(np.diff(off_line < 0.0))
        if len(crossings) < CROSSINGS:
            return None
        before = off_line[crossings]
        step = times[crossings + 1] - times[crossings]
        when = times[crossings] + step * before / (before - off_line[crossings + 1])
        frequency = float(np.pi * (len(when) - 1) / (when[-1] - when[0]))
        off_line = values - _line(times, values, frequency)
    parts = [np.abs(part) for part in np.split(off_line, crossings + 1)[1:-1]]
    peaks = np.array([_peak(part) for part in parts])
    places = [begin + 1 + part.argmax() for begin, part in zip(crossings, parts, strict=False)]
    pairs = (peaks[:-1] + peaks[1:]) / 2.0  # one up, one down: no level is left
    middles = (times[places][:-1] + times[places][1:]) / 2.0
    rate = -np.polyfit(middles, np.log(pairs), 1)[0]
    return _Swings(float(pairs.mean()), frequency, float(rate))


def _peak(values: np.ndarray) -> float:
    """Return the peak of a half-period, by a parabola through the highest value and its
    neighbors."""
    place = int(values.argmax())
    if not 0 < place < len(values) - 1:
        return float(values[place])
    before, highest, after = values[place - 1 : place + 2].tolist()
    bend = before - 2.0 * highest + after
    return highest if bend == 0.0 else highest - (before - after) ** 2 / (8.0 * bend)


def _line(times: np.ndarray, values: np.ndarray, frequency: float) -> np.ndarray:
    """Return the line of the least-squares fit by a line plus a harmonic, at the times."""
    t = times - times.mean()
    terms = [np.ones_like(t), t, np.cos(frequency * t), np.sin(frequency * t)]
    level, slope = np.linalg.lstsq(np.column_stack(terms), values, rcond=None)[0][:2]
    return np.asarray(level + slope * t)
