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


class ActingCommand(NamedTuple):
    """A delayed command that acts for a time after a sample.

    samples_ago: number of samples since that of the command, 0 for the command of the sample
    seconds: time for which it acts, s
    """

    samples_ago: int
    seconds: float


def acting_commands(delay: float, dt: float, seconds: float) -> list[ActingCommand]:
    """Return the commands that act in some seconds after a sample, the earliest first.

    delay, dt: delay and sample time, s
    """
    # The oldest command ends after the rest of the delay, and each later one a sample later.
    whole, ends = in_samples(delay, dt)
    acting = []
    begin = 0.0
    for samples_ago in range(whole + 1, -1, -1):
        end = min(ends, seconds)
        if end - begin > WHOLE * dt:
            acting.append(ActingCommand(samples_ago, end - begin))
            begin = end
        ends += dt
    return acting


def steps_of(seconds: float, step: float) -> int:
    """Return the least number of steps, at least 1, that last as long as a time, up to `WHOLE`."""
    return max(1, math.ceil(seconds / step - WHOLE))
