"""Speed and flow angles relative to the air across the path, as a Kalman filter sees them."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from typing import NamedTuple

import casadi as ca
import numpy as np

from hfa_flight.air.gust_equations import relative_to_crossing_air
from hfa_flight.air.names import state_of
from trim.point.operating_point import OperatingPoint


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


def seen_from_air(
    point: OperatingPoint, states: Sequence[str], winds: Sequence[str], z: ca.SX, w: ca.SX
) -> ca.SX:
    """Return the deviations z of the linear states, (k,), of which those of the speed and of the
    flow angles are made relative to the air across the path.

    point: the trim
    states: names of the linear states
    winds: names of the disturbances that are winds
    z: deviations over the ground, (k,)
    w: the winds
    """
    model, trim = point.model, point.states._asdict()
    deviations = dict(zip(states, ca.vertsplit(z), strict=True))
    over_ground = {name: trim[name] + deviations.get(name, ca.SX(0.0)) for name in trim}
    wind_of = dict(zip(winds, ca.vertsplit(w), strict=True)) if winds else {}
    in_air = relative_to_crossing_air(model, over_ground, wind_of)
    deviations |= {name: in_air[name] - trim[name] for name in in_air if name in deviations}
    return ca.vertcat(*deviations.values())


def added_speed(
    point: OperatingPoint, states: Sequence[str], winds: Sequence[str], sensors: Collection[str]
) -> AddedSpeed | None:
    """Return the speed that winds add, or None without winds, without a speed as a linear state, or
    if the sensors do not measure a state on which it depends.

    point, states, winds: as for `seen_from_air`
    sensors: names of the measured states
    """
    speed = state_of(point.model, "speed")
    if speed not in states:
        return None
    row = states.index(speed)
    z, w = ca.SX.sym("z", len(states)), ca.SX.sym("w", len(winds))
    added = (z - seen_from_air(point, states, winds, z, w))[row]
    slopes = ca.Function("slopes", [z, w], [ca.jacobian(added, w)])
    beyond_linear = added - ca.mtimes(slopes(0.0, 0.0), w)
    needed = tuple(np.flatnonzero(ca.which_depends(beyond_linear, z, 1, False)).tolist())
    if not needed or not {states[number] for number in needed} <= set(sensors):
        return None
    return AddedSpeed(ca.Function("added", [z, w], [beyond_linear]), row, needed)
