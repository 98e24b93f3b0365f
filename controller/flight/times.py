"""How the times of a flight must fit each other."""

from __future__ import annotations

import math
from collections.abc import Mapping

from hfa_model.support.errors import BadInputError

#: Most steps of a flight: beyond them its rows fill the memory of an ordinary machine.
MOST_STEPS = 10_000_000


def check_times(duration: float, step: float, tick: float) -> None:
    """Raise BadInputError unless all, s, are positive, fit each other and make `MOST_STEPS` steps at most."""
    times = {"duration": duration, "step": step, "tick": tick}
    for name, value in times.items():
        if not (math.isfinite(value) and value > 0.0):
            raise BadInputError(f"{name} is {value} s; it must be a positive number")
    check_whole(times)
    if duration > MOST_STEPS * step * (1 + 1e-9):
        raise BadInputError(
            f"duration is {duration:g} s; with a step of {step:g} s it must not exceed {MOST_STEPS * step:g} s"
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
