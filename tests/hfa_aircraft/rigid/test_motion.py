"""Equations of motion of a rigid body compared with conservation laws."""

from types import SimpleNamespace

import casadi as ca
import numpy as np
import pytest

from hfa_aircraft.rigid.motion import (
    STATES,
    acceleration,
    angular_acceleration,
    angular_velocity,
    rotation,
    state_rates,
    wind_axes,
)

INERTIA = np.array([[9.0, 0.0, -1.0], [0.0, 30.0, 0.0], [-1.0, 0.0, 35.0]])
VALUES = dict(zip(STATES, (50.0, 0.1, -0.2, 0.3, -0.4, 0.5, 0.6, -0.7, 0.8, 1000.0), strict=True))


def derivative_along_motion(quantity, force, moment):
    """Return the time derivative of a quantity during the motion, at the state VALUES.

    quantity: function of (state, velocity)
    force: (3,), force per mass in body axes
    moment: (3,), in body axes
    """
    symbols = {name: ca.SX.sym(name) for name in STATES}
    x = SimpleNamespace(**symbols)
    velocity = x.speed * wind_axes(x.alpha, x.beta)[:, 0]
    velocity_rate = acceleration(velocity, angular_velocity(x), force, ca.SX.zeros(3))
    rotation_rate = angular_acceleration(angular_velocity(x), moment, ca.DM(INERTIA))
    climb = -(rotation(x.roll, x.pitch, x.yaw) @ velocity)[2]
    rates = state_rates(x, velocity, velocity_rate, rotation_rate, climb)
    value = quantity(x, velocity)
    columns = [ca.vertcat(*symbols.values()), ca.vertcat(*(rates[name] for name in STATES))]
    rate = ca.jtimes(value, *columns)
    found = ca.Function("rate", columns[:1], [rate])(ca.DM(list(VALUES.values())))
    return found.full().ravel()


def test_without_force_the_ground_velocity_is_constant():
    """Without a force, the velocity over ground is constant."""

    def over_ground(x, velocity):
        return rotation(x.roll, x.pitch, x.yaw) @ velocity

    rate = derivative_along_motion(over_ground, ca.SX.zeros(3), ca.DM([1.0, 2.0, 3.0]))
    np.testing.assert_allclose(rate, 0.0, atol=1e-13)


def test_without_moment_angular_momentum_is_constant():
    """Without a moment, the angular momentum is constant."""

    def momentum(x, velocity):
        return rotation(x.roll, x.pitch, x.yaw) @ (ca.DM(INERTIA) @ angular_velocity(x))

    rate = derivative_along_motion(momentum, ca.DM([1.0, 2.0, 3.0]), ca.SX.zeros(3))
    np.testing.assert_allclose(rate, 0.0, atol=1e-13)


def test_rotational_power_equals_the_moments_power():
    """The rate of the rotational energy equals the power of the moment, M · ω."""
    moment = np.array([1.0, -2.0, 3.0])

    def energy(x, velocity):
        rates = angular_velocity(x)
        return 0.5 * ca.dot(rates, ca.DM(INERTIA) @ rates)

    rate = derivative_along_motion(energy, ca.SX.zeros(3), ca.DM(moment))
    rates = [VALUES[f"{axis}_rate"] for axis in ("roll", "pitch", "yaw")]
    assert rate[0] == pytest.approx(moment @ rates, rel=1e-13)
