"""The times of a flight: how they must fit each other, and what follows from them."""

from __future__ import annotations

import math
from collections.abc import Mapping

from hfa_model.support.errors import BadInputError

#: Most steps of a flight: beyond them its rows fill the memory of an ordinary machine.
MOST_STEPS = 10_000_000


class Timed:
    """A flight of `duration`, integrated by `step` and changed once a `tick`, all in s."""

    duration: float
    step: float
    tick: float

    @property
    def steps_per_tick(self) -> int:
        """Steps in a tick."""
        return round(self.tick / self.step)

    @property
    def ticks(self) -> int:
        """Ticks in the flight."""
        return round(self.duration / self.tick)

    def check_times(self) -> None:
        """Raise BadInputError unless all are positive, fit each other and make `MOST_STEPS` steps at most."""
        times = {name: getattr(self, name) for name in ("duration", "step", "tick")}
        for name, value in times.items():
            if not (math.isfinite(value) and value > 0.0):
                raise BadInputError(f"{name} is {value} s; it must be a positive number")
        check_whole(times)
        if self.duration > MOST_STEPS * self.step * (1 + 1e-9):
            raise BadInputError(
                f"duration is {self.duration:g} s; with a step of {self.step:g} s it must not exceed "
                f"{MOST_STEPS * self.step:g} s"
            )


def check_whole(times: Mapping[str, float], where: str = "") -> None:
    """Raise BadInputError unless a tick is a whole number of steps, and the duration of ticks.

    times: positive, s, by the names duration, tick and step. where: what stands before these names in messages.
    """
    for long, short in (("duration", "tick"), ("tick", "step")):
        count = times[long] / times[short]
        if round(count) < 1 or abs(count - round(count)) > 1e-6 * count:
            raise BadInputError(
                f"{where}{long} is {times[long]:g} s and {where}{short} is {times[short]:g} s; "
                f"make the {long} a whole number of {short}s"
            )
