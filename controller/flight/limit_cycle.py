"""Whether a flight ends in an oscillation that does not decay, although nothing drives it any more."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from controller.flight.gusts import OneMinusCosine
from controller.flight.scenario import Scenario
from controller.policy.signals import CommandedStates, Signal
from hfa_support.model import Model
from hfa_support.reporting.text import short_number, shown_unit

if TYPE_CHECKING:
    from controller.flight.simulation import Flight

#: An oscillation: about its line of least squares it changes sign this often in each of the last two quarters ...
CROSSINGS = 4
#: ... its amplitude in the last one is at least so much of that in the one before ...
LASTING = 0.9
#: ... and of the signal's nominal size.
VISIBLE = 0.01


class LimitCycle(NamedTuple):
    """The input or state that oscillates most, in nominal sizes: amplitude, half of peak to peak, and rad/s."""

    name: str
    amplitude: float
    frequency: float
    unit: str

    def text(self) -> str:
        """In degrees for angles."""
        size = f"{short_number(self.amplitude, self.unit)} {'' if self.unit == '1' else shown_unit(self.unit)}".strip()
        return f"limit cycle: {self.name} goes on by ±{size} at {self.frequency:.3g} rad/s; the flight has not settled"


def limit_cycle(model: Model, scenario: Scenario, flight: Flight) -> LimitCycle | None:
    """The oscillation that is left at the end of a flight; None without one, or while something drives the flight.

    flight: all of its rows, or those of its second half.
    """
    times = flight.times
    begin = times[-1] / 2
    if len(times) < 8 * CROSSINGS or is_driven(scenario, begin):
        return None
    found = []
    values = np.hstack([flight.inputs, flight.states])
    quarters = [(times >= begin) & (times < 1.5 * begin), times >= 1.5 * begin]
    for name, column in zip((*model.inputs, *model.states), values.T, strict=True):
        sizes, crossings = [], []
        for part in quarters:
            t, x = times[part] - times[part].mean(), column[part]
            x = x - x.mean() - t * (t @ (x - x.mean())) / (t @ t)
            sizes.append(float(x.max() - x.min()) / 2)
            crossings.append(int(np.count_nonzero(np.diff(np.signbit(x)))))
        share = sizes[1] / model.signals[name].nominal
        if min(crossings) >= CROSSINGS and sizes[1] >= LASTING * sizes[0] and share >= VISIBLE:
            frequency = np.pi * crossings[1] / (times[-1] / 4)
            found.append((share, LimitCycle(name, sizes[1], float(frequency), model.unit(name))))
    return max(found)[1] if found else None


def is_driven(scenario: Scenario, since: float) -> bool:
    """Whether anything but the loop itself moves the aircraft after a time, s."""
    if scenario.samples is not None or (scenario.gust is not None and not isinstance(scenario.gust, OneMinusCosine)):
        return True
    signals = [scenario.reference, scenario.disturbance, scenario.noise, *scenario.air.values()]
    for each in signals:
        if isinstance(each, CommandedStates):
            if len(each.commands.times) and each.commands.times[-1] > since:
                return True
        elif each is not None and not (isinstance(each, Signal) and not each.harmonics):
            return True
    gust = scenario.gust
    return isinstance(gust, OneMinusCosine) and gust.begin + gust.length / gust.speed > since
