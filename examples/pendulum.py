"""The inverted pendulum. Units: m, kg, s, N m.

    hfa solve --aircraft examples/pendulum.py:PENDULUM --order 3 --Q 1,1 --R 1

The torque limit is too low to lift the pendulum from the horizontal.
"""

from dataclasses import replace

import casadi as ca

from hfa import Model, Signal

MASS = 0.15  # kg
LENGTH = 0.5  # m
DAMPING = 0.1  # N m s
GRAVITY = 9.81  # m/s^2


def pendulum(x, u, p, w):
    """Return the state derivatives and the outputs of the inverted pendulum.

    m l² angle'' = torque + push + m g l sin(angle) - b angle', with mass m, length l and damping b
    """
    moment = u.torque + w.push + MASS * GRAVITY * LENGTH * ca.sin(x.angle) - DAMPING * x.rate
    rates = {"angle": x.rate, "rate": moment / (MASS * LENGTH**2)}
    return rates, {}


PENDULUM = Model(
    name="pendulum",
    states={"angle": Signal("rad"), "rate": Signal("rad/s")},
    inputs={"torque": Signal("N m", nominal=1.0, min=-0.7, max=0.7)},
    disturbances={"push": Signal("N m", nominal=0.1)},
    equations=pendulum,
    trim={"angle": 0.0, "rate": 0.0},
)

#: Near the upright position, as the policies in pendulum_policies/ hold it.
UPRIGHT = replace(
    PENDULUM,
    name="upright pendulum",
    states={
        "angle": Signal("rad", nominal=0.1, min=-0.3, max=0.3),
        "rate": Signal("rad/s", nominal=0.5, min=-1.0, max=1.0),
    },
)
