"""Description of a kink of the rates at an equilibrium."""

from __future__ import annotations

import numpy as np

from hfa_prove.check.equilibrium import Equilibrium
from hfa_prove.enclosure.slopes import Intervals, jacobian
from hfa_prove.statements.loop import Loop

#: A slope changes at the equilibrium where it varies by more than this part of the largest, in
#: nominal values.
_CHANGE = 1e-5


def kink_at(loop: Loop, equilibrium: Equilibrium) -> str:
    """Return a sentence on the largest kink of the rates at the equilibrium, or "".

    The sentence names the rate, the signal in which the slope of the rate jumps, and the value of
    the signal. The result is "" if the rates have no kink.
    """
    slopes = jacobian(loop.program, Intervals(equilibrium.x, equilibrium.radius)).slopes
    sizes = loop.nominal / loop.nominal[:, None]
    changes = slopes.radius * sizes
    if not np.max(changes) > _CHANGE * np.max(np.abs(slopes.middle) * sizes):
        return ""
    row, column = np.unravel_index(np.argmax(changes), changes.shape)
    signal = loop.states[column]
    at = loop.model.describe(signal, round(float(equilibrium.x[column]), 12))
    return f"the rate of {loop.states[row]} has a kink in {signal} at the equilibrium, {at}"
