"""The longitudinal F-16 with constant derivatives, without tables or kinks; ft, slug, rad, the elevator in degrees.

The tables of examples/f16.py (Stevens and Lewis) between 0 and 5 deg of angle of attack and -12 and 0 deg of elevator,
at 502 ft/s and sea level, center of gravity at 0.35; rate terms at the trim's 2.1 deg. Thrust is an input, up to
military at that speed.

    hfa prove region --aircraft examples/f16_constant.py:F16 --delta inf --degree 2 -o f16.json"""

import casadi as ca

from hfa import Model, Signal

AREA, CHORD, GRAVITY, MASS, DENSITY, INERTIA = 300.0, 11.32, 32.17, 1 / 1.57e-3, 2.377e-3, 55814.0


def equations(x, u, p, w):
    """Forces along the axes of the body."""
    alpha = 57.29578 * x.alpha
    rate = CHORD * x.pitch_rate / (2 * x.speed)
    c_x = -0.021 + 0.0034 * alpha + 0.0015 * u.elevator + 0.745 * rate
    c_z = -0.100 - 0.0632 * alpha - 0.0076 * u.elevator - 29.96 * rate
    c_m = -0.009 + 0.0008 * alpha - 0.00963 * u.elevator - 5.243 * rate
    force = DENSITY * x.speed**2 / 2 * AREA
    along = (force * c_x + u.thrust) / MASS - GRAVITY * ca.sin(x.pitch)
    down = force * c_z / MASS + GRAVITY * ca.cos(x.pitch)
    cos, sin = ca.cos(x.alpha), ca.sin(x.alpha)
    rates = {
        "speed": along * cos + down * sin,
        "alpha": x.pitch_rate + (down * cos - along * sin) / x.speed,
        "pitch": x.pitch_rate,
        "pitch_rate": force * CHORD * c_m / INERTIA,
    }
    return rates, {"gamma": x.pitch - x.alpha}


F16 = Model(
    "F-16 with constant derivatives",
    {
        "speed": Signal("ft/s", 500.0, 100.0, 1000.0, 500.0),
        "alpha": Signal("rad", 0.1, -0.17, 0.80, 0.05),
        "pitch": Signal("rad", 0.1, -1.55, 1.55),
        "pitch_rate": Signal("rad/s", 0.1),
    },
    {"thrust": Signal("lbf", 1000.0, 0.0, 12600.0, 2000.0), "elevator": Signal("deg", 5.0, -25.0, 25.0)},
    equations,
    outputs={"gamma": Signal("rad", 0.1)},
    trim={"speed": 502.0, "gamma": 0.0, "pitch_rate": 0.0},
    schedule="speed",
    modes={"short period": ("alpha", "pitch_rate"), "phugoid": ("speed", "pitch")},
)  # fmt: skip
