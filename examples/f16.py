"""The F-16 of Stevens and Lewis, with tables and engine: hfa trim --aircraft examples/f16.py:F16 --hold speed=502

B. L. Stevens, F. L. Lewis, E. N. Johnson, Aircraft Control and Simulation, 3rd ed., 2016, Section 3.5, Appendix A.
Feet, slugs, pounds, radians; control surfaces in degrees and the throttle from 0 to 1, as in the book."""

import casadi as ca
import numpy as np

from hfa import Model, Signal

AREA, SPAN, CHORD, GRAVITY, MASS, SPIN = 300.0, 30.0, 11.32, 32.17, 1 / 1.57e-3, 160.0
#: Of I_xx 9496, I_yy 55814, I_zz 63100, I_xz 982 slug ft^2, rounded as the printed results take them (Section 1.7).
C1, C2, C3, C4, C5, C6, C7, C8, C9 = (
    -0.770,
    0.02755,
    1.055e-4,
    1.642e-6,
    0.9604,
    0.01759,
    1.792e-5,
    -0.7336,
    1.587e-5,
)
#: A row an angle of attack from -10 to 45 deg: axial force, pitching by elevator; rolling, yawing by sideslip from 0 to
#: 30 deg; rolling by aileron, by rudder, yawing by aileron, by rudder by sideslip from -30 to 30 deg. A column an angle
#: of attack: normal force; X by q; Y by r, p; Z by q; rolling by r, p; pitching by q; yawing by r, p. Thrust, lbf:
#: idle, military, maximum; a row an altitude from 0 to 50000 ft, a column a Mach number from 0 to 1.
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
AXIAL, PITCHING, ROLLING, YAWING, *SURFACES, BY_ALPHA, IDLE, MILITARY, MAXIMUM = (
    np.array([line.split() for line in each.split("\n")], dtype=float)
    for each in TABLES.strip().split("\n\n")
)
ROLLING, YAWING = (
    np.hstack([-each[:, :0:-1], each]) for each in (ROLLING, YAWING)
)  # odd, with no kink at 0


def weights(x, first, last, count):
    """The share of each knot in a linear interpolation at x, continued beyond both ends."""
    knots = np.linspace(first, last, count)
    parts = [
        ca.vertcat(1.0, at - first, *(ca.fmax(0, at - knot) for knot in knots[1:-1]))
        for at in (x, *knots)
    ]
    return ca.mtimes(
        np.linalg.inv([part.full().ravel() for part in parts[1:]]).T.round(12), parts[0]
    )


def equations(x, u, p, w):
    """Rates and outputs."""
    alpha, beta, air = 57.29578 * x.alpha, 57.29578 * x.beta, 1 - 7.03e-6 * x.altitude
    mach = x.speed / ca.sqrt(1.4 * 1716.3 * ca.if_else(x.altitude >= 35000, 390.0, 519.0 * air))
    by_alpha, by_elevator = weights(alpha, -10, 45, 12), weights(u.elevator, -24, 24, 5)

    commanded = ca.if_else(u.throttle <= 0.77, 64.94 * u.throttle, 217.38 * u.throttle - 117.38)
    above, below = (
        ca.if_else(commanded >= 50, *each) for each in ((commanded, 40.0), (60.0, commanded))
    )
    gap = ca.if_else(x.power >= 50, above, below) - x.power
    lag = ca.if_else(gap <= 25, 1.0, ca.if_else(gap >= 50, 0.1, 1.9 - 0.036 * gap))
    at = weights(x.altitude, 0, 50000, 6), weights(mach, 0, 1, 6)
    idle, military, maximum = (ca.bilin(each, *at) for each in (IDLE, MILITARY, MAXIMUM))
    dry, wet = (
        idle + (military - idle) * x.power / 50,
        military + (maximum - military) * (x.power - 50) / 50,
    )

    z_0, x_q, y_r, y_p, z_q, l_r, l_p, m_q, n_r, n_p = ca.vertsplit(ca.mtimes(BY_ALPHA, by_alpha))
    l_0, n_0 = (ca.bilin(each, by_alpha, weights(beta, -30, 30, 13)) for each in (ROLLING, YAWING))
    l_a, l_d, n_a, n_d = (ca.bilin(each, by_alpha, weights(beta, -30, 30, 7)) for each in SURFACES)
    p_, q_, r_ = (
        each / (2 * x.speed)
        for each in (SPAN * x.roll_rate, CHORD * x.pitch_rate, SPAN * x.yaw_rate)
    )
    c_x = ca.bilin(AXIAL, by_alpha, by_elevator) + x_q * q_
    c_y = -0.02 * beta + 0.021 * u.aileron / 20 + 0.086 * u.rudder / 30 + y_r * r_ + y_p * p_
    c_z = z_0 * (1 - x.beta**2) - 0.19 * u.elevator / 25 + z_q * q_
    c_l = l_0 + l_a * u.aileron / 20 + l_d * u.rudder / 30 + l_r * r_ + l_p * p_
    c_m = ca.bilin(PITCHING, by_alpha, by_elevator) + m_q * q_ + c_z * (0.35 - p.xcg)
    c_n = (
        n_0
        + n_a * u.aileron / 20
        + n_d * u.rudder / 30
        + n_r * r_
        + n_p * p_
        - c_y * (0.35 - p.xcg) * CHORD / SPAN
    )

    force = 0.5 * 2.377e-3 * air**4.14 * x.speed**2 * AREA
    pushed = (
        ca.vertcat(force * c_x + ca.if_else(x.power < 50, dry, wet), force * c_y, force * c_z)
        / MASS
    )
    (s_roll, s_pitch, s_yaw), (c_roll, c_pitch, c_yaw) = (
        map(of, (x.roll, x.pitch, x.yaw)) for of in (ca.sin, ca.cos)
    )
    down = ca.vertcat(-s_pitch, c_pitch * s_roll, c_pitch * c_roll)
    v = x.speed * ca.vertcat(
        ca.cos(x.alpha) * ca.cos(x.beta), ca.sin(x.beta), ca.sin(x.alpha) * ca.cos(x.beta)
    )
    v_rate = (
        pushed + GRAVITY * down - ca.cross(ca.vertcat(x.roll_rate, x.pitch_rate, x.yaw_rate), v)
    )
    speed_rate, in_plane, climb_rate = (
        ca.dot(v, v_rate) / x.speed,
        v[0] ** 2 + v[2] ** 2,
        -ca.dot(down, v),
    )
    ahead, aside = (
        v[0] * c_pitch + (v[1] * s_roll + v[2] * c_roll) * s_pitch,
        v[1] * c_roll - v[2] * s_roll,
    )
    turning = x.pitch_rate * s_roll + x.yaw_rate * c_roll
    roll, pitch, yaw = force * SPAN * c_l, force * CHORD * c_m, force * SPAN * c_n
    rates = {"speed": speed_rate, "alpha": (v[0] * v_rate[2] - v[2] * v_rate[0]) / in_plane, "altitude": climb_rate,
             "beta": (x.speed * v_rate[1] - v[1] * speed_rate) * ca.cos(x.beta) / in_plane, "yaw": turning / c_pitch,
             "roll": x.roll_rate + s_pitch / c_pitch * turning, "pitch": x.pitch_rate * c_roll - x.yaw_rate * s_roll,
             "roll_rate": (C2 * x.roll_rate + C1 * x.yaw_rate + C4 * SPIN) * x.pitch_rate + C3 * roll + C4 * yaw,
             "pitch_rate": (C5 * x.roll_rate - C7 * SPIN) * x.yaw_rate + C6 * (x.yaw_rate**2 - x.roll_rate**2)
             + C7 * pitch, "north": ahead * c_yaw - aside * s_yaw, "east": ahead * s_yaw + aside * c_yaw,
             "yaw_rate": (C8 * x.roll_rate - C2 * x.yaw_rate + C9 * SPIN) * x.pitch_rate + C4 * roll + C9 * yaw,
             "power": ca.if_else(x.power >= 50, 5.0, lag) * gap}  # fmt: skip
    return rates, {"gamma": ca.asin(climb_rate / x.speed), "climb_rate": climb_rate, "turn_rate": rates["yaw"],
                   "side_acceleration": pushed[1], "load_factor": -pushed[2] / GRAVITY}  # fmt: skip


ANGLE, RATE, PLACE = Signal("rad", 0.1), Signal("rad/s", 0.1, rate=1.0), Signal("ft", 1000.0)
STEADY = ("speed", "alpha", "beta", "roll", "pitch", "roll_rate", "pitch_rate", "yaw_rate", "power")
F16 = Model(
    "F-16",
    {"speed": Signal("ft/s", 500.0, 100.0, 1000.0, 500.0, rate=32.0), "alpha": Signal("rad", 0.1, -0.17, 0.80, 0.05),
     "beta": Signal("rad", 0.1, -0.52, 0.52), "roll": Signal("rad", 0.1, -3.1, 3.1),
     "pitch": Signal("rad", 0.1, -1.55, 1.55), "yaw": ANGLE, "roll_rate": RATE, "pitch_rate": RATE, "yaw_rate": RATE,
     "north": PLACE, "east": PLACE, "altitude": Signal("ft", 1000.0, -1000.0, 50000.0),
     "power": Signal("1", 10.0, 0.0, 100.0, 10.0)},
    {"throttle": Signal("1", 0.1, 0.0, 1.0, 0.2), "elevator": Signal("deg", 5.0, -25.0, 25.0),
     "aileron": Signal("deg", 5.0, -21.5, 21.5), "rudder": Signal("deg", 5.0, -30.0, 30.0)},
    equations, parameters={"xcg": Signal(start=0.35)}, steady=STEADY, linear=STEADY, schedule="speed",
    outputs={"gamma": ANGLE, "climb_rate": Signal("ft/s", 10.0), "turn_rate": Signal("rad/s", 0.1),
             "side_acceleration": Signal("ft/s^2"), "load_factor": Signal()},
    trim={"speed": 502.0, "altitude": 0.0, "north": 0.0, "east": 0.0, "yaw": 0.0, "gamma": 0.0, "turn_rate": 0.0,
          "side_acceleration": 0.0},
    modes={"short period": ("alpha", "pitch_rate"), "phugoid": ("speed", "pitch"), "dutch roll": ("beta", "yaw_rate"),
           "roll": ("roll_rate",), "spiral": ("roll",), "engine": ("power",)})  # fmt: skip
