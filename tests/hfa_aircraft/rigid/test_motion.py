"""Newton's and Euler's laws, the standard atmosphere, and the pressure in a pitot tube."""

from collections import namedtuple

import casadi as ca
import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from standard_airspeeds import air

from hfa_aircraft.rigid.aircraft import STATES, Motion, inertia_matrix, rotation, wind_axes
from hfa_aircraft.rigid.atmosphere import air_at, mach_of_impact, pitot_pressure

State = namedtuple("State", STATES)
INERTIA = np.array([[2.0, -0.3, 0.2], [-0.3, 3.0, -0.1], [0.2, -0.1, 4.0]])


@pytest.mark.parametrize("seed", range(3))
def test_rates_of_a_motion_obey_newton_and_euler(seed):
    """Over the ground, the velocity changes by force and gravity, the angular momentum by the moment, and
    the attitude by the angular velocity; the altitude changes by the velocity.
    """
    random = np.random.default_rng(seed)
    x = np.array([30.0, *random.uniform(-0.6, 0.6, 8), 1000.0])
    force, moment = random.normal(size=(2, 3))
    inertia = inertia_matrix(np.diag(INERTIA), -INERTIA[[0, 2, 1], [1, 0, 2]])
    motion = Motion(State(*x), 9.8, "si", 0.0)
    found, outputs = motion.rates_and_outputs(ca.DM(force), ca.DM(moment), inertia)
    rates = np.array([float(found[name]) for name in STATES])

    def over_ground(at):
        """Return velocity, angular momentum and the axes of the body, north, east and down, (3, 5)."""
        s = State(*at)
        axes = Rotation.from_euler("ZYX", [s.yaw, s.pitch, s.roll]).as_matrix()
        through = [
            np.cos(s.alpha) * np.cos(s.beta),
            np.sin(s.beta),
            np.sin(s.alpha) * np.cos(s.beta),
        ]
        return axes @ np.column_stack([np.multiply(s.speed, through), INERTIA @ at[3:6], np.eye(3)])

    now, step = over_ground(x), 1e-5
    np.testing.assert_allclose(rotation(*x[6:9]).full(), now[:, 2:], atol=1e-12)
    through_air = wind_axes(*x[1:3]).full()
    np.testing.assert_allclose(through_air.T @ through_air, np.eye(3), atol=1e-12)
    assert through_air[1, 2] == 0.0  # the third axis is in the plane of symmetry, downward
    assert np.linalg.det(through_air) > 0.0
    change = (over_ground(x + step * rates) - over_ground(x - step * rates)) / (2.0 * step)
    axes = now[:, 2:]
    np.testing.assert_allclose(change[:, 0], axes @ force + [0.0, 0.0, 9.8], rtol=1e-6)
    np.testing.assert_allclose(change[:, 1], axes @ moment, atol=1e-7)
    turned = axes @ np.cross(x[3:6], np.eye(3), axisb=0, axisc=0)
    np.testing.assert_allclose(change[:, 2:], turned, atol=1e-8)
    assert rates[-1] == pytest.approx(-now[2, 0])
    assert float(outputs["gamma"]) == pytest.approx(np.arcsin(-now[2, 0] / 30.0))
    lift = force @ [np.sin(x[1]), 0.0, -np.cos(x[1])]
    assert float(outputs["load_factor"]) == pytest.approx(lift / 9.8)
    assert float(outputs["turn_rate"]) == rates[STATES.index("yaw")]


@pytest.mark.parametrize("altitude", [0.0, 3e3, 15e3, 25e3])
def test_air_is_that_of_the_standard_atmosphere(altitude):
    """Density, speed of sound and pressure, also of air that is 15 K warmer, are those of `ambiance`."""
    for warmer in (0.0, 15.0):
        ours, theirs = air_at(altitude, "si", warmer), air(altitude, warmer)
        found = [float(each) for each in (ours.density, ours.sound, ours.pressure)]
        assert found == pytest.approx(theirs, rel=1e-4)


@pytest.mark.parametrize("mach", [0.3, 0.99, 1.01, 2.5])
def test_the_impact_pressure_gives_the_mach_number(mach):
    """The Mach number of the pressure behind the normal shock in front of a pitot tube is that of the flow.

    Behind the shock, the flow is isentropic; the shock obeys the conservation of mass, momentum and energy.
    """
    total = float(pitot_pressure(mach, 1.0))
    behind, pressure = mach, 1.0
    if mach > 1.0:
        behind = np.sqrt((mach**2 + 5.0) / (7.0 * mach**2 - 1.0))
        pressure = (7.0 * mach**2 - 1.0) / 6.0
    assert total == pytest.approx(pressure * (1.0 + 0.2 * behind**2) ** 3.5, rel=1e-12)
    assert float(mach_of_impact(ca.DM(total - 1.0), 1.0)) == pytest.approx(mach, rel=1e-4)
