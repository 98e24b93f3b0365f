"""Speed and flow angles relative to the air across the path, as a Kalman filter sees them."""

from __future__ import annotations

from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from hfa_flight.air.gust_equations import relative_to_crossing_air
from hfa_flight.air.names import state_of


class AddedSpeed(NamedTuple):
    """What winds across the path add to the speed over the ground beyond the linear model: w²/2V in
    level flight.

    of: CasADi function (deviations of the linear states (k,), winds (w,)) -> added speed
    row: number of the speed among the linear states
    needed: numbers of the linear states on which it depends
    """

    of: ca.Function
    row: int
    needed: tuple[int, ...]


def seen_from_air(known: Any, z: ca.SX, winds: ca.SX) -> ca.SX:
    """Return deviations of linear states with speed and flow angles relative to the air across the
    path, (k,).

    z: deviations over the ground, (k,)
    winds: (w,)
    """
    model, trim = known.point.model, known.point.states._asdict()
    values = {name: ca.SX(value) for name, value in trim.items()}
    deviations = dict(zip(known.states, ca.vertsplit(z), strict=True))
    values |= {name: trim[name] + each for name, each in deviations.items()}
    named = dict(zip(known.winds, ca.vertsplit(winds), strict=True)) if known.winds else {}
    relative = relative_to_crossing_air(model, values, named)
    seen = {name: relative[name] - trim[name] for name in relative if name in deviations}
    every: list[ca.SX] = [*(deviations | seen).values()]
    return ca.vertcat(*every)


def added_speed(known: Any) -> AddedSpeed | None:
    """Return what winds add to the speed, or None if they add nothing or sensors do not show it."""
    speed = state_of(known.point.model, "speed")
    if speed not in known.states:
        return None
    row = known.states.index(speed)
    z, w = ca.SX.sym("z", len(known.states)), ca.SX.sym("w", len(known.winds))
    added = (z - seen_from_air(known, z, w))[row]
    slopes = ca.Function("slopes", [z, w], [ca.jacobian(added, w)])
    beyond = added - ca.mtimes(slopes(0.0, 0.0), w)
    needed = tuple(np.flatnonzero(ca.which_depends(beyond, z, 1, False)).tolist())
    if not needed or not {known.states[each] for each in needed} <= set(known.sensors):
        return None
    return AddedSpeed(ca.Function("added", [z, w], [beyond]), row, needed)
