"""The F-16 of Stevens and Lewis, with aerodynamic tables and engine dynamics.

    hfa trim --aircraft examples/f16.py:F16

B. L. Stevens, F. L. Lewis, E. N. Johnson, Aircraft Control and Simulation, 3rd ed., 2016,
Section 3.5 and Appendix A. Units: ft, slug, lbf and rad. As in the book, control surfaces are in
degrees and the throttle ranges from 0 to 1.
"""

import casadi as ca
import numpy as np

from hfa import Model, Signal

GRAVITY = 32.17  # ft/s^2
SEA_LEVEL_DENSITY = 2.377e-3  # slug/ft^3
GAS_CONSTANT = 1716.3  # ft lbf/(slug R)
STRATOSPHERE_TEMPERATURE = 390.0  # R
DEGREES = 57.29578  # degrees per radian, as in the book

MASS = 1 / 1.57e-3  # slug
AREA = 300.0  # ft^2
SPAN = 30.0  # ft
CHORD = 11.32  # ft
REFERENCE_XCG = 0.35  # fraction of the chord, to which the tables refer
ENGINE_MOMENTUM = 160.0  # slug ft^2/s

# Coefficients of the moment equations for I_xx 9496, I_yy 55814, I_zz 63100, I_xz 982 slug ft^2.
# They are rounded as in the printed results (Section 1.7).
C1 = -0.770
C2 = 0.02755
C3 = 1.055e-4
C4 = 1.642e-6
C5 = 0.9604
C6 = 0.01759
C7 = 1.792e-5
C8 = -0.7336
C9 = 1.587e-5

# Twelve tables, separated by an empty line:
#   1 axial force, 2 pitching moment: a row for each alpha, a column for each elevator
#   3 rolling moment, 4 yawing moment: a row for each alpha, a column for beta from 0 to 30 deg
#   5 rolling moment by aileron, 6 by rudder, 7 yawing moment by aileron, 8 by rudder:
#     a row for each alpha, a column for beta from -30 to 30 deg
#   9 by alpha alone, a column for each alpha. Rows: normal force; X by pitch rate; Y by yaw rate,
#     by roll rate; Z by pitch rate; rolling by yaw rate, by roll rate; pitching by pitch rate;
#     yawing by yaw rate, by roll rate
#   10 idle, 11 military, 12 maximum thrust, lbf: a row for each altitude, a column for each Mach
# Breakpoints: alpha -10 to 45 deg, elevator -24 to 24 deg, altitude 0 to 50000 ft, Mach 0 to 1.
TABLES = """
-0.099 -0.048 -0.022 -0.04 -0.083
-0.081 -0.038 -0.02 -0.038 -0.073
-0.081 -0.04 -0.021 -0.039 -0.076
-0.063 -0.021 -0.004 -0.025 -0.072
-0.025 0.016 0.032 0.006 -0.046
0.044 0.083 0.094 0.062 0.012
0.097 0.127 0.128 0.087 0.024
0.113 0.137 0.13 0.085 0.025
0.145 0.162 0.154 0.1 0.043
0.167 0.177 0.161 0.11 0.053
0.174 0.179 0.155 0.104 0.047
0.166 0.167 0.138 0.091 0.04

0.205 0.081 -0.046 -0.174 -0.259
0.168 0.077 -0.02 -0.145 -0.202
0.186 0.107 -0.009 -0.121 -0.184
0.196 0.11 -0.005 -0.127 -0.193
0.213 0.11 -0.006 -0.129 -0.199
0.251 0.141 0.01 -0.102 -0.15
0.245 0.127 0.006 -0.097 -0.16
0.238 0.119 -0.001 -0.113 -0.167
0.252 0.133 0.014 -0.087 -0.104
0.231 0.108 0 -0.084 -0.076
0.198 0.081 -0.013 -0.069 -0.041
0.192 0.093 0.032 -0.006 -0.005

0 -0.001 -0.003 -0.001 0 0.007 0.009
0 -0.004 -0.009 -0.01 -0.01 -0.01 -0.011
0 -0.008 -0.017 -0.02 -0.022 -0.023 -0.023
0 -0.012 -0.024 -0.03 -0.034 -0.034 -0.037
0 -0.016 -0.03 -0.039 -0.047 -0.049 -0.05
0 -0.019 -0.034 -0.044 -0.046 -0.046 -0.047
0 -0.02 -0.04 -0.05 -0.059 -0.068 -0.074
0 -0.02 -0.037 -0.049 -0.061 -0.071 -0.079
0 -0.015 -0.016 -0.023 -0.033 -0.06 -0.091
0 -0.008 -0.002 -0.006 -0.036 -0.058 -0.076
0 -0.013 -0.01 -0.014 -0.035 -0.062 -0.077
0 -0.015 -0.019 -0.027 -0.035 -0.059 -0.076

0 0.018 0.038 0.056 0.064 0.074 0.079
0 0.019 0.042 0.057 0.077 0.086 0.09
0 0.018 0.042 0.059 0.076 0.093 0.106
0 0.019 0.042 0.058 0.074 0.089 0.106
0 0.019 0.043 0.058 0.073 0.08 0.096
0 0.018 0.039 0.053 0.057 0.062 0.08
0 0.013 0.03 0.032 0.029 0.049 0.068
0 0.007 0.017 0.012 0.007 0.022 0.03
0 0.004 0.004 0.002 0.012 0.028 0.064
0 -0.014 -0.035 -0.046 -0.034 -0.012 0.015
0 -0.017 -0.047 -0.071 -0.065 -0.002 0.011
0 -0.033 -0.057 -0.073 -0.041 -0.013 -0.001

-0.041 -0.041 -0.042 -0.04 -0.043 -0.044 -0.043
-0.052 -0.053 -0.053 -0.052 -0.049 -0.048 -0.049
-0.053 -0.053 -0.052 -0.051 -0.048 -0.048 -0.047
-0.056 -0.053 -0.051 -0.052 -0.049 -0.047 -0.045
-0.05 -0.05 -0.049 -0.048 -0.043 -0.042 -0.042
-0.056 -0.051 -0.049 -0.048 -0.042 -0.041 -0.037
-0.082 -0.066 -0.043 -0.042 -0.042 -0.02 -0.003
-0.059 -0.043 -0.035 -0.037 -0.036 -0.028 -0.013
-0.042 -0.038 -0.026 -0.031 -0.025 -0.013 -0.01
-0.038 -0.027 -0.016 -0.026 -0.021 -0.014 -0.003
-0.027 -0.023 -0.018 -0.017 -0.016 -0.011 -0.007
-0.017 -0.016 -0.014 -0.012 -0.011 -0.01 -0.008

0.005 0.007 0.013 0.018 0.015 0.021 0.023
0.017 0.016 0.013 0.015 0.014 0.011 0.01
0.014 0.014 0.011 0.015 0.013 0.01 0.011
0.01 0.014 0.012 0.014 0.013 0.011 0.011
-0.005 0.013 0.011 0.014 0.012 0.01 0.011
0.009 0.009 0.009 0.014 0.011 0.009 0.01
0.019 0.012 0.008 0.014 0.011 0.008 0.008
0.005 0.005 0.005 0.015 0.01 0.01 0.01
0 0 -0.002 0.013 0.008 0.006 0.006
-0.005 0.004 0.005 0.011 0.008 0.005 0.014
-0.011 0.009 0.003 0.006 0.007 0 0.02
0.008 0.007 0.005 0.001 0.003 0.001 0

0.001 0.002 -0.006 -0.011 -0.015 -0.024 -0.022
-0.027 -0.014 -0.008 -0.011 -0.015 -0.01 0.002
-0.017 -0.016 -0.006 -0.01 -0.014 -0.004 -0.003
-0.013 -0.016 -0.006 -0.009 -0.012 -0.002 -0.005
-0.012 -0.014 -0.005 -0.008 -0.011 -0.001 -0.003
-0.016 -0.019 -0.008 -0.006 -0.008 0.003 -0.001
0.001 -0.021 -0.005 0 -0.002 0.014 -0.009
0.017 0.002 0.007 0.004 0.002 0.006 -0.009
0.011 0.012 0.004 0.007 0.006 -0.001 -0.001
0.017 0.016 0.007 0.01 0.012 0.004 0.003
0.008 0.015 0.006 0.004 0.011 0.004 -0.002
0.016 0.011 0.006 0.01 0.011 0.006 0.001

-0.018 -0.028 -0.037 -0.048 -0.043 -0.052 -0.062
-0.052 -0.051 -0.041 -0.045 -0.044 -0.034 -0.034
-0.052 -0.043 -0.038 -0.045 -0.041 -0.036 -0.027
-0.052 -0.046 -0.04 -0.045 -0.041 -0.036 -0.028
-0.054 -0.045 -0.04 -0.044 -0.04 -0.035 -0.027
-0.049 -0.049 -0.038 -0.045 -0.038 -0.028 -0.027
-0.059 -0.057 -0.037 -0.047 -0.034 -0.024 -0.023
-0.051 -0.052 -0.03 -0.048 -0.035 -0.023 -0.023
-0.03 -0.03 -0.027 -0.049 -0.035 -0.02 -0.019
-0.037 -0.033 -0.024 -0.045 -0.029 -0.016 -0.009
-0.026 -0.03 -0.019 -0.033 -0.022 -0.01 -0.025
-0.013 -0.008 -0.013 -0.016 -0.009 -0.014 -0.01

0.77 0.241 -0.1 -0.416 -0.731 -1.053 -1.366 -1.646 -1.917 -2.12 -2.248 -2.229
-0.267 -0.11 0.308 1.34 2.08 2.91 2.76 2.05 1.5 1.49 1.83 1.21
0.882 0.852 0.876 0.958 0.962 0.974 0.819 0.483 0.59 1.21 -0.493 -1.04
-0.108 -0.108 -0.188 0.11 0.258 0.226 0.344 0.362 0.611 0.529 0.298 -2.27
-8.8 -25.8 -28.9 -31.4 -31.2 -30.7 -27.7 -28.2 -29 -29.8 -38.3 -35.3
-0.126 -0.026 0.063 0.113 0.208 0.23 0.319 0.437 0.68 0.1 0.447 -0.33
-0.36 -0.359 -0.443 -0.42 -0.383 -0.375 -0.329 -0.294 -0.23 -0.21 -0.12 -0.1
-7.21 -0.54 -5.23 -5.26 -6.11 -6.64 -5.69 -6 -6.2 -6.4 -6.6 -6
-0.38 -0.363 -0.378 -0.386 -0.37 -0.453 -0.55 -0.582 -0.595 -0.637 -1.02 -0.84
0.061 0.052 0.052 -0.012 -0.013 -0.024 0.05 0.15 0.13 0.158 0.24 0.15

1060 635 60 -1020 -2700 -3600
670 425 25 -710 -1900 -1400
880 690 345 -300 -1300 -595
1140 1010 755 350 -247 -342
1500 1330 1130 910 600 -200
1860 1700 1525 1360 1100 700

12680 12680 12610 12640 12390 11680
9150 9150 9312 9839 10176 9848
6200 6313 6610 7090 7750 8050
3950 4040 4290 4660 5320 6100
2450 2470 2600 2840 3250 3800
1400 1400 1560 1660 1930 2310

20000 21420 22700 24240 26070 28886
15000 15700 16860 18910 21075 23319
10800 11225 12250 13760 15975 18300
7000 7323 8154 9285 11115 13484
4000 4435 5000 5700 6860 8642
2500 2600 2835 3215 3950 5057
"""


def read_tables(text):
    """Return the tables in a string as a list of matrices. Blank lines separate the tables."""
    return [
        np.array([row.split() for row in table.split("\n")], dtype=float)
        for table in text.strip().split("\n\n")
    ]


def odd_in_sideslip(half):
    """Return a table for sideslip from -30 to 30 deg, given one half of an odd function.

    half: table with columns for sideslip from 0 to 30 deg
    """
    # The columns for 30 to 5 deg, negated, then those for 0 to 30 deg.
    return np.hstack([-half[:, :0:-1], half])


TABLE = read_tables(TABLES)
AXIAL_FORCE = TABLE[0]
PITCHING_MOMENT = TABLE[1]
ROLLING_MOMENT = odd_in_sideslip(TABLE[2])
YAWING_MOMENT = odd_in_sideslip(TABLE[3])
ROLLING_BY_AILERON = TABLE[4]
ROLLING_BY_RUDDER = TABLE[5]
YAWING_BY_AILERON = TABLE[6]
YAWING_BY_RUDDER = TABLE[7]
BY_ALPHA = TABLE[8]
IDLE_THRUST = TABLE[9]
MILITARY_THRUST = TABLE[10]
MAXIMUM_THRUST = TABLE[11]


def weights(x, first, last, count):
    """Return the weights of `count` evenly spaced knots in a linear interpolation at x.

    first, last: positions of the outermost knots, beyond which the interpolation is extrapolated
      linearly
    """
    knots = np.linspace(first, last, count)

    def basis(at):
        """Return the basis functions 1, at - first, and a ramp that begins at each inner knot."""
        ramps = [ca.fmax(0, at - knot) for knot in knots[1:-1]]
        return ca.vertcat(1.0, at - first, *ramps)

    # Weights w with which sum(w f(knot)) is exact for each basis function f.
    at_knots = [basis(knot).full().ravel() for knot in knots]
    return ca.mtimes(np.linalg.inv(at_knots).T.round(12), basis(x))


def engine(x, throttle, mach):
    """Return (thrust in lbf, rate of the engine power in percent per second).

    x: states, with the altitude in ft and the engine power in percent
    throttle: 0 to 1
    """
    below_military = 64.94 * throttle
    above_military = 217.38 * throttle - 117.38
    commanded = ca.if_else(throttle <= 0.77, below_military, above_military)
    afterburner = x.power >= 50
    target_with_afterburner = ca.if_else(commanded >= 50, commanded, 40.0)
    target_without = ca.if_else(commanded >= 50, 60.0, commanded)
    gap = ca.if_else(afterburner, target_with_afterburner, target_without) - x.power
    slow_rate = ca.if_else(gap <= 25, 1.0, ca.if_else(gap >= 50, 0.1, 1.9 - 0.036 * gap))
    power_rate = ca.if_else(afterburner, 5.0, slow_rate) * gap

    at_altitude = weights(x.altitude, 0, 50000, 6)
    at_mach = weights(mach, 0, 1, 6)
    idle = ca.bilin(IDLE_THRUST, at_altitude, at_mach)
    military = ca.bilin(MILITARY_THRUST, at_altitude, at_mach)
    maximum = ca.bilin(MAXIMUM_THRUST, at_altitude, at_mach)
    dry = idle + (military - idle) * x.power / 50
    wet = military + (maximum - military) * (x.power - 50) / 50
    return ca.if_else(x.power < 50, dry, wet), power_rate


def aerodynamic_coefficients(x, u, xcg):
    """Return the coefficients of the forces X, Y, Z and of the moments l, m, n in body axes.

    x: states, with angles in rad
    u: inputs, with control surfaces in degrees
    xcg: position of the center of gravity as a fraction of the chord
    """
    alpha = DEGREES * x.alpha
    beta = DEGREES * x.beta
    aileron = u.aileron / 20
    rudder = u.rudder / 30
    at_alpha = weights(alpha, -10, 45, 12)
    at_elevator = weights(u.elevator, -24, 24, 5)
    at_beta = weights(beta, -30, 30, 7)
    at_beta_fine = weights(beta, -30, 30, 13)

    roll_rate = SPAN * x.roll_rate / (2 * x.speed)
    pitch_rate = CHORD * x.pitch_rate / (2 * x.speed)
    yaw_rate = SPAN * x.yaw_rate / (2 * x.speed)

    by_alpha = ca.vertsplit(ca.mtimes(BY_ALPHA, at_alpha))
    normal, x_q, y_r, y_p, z_q, l_r, l_p, m_q, n_r, n_p = by_alpha
    l_aileron = ca.bilin(ROLLING_BY_AILERON, at_alpha, at_beta)
    l_rudder = ca.bilin(ROLLING_BY_RUDDER, at_alpha, at_beta)
    n_aileron = ca.bilin(YAWING_BY_AILERON, at_alpha, at_beta)
    n_rudder = ca.bilin(YAWING_BY_RUDDER, at_alpha, at_beta)

    c_x = ca.bilin(AXIAL_FORCE, at_alpha, at_elevator) + x_q * pitch_rate
    c_y = -0.02 * beta + 0.021 * aileron + 0.086 * rudder + y_r * yaw_rate + y_p * roll_rate
    c_z = normal * (1 - x.beta**2) - 0.19 * u.elevator / 25 + z_q * pitch_rate
    c_l = (
        ca.bilin(ROLLING_MOMENT, at_alpha, at_beta_fine)
        + l_aileron * aileron
        + l_rudder * rudder
        + l_r * yaw_rate
        + l_p * roll_rate
    )
    c_m = (
        ca.bilin(PITCHING_MOMENT, at_alpha, at_elevator)
        + m_q * pitch_rate
        + c_z * (REFERENCE_XCG - xcg)
    )
    c_n = (
        ca.bilin(YAWING_MOMENT, at_alpha, at_beta_fine)
        + n_aileron * aileron
        + n_rudder * rudder
        + n_r * yaw_rate
        + n_p * roll_rate
        - c_y * (REFERENCE_XCG - xcg) * CHORD / SPAN
    )
    return (c_x, c_y, c_z), (c_l, c_m, c_n)


def equations(x, u, p, w):
    """Return the state derivatives and the outputs.

    x, u, p, w: states, inputs, parameters and disturbances
    """
    temperature_ratio = 1 - 7.03e-6 * x.altitude
    temperature = ca.if_else(
        x.altitude >= 35000, STRATOSPHERE_TEMPERATURE, 519.0 * temperature_ratio
    )
    mach = x.speed / ca.sqrt(1.4 * GAS_CONSTANT * temperature)
    density = SEA_LEVEL_DENSITY * temperature_ratio**4.14
    pressure_area = 0.5 * density * x.speed**2 * AREA

    thrust, power_rate = engine(x, u.throttle, mach)
    (c_x, c_y, c_z), (c_l, c_m, c_n) = aerodynamic_coefficients(x, u, p.xcg)
    force = ca.vertcat(pressure_area * c_x + thrust, pressure_area * c_y, pressure_area * c_z)
    roll_moment = pressure_area * SPAN * c_l
    pitch_moment = pressure_area * CHORD * c_m
    yaw_moment = pressure_area * SPAN * c_n

    sin_roll = ca.sin(x.roll)
    cos_roll = ca.cos(x.roll)
    sin_pitch = ca.sin(x.pitch)
    cos_pitch = ca.cos(x.pitch)
    sin_yaw = ca.sin(x.yaw)
    cos_yaw = ca.cos(x.yaw)
    down = ca.vertcat(-sin_pitch, cos_pitch * sin_roll, cos_pitch * cos_roll)

    # Motion of the center of gravity, in body axes.
    velocity = x.speed * ca.vertcat(
        ca.cos(x.alpha) * ca.cos(x.beta), ca.sin(x.beta), ca.sin(x.alpha) * ca.cos(x.beta)
    )
    angular_velocity = ca.vertcat(x.roll_rate, x.pitch_rate, x.yaw_rate)
    specific_force = force / MASS
    velocity_rate = specific_force + GRAVITY * down - ca.cross(angular_velocity, velocity)
    forward, sideward, downward = ca.vertsplit(velocity)
    forward_rate, sideward_rate, downward_rate = ca.vertsplit(velocity_rate)
    in_plane_squared = forward**2 + downward**2
    speed_rate = ca.dot(velocity, velocity_rate) / x.speed
    alpha_rate = (forward * downward_rate - downward * forward_rate) / in_plane_squared
    beta_rate = (
        (x.speed * sideward_rate - sideward * speed_rate) * ca.cos(x.beta) / in_plane_squared
    )

    # Motion over the ground.
    climb_rate = -ca.dot(down, velocity)
    ahead = forward * cos_pitch + (sideward * sin_roll + downward * cos_roll) * sin_pitch
    aside = sideward * cos_roll - downward * sin_roll

    # Rotation.
    turning = x.pitch_rate * sin_roll + x.yaw_rate * cos_roll
    yaw_angle_rate = turning / cos_pitch
    roll_acceleration = (
        (C2 * x.roll_rate + C1 * x.yaw_rate + C4 * ENGINE_MOMENTUM) * x.pitch_rate
        + C3 * roll_moment
        + C4 * yaw_moment
    )
    pitch_acceleration = (
        (C5 * x.roll_rate - C7 * ENGINE_MOMENTUM) * x.yaw_rate
        + C6 * (x.yaw_rate**2 - x.roll_rate**2)
        + C7 * pitch_moment
    )
    yaw_acceleration = (
        (C8 * x.roll_rate - C2 * x.yaw_rate + C9 * ENGINE_MOMENTUM) * x.pitch_rate
        + C4 * roll_moment
        + C9 * yaw_moment
    )

    rates = {
        "speed": speed_rate,
        "alpha": alpha_rate,
        "beta": beta_rate,
        "roll": x.roll_rate + sin_pitch / cos_pitch * turning,
        "pitch": x.pitch_rate * cos_roll - x.yaw_rate * sin_roll,
        "yaw": yaw_angle_rate,
        "roll_rate": roll_acceleration,
        "pitch_rate": pitch_acceleration,
        "yaw_rate": yaw_acceleration,
        "north": ahead * cos_yaw - aside * sin_yaw,
        "east": ahead * sin_yaw + aside * cos_yaw,
        "altitude": climb_rate,
        "power": power_rate,
    }
    outputs = {
        "gamma": ca.asin(climb_rate / x.speed),
        "climb_rate": climb_rate,
        "turn_rate": yaw_angle_rate,
        "side_acceleration": specific_force[1],
        # Normal to the flight path.
        "load_factor": (specific_force[0] * ca.sin(x.alpha) - specific_force[2] * ca.cos(x.alpha))
        / GRAVITY,
    }
    return rates, outputs


ANGLE = Signal("rad", nominal=0.1)
ANGULAR_RATE = Signal("rad/s", nominal=0.1, rate=1.0)
POSITION = Signal("ft", nominal=1000.0)
STEADY = ("speed", "alpha", "beta", "roll", "pitch", "roll_rate", "pitch_rate", "yaw_rate", "power")

F16 = Model(
    name="F-16",
    states={
        "speed": Signal("ft/s", nominal=500.0, min=100.0, max=1000.0, start=500.0, rate=32.0),
        "alpha": Signal("rad", nominal=0.1, min=-0.17, max=0.80, start=0.05),
        "beta": Signal("rad", nominal=0.1, min=-0.52, max=0.52),
        "roll": Signal("rad", nominal=0.1, min=-3.1, max=3.1),
        "pitch": Signal("rad", nominal=0.1, min=-1.55, max=1.55),
        "yaw": ANGLE,
        "roll_rate": ANGULAR_RATE,
        "pitch_rate": ANGULAR_RATE,
        "yaw_rate": ANGULAR_RATE,
        "north": POSITION,
        "east": POSITION,
        "altitude": Signal("ft", nominal=1000.0, min=-1000.0, max=50000.0),
        "power": Signal("1", nominal=10.0, min=0.0, max=100.0, start=10.0),
    },
    inputs={
        "throttle": Signal("1", nominal=0.1, min=0.0, max=1.0, start=0.2),
        "elevator": Signal("deg", nominal=5.0, min=-25.0, max=25.0),
        "aileron": Signal("deg", nominal=5.0, min=-21.5, max=21.5),
        "rudder": Signal("deg", nominal=5.0, min=-30.0, max=30.0),
    },
    parameters={"xcg": Signal(start=0.35)},
    outputs={
        "gamma": ANGLE,
        "climb_rate": Signal("ft/s", nominal=10.0),
        "turn_rate": Signal("rad/s", nominal=0.1),
        "side_acceleration": Signal("ft/s^2"),
        "load_factor": Signal(),
    },
    equations=equations,
    steady=STEADY,
    linear=STEADY,
    schedule="speed",
    trim={
        "speed": 502.0,
        "altitude": 0.0,
        "north": 0.0,
        "east": 0.0,
        "yaw": 0.0,
        "gamma": 0.0,
        "turn_rate": 0.0,
        "side_acceleration": 0.0,
    },
    modes={
        "short period": ("alpha", "pitch_rate"),
        "phugoid": ("speed", "pitch"),
        "dutch roll": ("beta", "yaw_rate"),
        "roll": ("roll_rate",),
        "spiral": ("roll",),
        "engine": ("power",),
    },
)
