"""Speed and flow angles relative to the air across the path, as a Kalman filter sees them."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import casadi as ca
import numpy as np

from hfa_flight.air.gust_equations import relative_to_crossing_air
from hfa_flight.air.names import state_of

if TYPE_CHECKING:
    from hfa_flight.policies.kalman import KalmanFilter


class AddedSpeed(NamedTuple):
    """Part of the speed over the ground that is quadratic in the winds across the path, which a
    linear model lacks: w²/2V in level flight.

    of: CasADi function (deviations of the linear states (k,), winds (w,)) -> added speed
    row: number of the speed among the linear states
    needed: numbers of the linear states on which it depends
    """

    of: ca.Function
    row: int
    needed: tuple[int, ...]


def seen_from_air(known: KalmanFilter, z: ca.SX, winds: ca.SX) -> ca.SX:
    """Return the deviations z of the linear states, (k,), of which those of the speed and of the
    flow angles are made relative to the air across the path.

    known: filter with the trim, and with the names of the states and winds
    z: deviations over the ground, (k,)
    winds: (w,)
    """
    model, trim = known.point.model, known.point.states._asdict()
    deviations = dict(zip(known.states, ca.vertsplit(z), strict=True))
    over_ground = {name: trim[name] + deviations.get(name, ca.SX(0.0)) for name in trim}
    wind_of = dict(zip(known.winds, ca.vertsplit(winds), strict=True)) if known.winds else {}
    in_air = relative_to_crossing_air(model, over_ground, wind_of)
    deviations |= {name: in_air[name] - trim[name] for name in in_air if name in deviations}
    return ca.vertcat(*deviations.values())


def added_speed(known: KalmanFilter) -> AddedSpeed | None:
    """Return the speed that winds add, or None without winds, without a speed as a linear state, or
    if the sensors do not measure a state on which it depends.
    """
    speed = state_of(known.point.model, "speed")
    if speed not in known.states:
        return None
    row = known.states.index(speed)
    z, w = ca.SX.sym("z", len(known.states)), ca.SX.sym("w", len(known.winds))
    added = (z - seen_from_air(known, z, w))[row]
    slopes = ca.Function("slopes", [z, w], [ca.jacobian(added, w)])
    beyond_linear = added - ca.mtimes(slopes(0.0, 0.0), w)
    needed = tuple(np.flatnonzero(ca.which_depends(beyond_linear, z, 1, False)).tolist())
    if not needed or not {known.states[state] for state in needed} <= set(known.sensors):
        return None
    return AddedSpeed(ca.Function("added", [z, w], [beyond_linear]), row, needed)
