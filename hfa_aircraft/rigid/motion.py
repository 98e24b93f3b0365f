"""Equations of motion of a rigid aircraft over a flat Earth.

Body axes point forward, right and down. Arguments are numbers or CasADi expressions in one
consistent system of units (ft, slug, lbf or m, kg, N). An argument x has the fields of `STATES`.
Source: B. L. Stevens, F. L. Lewis, E. N. Johnson, *Aircraft Control and Simulation*, 3rd ed., 2016,
Section 1.7.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import casadi as ca
import numpy as np

#: Relative rounding of tabulated inertias.
_ROUNDING = 1e-3
#: Speed, angle of attack and sideslip relative to the air; body-axis angular rates; Euler angles;
#: altitude.
STATES = (
    *("speed", "alpha", "beta", "roll_rate", "pitch_rate", "yaw_rate"),
    *("roll", "pitch", "yaw", "altitude"),
)


def rotation(roll: Any, pitch: Any, yaw: Any) -> Any:
    """Return the matrix (3, 3) from rotated axes to reference axes.

    The axes are rotated by yaw, pitch and roll, rad, in this order. For the Euler angles of an
    aircraft, the matrix converts body-axis components to components north, east and down.
    """
    cos_roll = ca.cos(roll)
    sin_roll = ca.sin(roll)
    cos_pitch = ca.cos(pitch)
    sin_pitch = ca.sin(pitch)
    cos_yaw = ca.cos(yaw)
    sin_yaw = ca.sin(yaw)
    first = ca.vertcat(cos_pitch * cos_yaw, cos_pitch * sin_yaw, -sin_pitch)
    second = ca.vertcat(
        sin_roll * sin_pitch * cos_yaw - cos_roll * sin_yaw,
        sin_roll * sin_pitch * sin_yaw + cos_roll * cos_yaw,
        sin_roll * cos_pitch,
    )
    third = ca.vertcat(
        cos_roll * cos_yaw * sin_pitch + sin_roll * sin_yaw,
        cos_roll * sin_yaw * sin_pitch - sin_roll * cos_yaw,
        cos_roll * cos_pitch,
    )
    return ca.horzcat(first, second, third)


def wind_axes(alpha: Any, beta: Any) -> Any:
    """Return the matrix (3, 3) from wind axes to body axes.

    The first column is the direction of the velocity relative to the air.

    alpha, beta: angle of attack and sideslip, rad
    """
    cos_alpha = ca.cos(alpha)
    sin_alpha = ca.sin(alpha)
    cos_beta = ca.cos(beta)
    sin_beta = ca.sin(beta)
    return ca.vertcat(
        ca.horzcat(cos_alpha * cos_beta, -cos_alpha * sin_beta, -sin_alpha),
        ca.horzcat(sin_beta, cos_beta, 0.0),
        ca.horzcat(sin_alpha * cos_beta, -sin_alpha * sin_beta, cos_alpha),
    )


def angular_velocity(x: Any) -> Any:
    """Return the angular velocity of a state in body axes, (3,), rad/s."""
    return ca.vertcat(x.roll_rate, x.pitch_rate, x.yaw_rate)


def acceleration(velocity: Any, rates: Any, specific_force: Any, gravity: Any) -> Any:
    """Return v' = f + g - ω × v, the rate of the body-axis velocity, (3,).

    All vectors are in body axes.

    velocity: velocity v, (3,)
    rates: angular velocity ω, (3,), rad/s
    specific_force: force without weight, divided by mass, f, (3,)
    gravity: acceleration of gravity g, (3,)
    """
    return specific_force + gravity - ca.cross(rates, velocity)


def angular_acceleration(rates: Any, moment: Any, inertia: Any) -> Any:
    """Return the angular acceleration ω' = I⁻¹ (M - ω × I ω) in body axes, (3,), rad/s².

    rates: angular velocity ω, (3,), rad/s
    moment: moment M about the center of gravity, (3,)
    inertia: symmetric inertia matrix I, (3, 3)
    """
    spin = ca.cross(rates, ca.mtimes(inertia, rates))
    return ca.mtimes(_inverse(inertia), moment - spin)


def inertia_matrix(moments: Sequence[Any], products: Sequence[Any]) -> Any:
    """Return the inertia matrix (3, 3) in body axes.

    moments: moments of inertia xx, yy, zz
    products: products of inertia xy, zx, yz, with xy = ∫ x y dm
    """
    xx, yy, zz = moments
    xy, zx, yz = products
    return ca.vertcat(ca.horzcat(xx, -xy, -zx), ca.horzcat(-xy, yy, -yz), ca.horzcat(-zx, -yz, zz))


def inertia_doubt(inertia: Any) -> str:
    """Return a sentence if no rigid body has this inertia matrix (3, 3) of numbers, or "".

    Principal moments are positive, and the largest is at most the sum of the others.
    """
    least, middle, most = np.linalg.eigvalsh(np.asarray(inertia, dtype=float).reshape(3, 3))
    if least <= 0.0:
        return "a principal moment of inertia is not positive; no body has these inertias"
    if most > (least + middle) * (1.0 + _ROUNDING):
        return (
            f"a principal moment of inertia is {most / (least + middle):.4g} times the sum of the "
            "others; no rigid body has these inertias"
        )
    return ""


def flow_rates(velocity: Any, acceleration: Any) -> tuple[Any, Any, Any]:
    """Return the rate of the speed, and the rates of alpha and beta, rad/s.

    velocity: velocity relative to the air in body axes, (3,)
    acceleration: rate of this velocity in body axes, (3,)
    """
    u, v, w = ca.vertsplit(velocity)
    in_plane = u**2 + w**2
    speed = ca.sqrt(in_plane + v**2)
    speed_rate = ca.dot(velocity, acceleration) / speed
    alpha_rate = (u * acceleration[2] - w * acceleration[0]) / in_plane
    beta_rate = (speed * acceleration[1] - v * speed_rate) / (speed * ca.sqrt(in_plane))
    return speed_rate, alpha_rate, beta_rate


def load_factor(alpha: Any, specific_force: Any, gravity: Any) -> Any:
    """Return the load factor n = (f_x sin α - f_z cos α)/g, normal to the flight path.

    It is cos γ in steady wings-level flight, and 1/cos φ in a level turn with bank φ.

    alpha: angle of attack, rad
    specific_force: force without weight, divided by mass, f, in body axes, (3,)
    gravity: acceleration of gravity g
    """
    along, _, down = (specific_force[i] for i in range(3))
    return (along * ca.sin(alpha) - down * ca.cos(alpha)) / gravity


def turn_rate(x: Any) -> Any:
    """Return the rate of the yaw angle at a state, rad/s."""
    return (x.pitch_rate * ca.sin(x.roll) + x.yaw_rate * ca.cos(x.roll)) / ca.cos(x.pitch)


def state_rates(
    x: Any, velocity: Any, velocity_rate: Any, rotation_rate: Any, climb: Any
) -> dict[str, Any]:
    """Return name -> rate of each state in `STATES`.

    x: state
    velocity: velocity relative to the air, in body axes, (3,)
    velocity_rate: rate of `velocity` (`acceleration`), (3,)
    rotation_rate: rate of the angular velocity (`angular_acceleration`), (3,)
    climb: rate of the altitude
    """
    speed_rate, alpha_rate, beta_rate = flow_rates(velocity, velocity_rate)
    turning = turn_rate(x)
    return {
        "speed": speed_rate,
        "alpha": alpha_rate,
        "beta": beta_rate,
        "roll_rate": rotation_rate[0],
        "pitch_rate": rotation_rate[1],
        "yaw_rate": rotation_rate[2],
        "roll": x.roll_rate + ca.sin(x.pitch) * turning,
        "pitch": x.pitch_rate * ca.cos(x.roll) - x.yaw_rate * ca.sin(x.roll),
        "yaw": turning,
        "altitude": climb,
    }


def _inverse(matrix: Any) -> Any:
    """Return the inverse of a symmetric (3, 3) matrix."""
    rows = ca.horzsplit(matrix)
    cofactors = [ca.cross(rows[(i + 1) % 3], rows[(i + 2) % 3]) for i in range(3)]
    return ca.horzcat(*cofactors).T / ca.dot(rows[0], cofactors[0])
