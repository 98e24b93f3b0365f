"""An independent model of three panels in space, for comparison with the equations of motion.

The aircraft with locked hinges is a rigid body, and symmetric conditions keep the body in its
plane. Only the loads of one panel are computed by the product.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import pytest
from random_points import RATE_SCALES, random_points, rates

from hfa_model import VARIANTS, Input, Parameters, State
from hfa_model.aerodynamics import panel_loads
from hfa_model.atmosphere import density
from hfa_model.kinematics import DISTURBANCES, Winds, flow_of, winds_named

SIDES = (0, 1, -1)


class Body(NamedTuple):
    """Force (lbf) without weight, moment (ft lbf) and inertia (slug ft^2) of the aircraft.

    The axes are the body axes in the center of mass.
    """

    force: np.ndarray
    moment: np.ndarray
    inertia: np.ndarray


def three_panels(
    x: State, u: Input, p: Parameters, winds: Winds, more_aileron_right: float = 0.0
) -> Body:
    """Return the force, moment and inertia of the aircraft, summed over its three panels.

    more_aileron_right: additional aileron deflection of the right panel, rad
    """
    center = np.array([0.0, 0.0, p.panel_span / 3 * np.sin(x.dihedral)])
    sinking = np.array([0.0, 0.0, p.panel_span / 3 * np.cos(x.dihedral) * x.dihedral_rate])
    path = x.speed * np.array([np.cos(x.alpha), 0.0, np.sin(x.alpha)])
    spin = np.array([0.0, x.pitch_rate, 0.0])
    to_body = np.array(
        [[np.cos(x.pitch), 0, -np.sin(x.pitch)], [0, 1, 0], [np.sin(x.pitch), 0, np.cos(x.pitch)]]
    )
    force = np.zeros(3)
    moment = np.zeros(3)
    inertia = np.zeros((3, 3))
    for side in SIDES:
        roll = -side * x.dihedral
        axes = np.array(
            [[1, 0, 0], [0, np.cos(roll), -np.sin(roll)], [0, np.sin(roll), np.cos(roll)]]
        )
        arm = side * p.panel_span / 2
        center_outer = center + [0.0, arm, 0.0] + axes @ [0.0, arm, 0.0]
        swing = np.cross([-side * x.dihedral_rate, 0.0, 0.0], axes @ [0.0, arm, 0.0])
        wind = winds.outer if side else winds.center
        air = to_body @ [-wind.headwind, side * wind.outward, -wind.updraft]
        flow = axes.T @ (path + np.cross(spin, center_outer) + sinking + swing - air)
        aileron = (u.aileron_outer if side else u.aileron_center) + (
            more_aileron_right if side == 1 else 0.0
        )
        elevator = u.elevator_outer if side else u.elevator_center
        loads = panel_loads(
            flow_of(*flow), np.linalg.norm(path - air), aileron, elevator, density(x.altitude), p
        )
        tail = np.array([0.0, 0.0, float(loads.tail_downward)])
        thrust = p.thrust_per_throttle * u.throttle / 3
        whole = np.array(
            [float(loads.forward) + thrust, float(loads.sideward), float(loads.downward)]
        )
        force += axes @ whole
        moment += np.cross(center_outer, axes @ whole) + axes @ [0.0, float(loads.moment), 0.0]
        moment += np.cross(axes @ [-p.boom_length, 0.0, 0.0], axes @ tail)
        inertia += axes @ np.diag([p.inertia_roll, p.inertia_pitch, p.inertia_yaw]) @ axes.T
        inertia += p.panel_mass * (
            center_outer @ center_outer * np.eye(3) - np.outer(center_outer, center_outer)
        )
    return Body(force, moment, inertia)


def rigid_rates(x: State, body: Body, p: Parameters) -> np.ndarray:
    """Return V', α' and q' of a rigid body in its plane, by Newton's and Euler's laws."""
    weight = p.gravity * np.array([-np.sin(x.pitch), 0.0, np.cos(x.pitch)])
    acceleration = body.force / (3 * p.panel_mass) + weight
    along = np.array([np.cos(x.alpha), 0, np.sin(x.alpha)])
    down = np.array([-np.sin(x.alpha), 0, np.cos(x.alpha)])
    pitching = np.linalg.solve(body.inertia, body.moment)[1]
    return np.array([acceleration @ along, x.pitch_rate + acceleration @ down / x.speed, pitching])


def cases(change: Callable[[State], State]) -> list[tuple[State, Input, Winds]]:
    rng = np.random.default_rng(8)
    air = [
        winds_named(tuple(DISTURBANCES), rng.uniform(-15.0, 15.0, len(DISTURBANCES)).tolist())
        for _ in range(100)
    ]
    computed = zip(*random_points(100, seed=8), air, strict=True)
    return [(change(State(*x.tolist())), Input(*u.tolist()), winds) for x, u, winds in computed]


def differences(p: Parameters, dynamics: str, change: Callable[[State], State]) -> np.ndarray:
    """Return the largest errors of V', α', q' compared with the rigid body, (3,).

    Each error is divided by the rate or, near zero, by the scale of the rate.

    change: function that is applied to each random state
    """
    worst = np.zeros(3)
    scales = np.array([RATE_SCALES.speed, RATE_SCALES.alpha, RATE_SCALES.pitch_rate])
    for x, u, winds in cases(change):
        computed = rates(x, u, p, VARIANTS[dynamics], winds)
        expected = rigid_rates(x, three_panels(x, u, p, winds), p)
        error = np.abs(
            np.array([computed.speed, computed.alpha, computed.pitch_rate], float) - expected
        )
        worst = np.maximum(worst, error / np.maximum(np.abs(expected), scales))
    return worst


@pytest.mark.parametrize(
    "dihedral", [0.0, 0.2, -0.7, np.pi / 2], ids=lambda angle: f"{np.degrees(angle):.0f}deg"
)
def test_locked_hinges_give_the_rigid_aircraft(parameters: Parameters, dihedral: float) -> None:
    """With locked hinges, V', α' and q' of "newton" equal the rates of a rigid body.

    The rates of "published" differ from the rates of the rigid body.
    """

    def locked(x: State) -> State:
        return x._replace(dihedral=dihedral, dihedral_rate=0.0)

    assert differences(parameters, "newton", locked).max() <= 1e-12
    # The lever arm of the outer panels and the projection of their moments differ from a rigid
    # body's.
    assert differences(parameters, "published", locked).max() > 1e-2


def test_moving_hinges_move_only_the_mass_center(
    parameters: Parameters,
) -> None:
    """With moving hinges, V' and α' of "newton" equal the rates of the rigid body, but q' does not."""
    speed, alpha, pitch_rate = differences(parameters, "newton", lambda x: x)
    assert max(speed, alpha) <= 1e-12
    assert pitch_rate > 1e-3
