"""Small systems whose regions of attraction are known or easy to draw. Units: m, kg, s, N m.

    hfa prove region --aircraft examples/pendulum.py:PENDULUM -o pendulum.json
    hfa prove --aircraft examples/pendulum.py:PENDULUM --check pendulum.json
    hfa prove region --aircraft examples/pendulum.py:VAN_DER_POL --degree 6

The pendulum is inverted, and the torque limit is too low to lift the pendulum from the horizontal.
The van der Pol oscillator is simulated in reversed time, so all trajectories inside its limit cycle
converge to 0. The system STAR has a zero linearization and is therefore refused.
"""

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


def van_der_pol(x, u, p, w):
    """Return the state derivatives and the outputs of the van der Pol oscillator in reversed time.

    x'' = -x - (1 - x²) x', with a disturbance
    """
    velocity_rate = x.position - (1 - x.position**2) * x.velocity + w.push
    rates = {"position": -x.velocity, "velocity": velocity_rate}
    return rates, {}


def star(x, u, p, w):
    """Return the state derivatives and the outputs of x' = -x³."""
    return {"position": -(x.position**3)}, {}


PENDULUM = Model(
    name="pendulum",
    states={"angle": Signal("rad"), "rate": Signal("rad/s")},
    inputs={"torque": Signal("N m", nominal=1.0, min=-0.7, max=0.7)},
    disturbances={"push": Signal("N m", nominal=0.1)},
    equations=pendulum,
    trim={"angle": 0.0, "rate": 0.0},
)
VAN_DER_POL = Model(
    name="van der Pol",
    states={"position": Signal(), "velocity": Signal()},
    inputs={},
    disturbances={"push": Signal()},
    equations=van_der_pol,
    trim={},
)
STAR = Model(name="star", states={"position": Signal()}, inputs={}, equations=star)
