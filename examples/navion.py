"""The Navion from published derivatives.

    hfa linearize --aircraft examples/navion.py:NAVION

Units: ft, slug, lbf and rad. Source: R. C. Nelson, Flight Stability and Automatic Control, 2nd ed.,
1998, Table B.1 at 176 ft/s. The derivatives were compared with navion_aero.c of NASA's LaRCSim
(1994). The rolling moments due to rudder, 0.0118, and due to yaw rate, 0.107, are those of LaRCSim.
Nelson's examples omit C_Lq and use C_nbeta 0.0701. With these two values the modes agree within
0.5 %. With the values below the spiral differs by 7 % and the other modes by 1 %.
"""

import casadi as ca

from hfa import Model, Signal

GRAVITY = 32.2  # ft/s^2
DENSITY = 2.3769e-3  # slug/ft^3, at sea level
MASS = 2750 / 32.2  # slug
I_XX = 1048.0  # slug ft^2
I_YY = 3000.0
I_ZZ = 3530.0
AREA = 184.0  # ft^2
SPAN = 33.4  # ft
CHORD = 5.7  # ft
C_LQ = 3.8  # lift by the pitch rate
C_NBETA = 0.071  # weathercock stability


def equations(x, u, p, w):
    """Return the state derivatives and the outputs.

    Forces and moments are linear in the tabulated derivatives. Alpha is measured from its value in
    level flight.
    """
    pressure_area = DENSITY * x.speed**2 / 2 * AREA
    half_span_time = SPAN / (2 * x.speed)
    half_chord_time = CHORD / (2 * x.speed)
    gamma = x.pitch - x.alpha

    lift_coefficient = (
        0.41 + 4.44 * x.alpha + C_LQ * half_chord_time * x.pitch_rate + 0.355 * u.elevator
    )
    drag_coefficient = 0.05 + 0.33 * x.alpha
    side_coefficient = -0.564 * x.beta + 0.157 * u.rudder
    lift = pressure_area * lift_coefficient
    drag = pressure_area * drag_coefficient
    side_force = pressure_area * side_coefficient

    speed_rate = (u.thrust * ca.cos(x.alpha) - drag) / MASS - GRAVITY * ca.sin(gamma)
    lift_acceleration = (lift + u.thrust * ca.sin(x.alpha)) / MASS
    alpha_rate = x.pitch_rate + (GRAVITY * ca.cos(gamma) - lift_acceleration) / x.speed
    beta_rate = (side_force / MASS + GRAVITY * ca.sin(x.roll)) / x.speed - x.yaw_rate

    roll_coefficient = (
        -0.074 * x.beta
        + half_span_time * (-0.410 * x.roll_rate + 0.107 * x.yaw_rate)
        - 0.134 * u.aileron
        + 0.0118 * u.rudder
    )
    pitch_coefficient = (
        -0.683 * x.alpha
        - half_chord_time * (9.96 * x.pitch_rate + 4.36 * alpha_rate)
        - 0.923 * u.elevator
    )
    yaw_coefficient = (
        C_NBETA * x.beta
        - half_span_time * (0.0575 * x.roll_rate + 0.125 * x.yaw_rate)
        + 0.0035 * u.aileron
        - 0.072 * u.rudder
    )
    rates = {
        "speed": speed_rate,
        "alpha": alpha_rate,
        "beta": beta_rate,
        "roll": x.roll_rate,
        "pitch": x.pitch_rate,
        "roll_rate": pressure_area * SPAN * roll_coefficient / I_XX,
        "pitch_rate": pressure_area * CHORD * pitch_coefficient / I_YY,
        "yaw_rate": pressure_area * SPAN * yaw_coefficient / I_ZZ,
    }
    outputs = {"gamma": gamma, "load_factor": lift_acceleration / GRAVITY}
    return rates, outputs


ANGLE = Signal("rad", nominal=0.1, min=-0.5, max=0.5)
ANGULAR_RATE = Signal("rad/s", nominal=0.1, rate=1.0)
SURFACE = Signal("rad", nominal=0.1, min=-0.4, max=0.4)

NAVION = Model(
    name="Navion",
    states={
        "speed": Signal("ft/s", nominal=176.0, min=80.0, max=300.0, start=176.0, rate=32.2),
        "alpha": ANGLE,
        "pitch": ANGLE,
        "pitch_rate": ANGULAR_RATE,
        "beta": ANGLE,
        "roll": ANGLE,
        "roll_rate": ANGULAR_RATE,
        "yaw_rate": ANGULAR_RATE,
    },
    inputs={
        "thrust": Signal("lbf", nominal=100.0, min=0.0, max=1500.0, start=300.0),
        "elevator": SURFACE,
        "aileron": SURFACE,
        "rudder": SURFACE,
    },
    outputs={"gamma": ANGLE, "load_factor": Signal()},
    equations=equations,
    trim={
        "speed": 176.0,
        "gamma": 0.0,
        "pitch_rate": 0.0,
        "roll": 0.0,
        "roll_rate": 0.0,
        "yaw_rate": 0.0,
    },
    replaced={"pitch": "gamma"},
    schedule="speed",
    modes={
        "short period": ("alpha", "pitch_rate"),
        "phugoid": ("speed", "pitch"),
        "dutch roll": ("beta", "yaw_rate"),
        "roll": ("roll_rate",),
        "spiral": ("roll",),
    },
)
