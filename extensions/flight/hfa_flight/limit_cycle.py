"""An oscillation that is left at the end of a flight although nothing drives it any more."""

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


class LimitCycle(NamedTuple):
    """What oscillates most, in nominal sizes.

    name: of an input or state
    amplitude: half of peak to peak, in `unit`
    frequency: rad/s
    """

    name: str
    amplitude: float
    frequency: float
    unit: str

    def motion(self) -> str:
        """What goes on, by how much and how fast, in degrees for angles."""
        size = short_number(self.amplitude, self.unit)
        if self.unit != "1":
            size += f" {shown_unit(self.unit)}"
        return f"{self.name} goes on by ±{size} at {self.frequency:.3g} rad/s"

    def text(self) -> str:
        """A sentence."""
        return f"limit cycle: {self.motion()}; the flight has not settled"


def limit_cycle(model: Model, flight: Deviations, driven_until: float) -> LimitCycle | None:
    """The largest oscillation in the second half of a flight, None without one.

    driven_until: s, when the last signal that drives the flight comes to rest. None also where that
    is in the second half, or the flight has too few steps.
    """
    times = flight.times
    middle = times[-1] / 2
    if len(times) < 8 * CROSSINGS or driven_until > middle:
        return None
    third = (times >= middle) & (times < 1.5 * middle)
    fourth = times >= 1.5 * middle
    largest = None
    largest_share = VISIBLE
    columns = np.hstack([flight.inputs, flight.states]).T
    for name, column in zip((*model.inputs, *model.states), columns, strict=True):
        amplitude_before, crossings_before = _oscillation(times[third], column[third])
        amplitude, crossings = _oscillation(times[fourth], column[fourth])
        share = amplitude / model.signals[name].nominal
        lasts = amplitude >= LASTING * amplitude_before
        if min(crossings_before, crossings) >= CROSSINGS and lasts and share >= largest_share:
            frequency = float(np.pi * crossings / (times[-1] / 4))
            largest = LimitCycle(name, amplitude, frequency, model.unit(name))
            largest_share = share
    return largest


def _oscillation(times: np.ndarray, values: np.ndarray) -> tuple[float, int]:
    """Half of peak to peak about the line of least squares, and the number of its sign changes."""
    t = times - times.mean()
    level = values - values.mean()
    off_line = level - t * (t @ level) / (t @ t)
    return float(np.ptp(off_line)) / 2, int(np.count_nonzero(np.diff(np.signbit(off_line))))
