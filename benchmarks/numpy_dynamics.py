"""The published dynamics written a second time, plainly in Python floats, as a user of python-control would write them.

The peers of the benchmarks trim and linearize this function. A test compares it with `hfa_model.dynamics`.
"""

from __future__ import annotations

from math import asin, atan2, cos, sin, sqrt

import numpy as np

from hfa_model.atmosphere import density
from hfa_model.parameters import Parameters


def six_state_rates(p: Parameters, altitude: float):
    """(t, x (6,), u (5,), params) -> x' of the six states at a fixed altitude, in python-control's signature."""
    rho = float(density(altitude))
    area, span, mass, gravity = p.panel_span * p.chord, p.panel_span, p.panel_mass, p.gravity
    total = 3 * mass
    c1 = 3 * p.inertia_pitch
    c2 = 2 * p.inertia_yaw - 2 * p.inertia_pitch + mass * span**2 / 6

    def panel(forward, sideward, downward, speed, aileron, elevator):
        local = sqrt(forward**2 + sideward**2 + downward**2)
        alpha, beta = atan2(downward, forward), asin(sideward / local)
        q = rho * local**2 / 2
        coefficient = p.lift_slope * alpha + p.aileron_lift * aileron
        tail = q * p.tail_area * p.lift_slope * (alpha + elevator)
        lift = q * area * coefficient + tail
        drag = rho * speed**2 / 2 * area * (p.zero_lift_drag + p.induced_drag * coefficient**2)
        moment = q * p.chord * area * (p.zero_lift_moment + p.aileron_moment * aileron)
        along = drag * cos(beta)
        X = lift * sin(alpha) - along * cos(alpha)
        Y = -drag * sin(beta)
        Z = -lift * cos(alpha) - along * sin(alpha)
        return X, Y, Z, -tail * cos(alpha), moment

    def rates(t, x, u, params):
        V, a, theta, q, eta, eta_rate = x.tolist()
        throttle, aileron_c, aileron_o, elevator_c, elevator_o = u.tolist()
        sa, ca, se, ce = sin(a), cos(a), sin(eta), cos(eta)
        hinge = V * sa + span / 3 * ce * eta_rate
        Xc, _, Zc, Tc, Mc = panel(V * ca + q * span / 3 * se, 0.0, hinge, V, aileron_c, elevator_c)
        normal = hinge * ce - span / 2 * eta_rate
        Xo, Yo, Zo, To, Mo = panel(V * ca - q * span / 6 * se, hinge * se, normal, V, aileron_o, elevator_o)
        X, Z = Xc + 2 * Xo, Zc + 2 * (Zo * ce + Yo * se)
        D, L = -(X * ca + Z * sa), X * sa - Z * ca
        M = Mc + 2 * Mo + p.boom_length * (Tc + 2 * ce * To) + span / 3 * se * Xc
        M -= 2 * (span / 2 - span / 3 * se) * Xo
        H = -span / 2 * (Zo + mass * gravity * ce * cos(theta))
        T = p.thrust_per_throttle * throttle
        gamma = theta - a
        V_rate = (T * ca - D) / total - gravity * sin(gamma)
        a_rate = -(T * sa + L) / (total * V) + q + gravity * cos(gamma) / V
        q_rate = (M - 2 * c2 * se * ce * eta_rate * q) / (c1 + c2 * se**2)
        half = mass * span / 2
        inertial = half * ce * (V_rate * sa + V * ca * a_rate)
        coupling = half * (ce * V * ca * q - V * sa * se * eta_rate - 2 * span / 3 * ce * se * eta_rate**2)
        d2 = (p.inertia_pitch - p.inertia_yaw - mass * span**2 / 12) * se * ce * q**2
        d3 = p.inertia_roll + mass * span**2 / 4 + mass * span**2 / 6 * cos(eta**2)
        elastic = -p.hinge_damping * eta_rate - p.hinge_stiffness * eta
        return np.array([V_rate, a_rate, q, q_rate, eta_rate, (H + elastic + inertial + coupling - d2) / d3])

    return rates
