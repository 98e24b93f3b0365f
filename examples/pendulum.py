"""Small loops whose region of attraction is known or can be drawn: m, kg, s, N m.

    hfa prove region --aircraft examples/pendulum.py:PENDULUM -o pendulum.json --picture
    pendulum.png
    hfa prove region --aircraft examples/pendulum.py:PENDULUM --check pendulum.json
    hfa prove region --aircraft examples/pendulum.py:VAN_DER_POL --degree 6

The pendulum is inverted; its torque cannot lift it from the horizontal. The oscillator of van der
Pol runs backward: inside its limit cycle all trajectories converge to 0. The star has a
linearization of 0, which is refused by name."""

import casadi as ca

from hfa import Model, Signal

MASS, LENGTH, DAMPING, GRAVITY = 0.15, 0.5, 0.1, 9.81


def pendulum(x, u, p, w):
    """m l² angle'' = torque + push + m g l sin(angle) - b angle'."""
    moment = u.torque + w.push + MASS * GRAVITY * LENGTH * ca.sin(x.angle) - DAMPING * x.rate
    return {"angle": x.rate, "rate": moment / (MASS * LENGTH**2)}, {}


def van_der_pol(x, u, p, w):
    """x'' = -x - (1 - x²) x', time reversed, and a push."""
    velocity = x.position - (1 - x.position**2) * x.velocity + w.push
    return {"position": -x.velocity, "velocity": velocity}, {}


def star(x, u, p, w):
    """x' = -x³."""
    return {"position": -(x.position**3)}, {}


PENDULUM = Model(
    "pendulum",
    {"angle": Signal("rad"), "rate": Signal("rad/s")},
    {"torque": Signal("N m", 1.0, -0.7, 0.7)},
    pendulum,
    disturbances={"push": Signal("N m", 0.1)},
    trim={"angle": 0.0, "rate": 0.0},
)
VAN_DER_POL = Model(
    "van der Pol",
    {"position": Signal(), "velocity": Signal()},
    {},
    van_der_pol,
    disturbances={"push": Signal()},
    trim={},
)
STAR = Model("star", {"position": Signal()}, {}, star)
