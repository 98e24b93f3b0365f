"""Delays in samples, and durations in steps."""

from __future__ import annotations

import math
from typing import NamedTuple

#: A time this close to a whole number of samples, in samples, is that number, if it is not 0.
WHOLE = 1e-6


class Delay(NamedTuple):
    """A delay of `whole` samples and `rest` seconds, with 0 <= rest < sample time.

    The command of sample k acts from `rest` after sample k + whole on; until then the one before it
    acts.
    """

    whole: int
    rest: float

    @property
    def is_whole(self) -> bool:
        """True if the delay is a whole number of samples."""
        return self.rest == 0.0


def in_samples(delay: float, dt: float) -> Delay:
    """Return a delay in samples.

    delay, dt: delay and sample time, s
    """
    samples = delay / dt
    nearest = round(samples)
    if abs(samples - nearest) <= WHOLE * min(samples, 1.0):
        return Delay(nearest, 0.0)
    whole = math.floor(samples)
    return Delay(whole, delay - whole * dt)


def acting_commands(delay: float, dt: float, seconds: float) -> list[tuple[int, float]]:
    """Return which commands act in some seconds after a sample, with the duration of each, s.

    A command is named by the number of samples since its own: 0 is that of this sample.

    delay, dt: delay and sample time, s
    """
    late, until = in_samples(delay, dt)
    begin = 0.0
    acting = []
    for since in range(late + 1, -1, -1):
        end = min(until, seconds)
        if end - begin > WHOLE * dt:
            acting.append((since, end - begin))
            begin = end
        until += dt
    return acting


def steps_of(seconds: float, step: float) -> int:
    """Return the least number of steps, at least 1, that last as long as a time, up to `WHOLE`."""
    return max(1, math.ceil(seconds / step - WHOLE))
