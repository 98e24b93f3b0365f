"""The Navion from published derivatives (ft, slug, rad): hfa linearize --aircraft examples/navion.py:NAVION

R. C. Nelson, Flight Stability and Automatic Control, 2nd ed., 1998, Table B.1 at 176 ft/s; compared with navion_aero.c
of NASA's LaRCSim (1994), whose C_l of the rudder is 0.0118 (0.107 is that of the yaw rate). Nelson's examples leave
C_Lq out and take C_nbeta 0.0701: so their modes come out within 0.5 %. Here the spiral is 7 % off, the others 1 %."""

import casadi as ca

from hfa import Model, Signal

AREA, SPAN, CHORD, MASS, GRAVITY, DENSITY = 184.0, 33.4, 5.7, 2750 / 32.2, 32.2, 2.3769e-3
I_XX, I_YY, I_ZZ, C_LQ, C_NBETA = 1048.0, 3000.0, 3530.0, 3.8, 0.071


def equations(x, u, p, w):
    """Forces and moments linear in the derivatives of the table; alpha from its value in level flight."""
    pressure, b, c = DENSITY * x.speed**2 / 2 * AREA, SPAN / (2 * x.speed), CHORD / (2 * x.speed)
    lift = pressure * (0.41 + 4.44 * x.alpha + C_LQ * c * x.pitch_rate + 0.355 * u.elevator)
    drag, gamma, side = (
        pressure * (0.05 + 0.33 * x.alpha),
        x.pitch - x.alpha,
        -0.564 * x.beta + 0.157 * u.rudder,
    )
    alpha_rate = (
        x.pitch_rate
        + (GRAVITY * ca.cos(gamma) - (lift + u.thrust * ca.sin(x.alpha)) / MASS) / x.speed
    )
    pitching = -0.683 * x.alpha - c * (9.96 * x.pitch_rate + 4.36 * alpha_rate) - 0.923 * u.elevator
    rolling = (
        -0.074 * x.beta
        + b * (-0.410 * x.roll_rate + 0.107 * x.yaw_rate)
        - 0.134 * u.aileron
        + 0.0118 * u.rudder
    )
    yawing = (
        C_NBETA * x.beta
        - b * (0.0575 * x.roll_rate + 0.125 * x.yaw_rate)
        + 0.0035 * u.aileron
        - 0.072 * u.rudder
    )
    rates = {"speed": (u.thrust * ca.cos(x.alpha) - drag) / MASS - GRAVITY * ca.sin(gamma), "alpha": alpha_rate,
             "beta": (pressure * side / MASS + GRAVITY * ca.sin(x.roll)) / x.speed - x.yaw_rate, "pitch": x.pitch_rate,
             "roll": x.roll_rate, "roll_rate": pressure * SPAN * rolling / I_XX,
             "pitch_rate": pressure * CHORD * pitching / I_YY, "yaw_rate": pressure * SPAN * yawing / I_ZZ}  # fmt: skip
    return rates, {"gamma": gamma, "load_factor": lift / (MASS * GRAVITY)}


ANGLE, RATE, SURFACE = (
    Signal("rad", 0.1, -0.5, 0.5),
    Signal("rad/s", 0.1, rate=1.0),
    Signal("rad", 0.1, -0.4, 0.4),
)
NAVION = Model(
    "Navion", {"speed": Signal("ft/s", 176.0, 80.0, 300.0, 176.0, rate=32.2), "alpha": ANGLE, "pitch": ANGLE,
               "pitch_rate": RATE, "beta": ANGLE, "roll": ANGLE, "roll_rate": RATE, "yaw_rate": RATE},
    {"thrust": Signal("lbf", 100.0, 0.0, 1500.0, 300.0), **dict.fromkeys(("elevator", "aileron", "rudder"), SURFACE)},
    equations, outputs={"gamma": ANGLE, "load_factor": Signal()}, replaced={"pitch": "gamma"}, schedule="speed",
    trim={"speed": 176.0, "gamma": 0.0, "pitch_rate": 0.0, "roll": 0.0, "roll_rate": 0.0, "yaw_rate": 0.0},
    modes={"short period": ("alpha", "pitch_rate"), "phugoid": ("speed", "pitch"), "dutch roll": ("beta", "yaw_rate"),
           "roll": ("roll_rate",), "spiral": ("roll",)})  # fmt: skip
