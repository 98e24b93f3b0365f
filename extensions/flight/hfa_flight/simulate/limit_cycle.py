"""Detection of oscillations at the end of a flight that persist without excitation."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from hfa_aircraft.model import Model
from hfa_flight.simulate.history import Deviations
from hfa_support.reporting.text import beside_unit, short_number

#: A variable oscillates if it crosses its least-squares line at least this often in each of the
#: last two quarters of the flight ...
CROSSINGS = 4
#: ... its amplitude in the last quarter is at least this fraction of that in the third ...
LASTING = 0.9
#: ... and at least this fraction of the nominal size of the variable.
VISIBLE = 0.01
#: A decay is steady if its rate in the last quarter is at least this fraction of that in the third
#: ...
_STEADY = 0.5
#: ... and the amplitude decreases by more than this fraction in a quarter of the flight.
_LEAST_DECAY = 5e-3
#: Number of alternating estimates of line and frequency.
_ROUNDS = 4
#: Longest flight that is chosen for a growing mode, s. A mode that grows more slowly than by a
#: factor of e in this time is ignored.
_LONGEST_FLIGHT = 300.0
#: Growth, in powers of e, after which an oscillation has its final amplitude.
_FULLY_GROWN = 5.0
#: Flights for growing modes are a multiple of this time, s.
_MULTIPLE = 10.0


class LimitCycle(NamedTuple):
    """The largest persistent oscillation, relative to the nominal size of its variable.

    name: name of an input or state
    amplitude: half of peak to peak, in `unit`
    frequency: rad/s
    """

    name: str
    amplitude: float
    frequency: float
    unit: str

    def motion(self) -> str:
        """Return text such as "pitch_rate ±7.2 deg/s at 157 rad/s", with angles in degrees."""
        size = beside_unit(short_number(self.amplitude, self.unit), self.unit)
        return f"{self.name} ±{size} at {self.frequency:.3g} rad/s"

    def text(self) -> str:
        """Return a sentence on the limit cycle."""
        return f"limit cycle: {self.motion()}; the flight has not settled"


def slowest_recognized(seconds: float) -> float:
    """Return the frequency of the slowest oscillation that a flight recognizes, rad/s.

    `CROSSINGS` half-periods must fit into a quarter of the flight.

    seconds: duration of the flight, s
    """
    return 4.0 * CROSSINGS * np.pi / seconds


def duration_for(growing: np.ndarray) -> float:
    """Return the duration in which oscillations of growing modes are recognized, s, or 0 for none.

    In the first half of the flight, a mode reaches its final amplitude. The duration is at most
    `_LONGEST_FLIGHT`.

    growing: eigenvalues of the linear loop with positive real parts, 1/s
    """
    growing = growing[growing.real > 1.0 / _LONGEST_FLIGHT]
    if not growing.size:
        return 0.0
    grown = 2.0 * _FULLY_GROWN / growing.real
    # A flight of this duration recognizes half the frequency of the mode too, because a large
    # oscillation may be slower than a small one. Very slow modes count as 1 / _LONGEST_FLIGHT.
    frequencies = np.maximum(np.abs(growing.imag), 1.0 / _LONGEST_FLIGHT)
    recognized = 2.0 * slowest_recognized(1.0) / frequencies
    oscillates = growing.imag != 0.0
    longest = np.where(oscillates, np.maximum(grown, recognized), grown).max()
    return float(min(_LONGEST_FLIGHT, _MULTIPLE * np.ceil(longest / _MULTIPLE)))


def limit_cycle(model: Model, flight: Deviations, driven_until: float) -> LimitCycle | None:
    """Return the largest oscillation that persists at the end of a flight, or None.

    An oscillation counts only if it meets the limits `CROSSINGS`, `LASTING` and `VISIBLE`, and does
    not decay steadily. Sizes are relative to the nominal size of the variable, in the second half
    of the flight. None if the excitation ends in this half, or if the flight has too few steps.

    driven_until: time at which the last exciting signal ends, s
    """
    times = flight.times
    middle = times[-1] / 2
    if len(times) < 8 * CROSSINGS or driven_until > middle:
        return None
    begin, end = np.searchsorted(times, (middle, 1.5 * middle)).tolist()
    third, fourth = slice(begin, end), slice(end, None)
    found, largest = None, VISIBLE
    columns = np.hstack([flight.inputs, flight.states]).T
    for name, column in zip((*model.inputs, *model.states), columns, strict=True):
        # An oscillation about a line has at most the size of the signal.
        if np.ptp(column[fourth]) < VISIBLE * model.signals[name].nominal:
            continue
        before = _swings(times[third], column[third])
        after = _swings(times[fourth], column[fourth])
        if before is None or after is None or after.amplitude < LASTING * before.amplitude:
            continue
        share = after.amplitude / model.signals[name].nominal
        # A decay is steady if it goes on in the last quarter, and lowers the amplitude visibly.
        quarter = middle / 2
        decays = after.rate > max(_STEADY * before.rate, _LEAST_DECAY / quarter)
        if share >= largest and not decays:
            found = LimitCycle(name, after.amplitude, after.frequency, model.unit(name))
            largest = share
    return found


class _Swings(NamedTuple):
    """An oscillation of one variable, evaluated over complete half-periods."""

    amplitude: float  # mean of the peaks
    frequency: float  # rad/s, from the first and the last zero crossing
    # decay rate of the amplitude, 1/s, by least squares of log amplitude. The rate of a growing
    # oscillation is negative
    rate: float


def _swings(times: np.ndarray, values: np.ndarray) -> _Swings | None:
    """Return the oscillation of values about a line, or None for few crossings of the line."""
    off_line = values - np.polyval(np.polyfit(times, values, 1), times)
    for _ in range(_ROUNDS):  # the frequency from the crossings, then the line beside that sine
        crossings = np.flatnonzero(np.diff(off_line < 0.0))
        if len(crossings) < CROSSINGS:
            return None
        before, after = off_line[crossings], off_line[crossings + 1]
        step = times[crossings + 1] - times[crossings]
        crossed_at = times[crossings] + step * before / (before - after)  # interpolated linearly
        frequency = float(np.pi * (len(crossings) - 1) / (crossed_at[-1] - crossed_at[0]))
        off_line = values - _line_beside_sine(times, values, frequency)
    # Complete half-periods lie between crossings; the first and the last part are cut off.
    halves = [np.abs(half) for half in np.split(off_line, crossings + 1)[1:-1]]
    peaks = np.array([_peak(half) for half in halves])
    places = [begin + 1 + half.argmax() for begin, half in zip(crossings, halves, strict=False)]
    amplitudes = (peaks[:-1] + peaks[1:]) / 2.0  # the mean of neighbors cancels an offset
    middles = (times[places][:-1] + times[places][1:]) / 2.0
    rate = -np.polyfit(middles, np.log(amplitudes), 1)[0]
    return _Swings(float(amplitudes.mean()), frequency, float(rate))


def _peak(values: np.ndarray) -> float:
    """Return the peak of the values of a half-period: that of a parabola through three of them."""
    place = int(values.argmax())
    if not 0 < place < len(values) - 1:
        return float(values[place])
    before, highest, after = values[place - 1 : place + 2].tolist()
    bend = before - 2.0 * highest + after
    return highest if bend == 0.0 else highest - (before - after) ** 2 / (8.0 * bend)


def _line_beside_sine(times: np.ndarray, values: np.ndarray, frequency: float) -> np.ndarray:
    """Return the straight line, (N,), of the least-squares fit of a line and a sine.

    frequency: of the sine, rad/s
    """
    t = times - times.mean()
    terms = [np.ones_like(t), t, np.cos(frequency * t), np.sin(frequency * t)]
    fitted, *_ = np.linalg.lstsq(np.column_stack(terms), values, rcond=None)
    mean, slope, *_ = fitted
    return np.asarray(mean + slope * t)
