"""The F-16 of Stevens and Lewis: 13 states, tables of wind-tunnel data, an engine with a lag.

Equations, tables and conditions: B. L. Stevens, F. L. Lewis, E. N. Johnson, Aircraft Control and Simulation, 3rd ed.,
2016, Appendix A. Feet, slugs, pounds, radians; control surfaces in degrees and the throttle from 0 to 1, as in the
book.

    hfa trim --aircraft examples/f16.py:F16 --hold speed=502
"""

import casadi as ca
import numpy as np

from hfa_support import Model, Signal

WING_AREA, SPAN, CHORD, REFERENCE_XCG = 300.0, 30.0, 11.32, 0.35
GRAVITY, MASS, ENGINE_MOMENTUM = 32.17, 1 / 1.57e-3, 160.0
#: Of I_xx 9496, I_yy 55814, I_zz 63100, I_xz 982 slug ft^2, rounded as the printed results take them (Section 1.7).
C1, C2, C3, C4, C5, C6, C7, C8, C9 = -0.770, 0.02755, 1.055e-4, 1.642e-6, 0.9604, 0.01759, 1.792e-5, -0.7336, 1.587e-5

#: Where the tables are given: degrees, feet, Mach numbers.
ALPHAS, ELEVATORS = np.arange(-10.0, 46.0, 5.0), np.arange(-24.0, 25.0, 12.0)
BETAS, BETAS_OF_SURFACES = np.arange(-30.0, 31.0, 5.0), np.arange(-30.0, 31.0, 10.0)
ALTITUDES, MACHS = np.arange(0.0, 50001.0, 1e4), np.arange(0.0, 1.01, 0.2)


def table(text):
    """The numbers of a table, one row a line."""
    return np.array([line.split() for line in text.strip().splitlines()], dtype=float)


def interpolated(x, knots, values):
    """Piecewise linear through (knots, values), continued beyond both ends; values: numbers or expressions.

    v0 + s0 (x - x0) + Σ (s_i - s_(i-1)) max(0, x - x_i) with the slopes s_i.
    """
    slopes = [(values[i + 1] - values[i]) / (knots[i + 1] - knots[i]) for i in range(len(knots) - 1)]
    bends = [(slopes[i] - slopes[i - 1]) * ca.fmax(0, x - knots[i]) for i in range(1, len(slopes))]
    return values[0] + slopes[0] * (x - knots[0]) + sum(bends)


def interpolated_in_two(x, y, x_knots, y_knots, values):
    """Bilinear through values[i, j] at (x_knots[i], y_knots[j])."""
    return interpolated(y, y_knots, [interpolated(x, x_knots, column) for column in values.T])


def mirrored(values):
    """A table over beta >= 0, odd in beta, over all beta: no absolute value, so its slope at 0 is right."""
    return np.hstack([-values[:, :0:-1], values])


def equations(x, u, p, w):
    """Section 3.5 and Appendix A.4 of the book."""
    alpha, beta = 57.29578 * x.alpha, 57.29578 * x.beta  # degrees
    density_ratio = 1 - 0.703e-5 * x.altitude
    temperature = ca.if_else(x.altitude >= 35000, 390.0, 519.0 * density_ratio)
    mach = x.speed / ca.sqrt(1.4 * 1716.3 * temperature)
    dynamic_pressure = 0.5 * 2.377e-3 * density_ratio**4.14 * x.speed**2

    # Engine: a commanded power, a lag that depends on it, thrust from tables.
    commanded = ca.if_else(u.throttle <= 0.77, 64.94 * u.throttle, 217.38 * u.throttle - 117.38)
    to_military, from_military = ca.if_else(x.power >= 50, commanded, 60.0), ca.if_else(x.power >= 50, 40.0, commanded)
    target = ca.if_else(commanded >= 50, to_military, from_military)
    gap = target - x.power
    lag = ca.if_else(gap <= 25, 1.0, ca.if_else(gap >= 50, 0.1, 1.9 - 0.036 * gap))
    lag = ca.if_else(
        ca.logic_or(ca.logic_and(commanded >= 50, x.power >= 50), ca.logic_and(commanded < 50, x.power >= 50)), 5.0, lag
    )
    idle, military, maximum = (
        interpolated_in_two(x.altitude, mach, ALTITUDES, MACHS, table(each))
        for each in (IDLE_THRUST, MILITARY_THRUST, MAXIMUM_THRUST)
    )
    afterburner = military + (maximum - military) * (x.power - 50) / 50
    thrust = ca.if_else(x.power < 50, idle + (military - idle) * x.power / 50, afterburner)

    # Coefficients of force and moment.
    aileron, rudder = u.aileron / 20, u.rudder / 30
    per_span, per_chord = SPAN / (2 * x.speed), CHORD / (2 * x.speed) * x.pitch_rate
    damping = [interpolated(alpha, ALPHAS, row) for row in table(DAMPING)]
    c_x = interpolated_in_two(alpha, u.elevator, ALPHAS, ELEVATORS, table(X_FORCE)) + per_chord * damping[0]
    c_y = (
        -0.02 * beta
        + 0.021 * aileron
        + 0.086 * rudder
        + per_span * (damping[1] * x.yaw_rate + damping[2] * x.roll_rate)
    )
    c_z = (
        interpolated(alpha, ALPHAS, table(Z_FORCE)[0]) * (1 - x.beta**2)
        - 0.19 * u.elevator / 25
        + per_chord * damping[3]
    )
    by_beta = [interpolated_in_two(alpha, beta, ALPHAS, BETAS, mirrored(table(each))) for each in (ROLLING, YAWING)]
    by_surface = [
        interpolated_in_two(alpha, beta, ALPHAS, BETAS_OF_SURFACES, table(each))
        for each in (ROLLING_BY_AILERON, ROLLING_BY_RUDDER, YAWING_BY_AILERON, YAWING_BY_RUDDER)
    ]
    c_roll = by_beta[0] + by_surface[0] * aileron + by_surface[1] * rudder
    c_roll += per_span * (damping[4] * x.yaw_rate + damping[5] * x.roll_rate)
    c_pitch = interpolated_in_two(alpha, u.elevator, ALPHAS, ELEVATORS, table(PITCHING))
    c_pitch += per_chord * damping[6] + c_z * (REFERENCE_XCG - p.xcg)
    c_yaw = by_beta[1] + by_surface[2] * aileron + by_surface[3] * rudder
    c_yaw += (
        per_span * (damping[7] * x.yaw_rate + damping[8] * x.roll_rate) - c_y * (REFERENCE_XCG - p.xcg) * CHORD / SPAN
    )

    # Six degrees of freedom over a flat earth, velocity in wind axes.
    sin_roll, cos_roll, sin_pitch, cos_pitch = ca.sin(x.roll), ca.cos(x.roll), ca.sin(x.pitch), ca.cos(x.pitch)
    sin_yaw, cos_yaw, cos_beta = ca.sin(x.yaw), ca.cos(x.yaw), ca.cos(x.beta)
    forward, aside, down = (
        x.speed * ca.cos(x.alpha) * cos_beta,
        x.speed * ca.sin(x.beta),
        x.speed * ca.sin(x.alpha) * cos_beta,
    )
    force = dynamic_pressure * WING_AREA
    side_acceleration, normal_acceleration = force * c_y / MASS, force * c_z / MASS
    forward_rate = x.yaw_rate * aside - x.pitch_rate * down - GRAVITY * sin_pitch + (force * c_x + thrust) / MASS
    aside_rate = x.roll_rate * down - x.yaw_rate * forward + GRAVITY * cos_pitch * sin_roll + side_acceleration
    down_rate = x.pitch_rate * forward - x.roll_rate * aside + GRAVITY * cos_pitch * cos_roll + normal_acceleration
    speed_rate = (forward * forward_rate + aside * aside_rate + down * down_rate) / x.speed
    in_plane = forward**2 + down**2
    turning = x.pitch_rate * sin_roll + x.yaw_rate * cos_roll
    roll_moment, pitch_moment, yaw_moment = force * SPAN * c_roll, force * CHORD * c_pitch, force * SPAN * c_yaw
    p_rate, q_rate, r_rate = x.roll_rate, x.pitch_rate, x.yaw_rate
    climb_rate = forward * sin_pitch - aside * sin_roll * cos_pitch - down * cos_roll * cos_pitch
    rates = {
        "speed": speed_rate,
        "alpha": (forward * down_rate - down * forward_rate) / in_plane,
        "beta": (x.speed * aside_rate - aside * speed_rate) * cos_beta / in_plane,
        "roll": x.roll_rate + sin_pitch / cos_pitch * turning,
        "pitch": x.pitch_rate * cos_roll - x.yaw_rate * sin_roll,
        "yaw": turning / cos_pitch,
        "roll_rate": (C2 * p_rate + C1 * r_rate + C4 * ENGINE_MOMENTUM) * q_rate + C3 * roll_moment + C4 * yaw_moment,
        "pitch_rate": (C5 * p_rate - C7 * ENGINE_MOMENTUM) * r_rate + C6 * (r_rate**2 - p_rate**2) + C7 * pitch_moment,
        "yaw_rate": (C8 * p_rate - C2 * r_rate + C9 * ENGINE_MOMENTUM) * q_rate + C4 * roll_moment + C9 * yaw_moment,
        "north": forward * cos_pitch * cos_yaw + aside * (sin_roll * cos_yaw * sin_pitch - cos_roll * sin_yaw)
        + down * (cos_roll * sin_pitch * cos_yaw + sin_roll * sin_yaw),
        "east": forward * cos_pitch * sin_yaw + aside * (cos_roll * cos_yaw + sin_roll * sin_pitch * sin_yaw)
        + down * (cos_roll * sin_pitch * sin_yaw - sin_roll * cos_yaw),
        "altitude": climb_rate,
        "power": lag * (target - x.power),
    }  # fmt: skip
    outputs = {
        "gamma": ca.asin(climb_rate / x.speed),
        "climb_rate": climb_rate,
        "turn_rate": rates["yaw"],
        "side_acceleration": side_acceleration,
        "load_factor": -normal_acceleration / GRAVITY,
    }
    return rates, outputs


#: Coefficients; a row an angle of attack, a column an elevator or a sideslip angle (beta >= 0 for ROLLING and YAWING).
X_FORCE = """
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
"""
Z_FORCE = "0.77 0.241 -0.1 -0.416 -0.731 -1.053 -1.366 -1.646 -1.917 -2.12 -2.248 -2.229"
ROLLING = """
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
"""
PITCHING = """
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
"""
YAWING = """
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
"""
ROLLING_BY_AILERON = """
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
"""
ROLLING_BY_RUDDER = """
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
"""
YAWING_BY_AILERON = """
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
"""
YAWING_BY_RUDDER = """
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
"""
#: A row a derivative by a rate: X by q; Y by r, p; Z by q; roll by r, p; pitch by q; yaw by r, p.
DAMPING = """
-0.267 -0.11 0.308 1.34 2.08 2.91 2.76 2.05 1.5 1.49 1.83 1.21
0.882 0.852 0.876 0.958 0.962 0.974 0.819 0.483 0.59 1.21 -0.493 -1.04
-0.108 -0.108 -0.188 0.11 0.258 0.226 0.344 0.362 0.611 0.529 0.298 -2.27
-8.8 -25.8 -28.9 -31.4 -31.2 -30.7 -27.7 -28.2 -29 -29.8 -38.3 -35.3
-0.126 -0.026 0.063 0.113 0.208 0.23 0.319 0.437 0.68 0.1 0.447 -0.33
-0.36 -0.359 -0.443 -0.42 -0.383 -0.375 -0.329 -0.294 -0.23 -0.21 -0.12 -0.1
-7.21 -0.54 -5.23 -5.26 -6.11 -6.64 -5.69 -6 -6.2 -6.4 -6.6 -6
-0.38 -0.363 -0.378 -0.386 -0.37 -0.453 -0.55 -0.582 -0.595 -0.637 -1.02 -0.84
0.061 0.052 0.052 -0.012 -0.013 -0.024 0.05 0.15 0.13 0.158 0.24 0.15
"""
#: Pounds; a row an altitude, a column a Mach number.
IDLE_THRUST = """
1060 635 60 -1020 -2700 -3600
670 425 25 -710 -1900 -1400
880 690 345 -300 -1300 -595
1140 1010 755 350 -247 -342
1500 1330 1130 910 600 -200
1860 1700 1525 1360 1100 700
"""
MILITARY_THRUST = """
12680 12680 12610 12640 12390 11680
9150 9150 9312 9839 10176 9848
6200 6313 6610 7090 7750 8050
3950 4040 4290 4660 5320 6100
2450 2470 2600 2840 3250 3800
1400 1400 1560 1660 1930 2310
"""
MAXIMUM_THRUST = """
20000 21420 22700 24240 26070 28886
15000 15700 16860 18910 21075 23319
10800 11225 12250 13760 15975 18300
7000 7323 8154 9285 11115 13484
4000 4435 5000 5700 6860 8642
2500 2600 2835 3215 3950 5057
"""

ANGLE, RATE = Signal("rad", 0.1), Signal("rad/s", 0.1, rate=1.0)
F16 = Model(
    name="F-16",
    states={
        "speed": Signal("ft/s", 500.0, 100.0, 1000.0, 500.0, rate=32.0),
        "alpha": ANGLE._replace(min=-0.17, max=0.79, start=0.05), "beta": ANGLE._replace(min=-0.52, max=0.52),
        "roll": ANGLE._replace(min=-3.1, max=3.1), "pitch": ANGLE._replace(min=-1.55, max=1.55), "yaw": ANGLE,
        "roll_rate": RATE, "pitch_rate": RATE, "yaw_rate": RATE,
        "north": Signal("ft", 1000.0), "east": Signal("ft", 1000.0), "altitude": Signal("ft", 1000.0, 0.0, 50000.0),
        "power": Signal("1", 10.0, 0.0, 100.0, 10.0),
    },
    inputs={
        "throttle": Signal("1", 0.1, 0.0, 1.0, 0.2), "elevator": Signal("deg", 5.0, -25.0, 25.0),
        "aileron": Signal("deg", 5.0, -21.5, 21.5), "rudder": Signal("deg", 5.0, -30.0, 30.0),
    },
    parameters={"xcg": Signal(start=0.35)},
    outputs={
        "gamma": Signal("rad", 0.1), "climb_rate": Signal("ft/s", 10.0), "turn_rate": Signal("rad/s", 0.1),
        "side_acceleration": Signal("ft/s^2", 1.0), "load_factor": Signal("1"),
    },
    equations=equations,
    trim={
        "speed": 502.0, "altitude": 0.0, "north": 0.0, "east": 0.0, "yaw": 0.0,
        "gamma": 0.0, "turn_rate": 0.0, "side_acceleration": 0.0,
    },
    steady=("speed", "alpha", "beta", "roll", "pitch", "roll_rate", "pitch_rate", "yaw_rate", "power"),
    linear=("speed", "alpha", "beta", "roll", "pitch", "roll_rate", "pitch_rate", "yaw_rate", "power"),
    schedule="speed",
    modes={
        "short period": ("alpha", "pitch_rate"), "phugoid": ("speed", "pitch"), "dutch roll": ("beta", "yaw_rate"),
        "roll": ("roll_rate",), "spiral": ("roll",), "engine": ("power",),
    },
)  # fmt: skip
