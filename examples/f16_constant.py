"""The longitudinal F-16 with constant derivatives, without tables or kinks.

Units: ft, slug, rad. The elevator is in degrees. The derivatives are computed from the tables in
examples/f16.py (Stevens and Lewis) at 502 ft/s and sea level, with the center of gravity at 0.35.
They are secants from 0 to 5 deg of angle of attack and from -12 to 0 deg of elevator. The rate
derivatives are those at the trim's 2.1 deg. Thrust is an input, up to the military thrust at that
speed.

    hfa prove region --aircraft examples/f16_constant.py:F16 --delta inf --degree 2 -o f16.json
"""

import casadi as ca

from hfa import Model, Signal

AREA = 300.0  # ft^2
CHORD = 11.32  # ft
GRAVITY = 32.17  # ft/s^2
MASS = 1 / 1.57e-3  # slug
DENSITY = 2.377e-3  # slug/ft^3
INERTIA = 55814.0  # slug ft^2, pitch
DEGREES = 57.29578  # degrees per radian


def equations(x, u, p, w):
    """Return the state derivatives and the outputs.

    The force and moment coefficients are linear in body axes.
    """
    alpha = DEGREES * x.alpha
    pitch_rate = CHORD * x.pitch_rate / (2 * x.speed)
    c_x = -0.021 + 0.0034 * alpha + 0.0015 * u.elevator + 0.745 * pitch_rate
    c_z = -0.100 - 0.0632 * alpha - 0.0076 * u.elevator - 29.96 * pitch_rate
    c_m = -0.009 + 0.0008 * alpha - 0.00963 * u.elevator - 5.243 * pitch_rate
    pressure_area = DENSITY * x.speed**2 / 2 * AREA
    forward = (pressure_area * c_x + u.thrust) / MASS - GRAVITY * ca.sin(x.pitch)
    downward = pressure_area * c_z / MASS + GRAVITY * ca.cos(x.pitch)
    cos_alpha = ca.cos(x.alpha)
    sin_alpha = ca.sin(x.alpha)
    rates = {
        "speed": forward * cos_alpha + downward * sin_alpha,
        "alpha": x.pitch_rate + (downward * cos_alpha - forward * sin_alpha) / x.speed,
        "pitch": x.pitch_rate,
        "pitch_rate": pressure_area * CHORD * c_m / INERTIA,
    }
    return rates, {"gamma": x.pitch - x.alpha}


F16 = Model(
    name="F-16 with constant derivatives",
    states={
        "speed": Signal("ft/s", nominal=500.0, min=100.0, max=1000.0, start=500.0),
        "alpha": Signal("rad", nominal=0.1, min=-0.17, max=0.80, start=0.05),
        "pitch": Signal("rad", nominal=0.1, min=-1.55, max=1.55),
        "pitch_rate": Signal("rad/s", nominal=0.1),
    },
    inputs={
        "thrust": Signal("lbf", nominal=1000.0, min=0.0, max=12600.0, start=2000.0),
        "elevator": Signal("deg", nominal=5.0, min=-25.0, max=25.0),
    },
    outputs={"gamma": Signal("rad", nominal=0.1)},
    equations=equations,
    trim={"speed": 502.0, "gamma": 0.0, "pitch_rate": 0.0},
    schedule="speed",
    modes={"short period": ("alpha", "pitch_rate"), "phugoid": ("speed", "pitch")},
)
