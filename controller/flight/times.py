"""How the times of a flight must fit each other."""

from __future__ import annotations

import math

from hfa_model.support.errors import BadInputError

#: Most steps of a flight: beyond them its rows fill the memory of an ordinary machine.
MOST_STEPS = 10_000_000


def check_times(duration: float, step: float, tick: float) -> None:
    """Raise BadInputError unless all, s, are positive and make `MOST_STEPS` steps at most, the duration whole ticks, a
    tick whole steps."""
    times = {"duration": duration, "step": step, "tick": tick}
    for name, value in times.items():
        if not (math.isfinite(value) and value > 0.0):
            raise BadInputError(f"{name} is {value} s; it must be a positive number")
    for long, short in (("duration", "tick"), ("tick", "step")):
        count = times[long] / times[short]
        if round(count) < 1 or abs(count - round(count)) > 1e-6 * count:
            raise BadInputError(
                f"{long} is {times[long]:g} s and {short} is {times[short]:g} s; make the {long} a whole number of "
                f"{short}s"
            )
    if duration > MOST_STEPS * step * (1 + 1e-9):
        raise BadInputError(
            f"duration is {duration:g} s; with a step of {step:g} s it must not exceed {MOST_STEPS * step:g} s"
        )
