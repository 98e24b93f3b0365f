"""A second derivation of the `unsteady` dynamics, from energies.

The derivation uses the kinetic energy of the air carried by wings and tails and the work of the
loads. Velocities and accelerations follow from positions by differentiation.

  T_a = Σ [m w² + (m b²/8) ω_y² + (m span²/12) ω_x²] / 2,   m = π ρ b² span

b is the half chord of a plate, n its normal, and ω its angular velocity. v is the velocity of the
mid-chord, u its part along the chord and w its part along n.

The Euler-Lagrange equations of T_a are Kirchhoff's. They contain the moment -v × (m w n) of a plate
without circulation. The lift at the quarter chord already includes this moment, so it is
subtracted here, together with Theodorsen's -m u (b/2) ω_y.
"""

import casadi as ca
import numpy as np
from lagrangian import (
    at_state,
    euler_lagrange,
    flow_at,
    kinetic_energy,
    panel_loads,
    panels_at,
    velocity_at,
    virtual_work,
)

#: (A_1, A_2), (b_1, b_2): Jones's approximations of Wagner's and Küssner's functions.
MOTION = ((0.165, 0.335), (0.0455, 0.3))
GUST = ((0.5, 0.5), (0.13, 1.0))


def derived_unsteady(x, u, density, p, winds):
    """Return the rates of the seven states, and of the lag states by name, from the second
    derivation.

    The arguments are named states and inputs (SX), as in `hfa_model.unsteady.UNSTEADY`. The drag
    depends on the airspeed.
    """
    r = ca.SX.sym("r", 4)
    v = ca.SX.sym("v", 4)
    panels = panels_at(r, v, p)
    center = ca.jtimes(sum(panel.position for panel in panels) / 3, r, v)
    force = ca.vertcat(0, 0, 0, -2 * p.hinge_damping * v[3])
    carried = 0
    lag_rates = {}
    lifts = []
    for name, panel, side in zip(("center", "outer", "outer"), panels, (0, 1, -1), strict=True):
        wind = winds.outer if side else winds.center
        still = ca.vertcat(-wind.headwind, 0, 0)
        moving = ca.vertcat(-wind.headwind, side * wind.outward, -wind.updraft)
        flow = flow_at(panel, 0, moving, r, v)
        angles = []
        for strip, control, chord, downwash, behind in _surfaces(name, x, u, p):
            motion = flow_at(panel, p.local_motion * behind, still, r, v).alpha - downwash
            whole = flow_at(panel, p.local_motion * behind, moving, r, v).alpha - downwash
            parts = {
                "lag": (motion + control, MOTION, p.lift_lag),
                "gust": (whole - motion, GUST, p.gust_lag),
            }
            for kind, (angle, (shares, rates), weight) in parts.items():
                for i, (share, rate) in enumerate(zip(shares, rates, strict=True), start=1):
                    followed = getattr(x, f"{kind}_{strip}_{i}")
                    whole += weight * share * (followed - angle)
                    lag_rates[f"{kind}_{strip}_{i}"] = (
                        rate * flow.speed / (chord / 2) * (angle - followed)
                    )
            angles.append(whole)
        slopes = [
            p.lift_slope / (1 + p.finite_span * p.lift_slope / np.pi / quantity)
            for quantity in (3 * p.panel_span / p.chord, p.tail_aspect_ratio)
        ]
        flap = p.aileron_lift * slopes[0] / p.lift_slope
        aileron = getattr(u, f"aileron_{name}")
        elevator = getattr(u, f"elevator_{name}")
        lifts.append(slopes[0] * angles[0] + flap * aileron)
        one_wing = p._replace(lift_slope=slopes[0], aileron_lift=flap, tail_area=0)
        speed = ca.norm_2(center - moving)
        wing = panel_loads(flow._replace(alpha=angles[0]), speed, aileron, 0, density, one_wing)
        one_tail = p._replace(lift_slope=slopes[1], chord=0)
        tail = panel_loads(flow._replace(alpha=angles[1]), speed, 0, elevator, density, one_tail)
        loads = type(wing)(*(a + b for a, b in zip(wing, tail, strict=True)))
        force += virtual_work(panel, loads, p.thrust_per_throttle * u.throttle / 3, r, v, p)
        if side:
            force += _along_the_span(panel, still, density, slopes[0], x, r, v, p, side, lag_rates)
        energy, moment = _carried(panel, still, density, r, v, p)
        carried += energy
        force += ca.jacobian(panel.spin, v).T @ moment
    lift = sum(lifts) / 3
    target = 2 * lift / (np.pi * 3 * p.panel_span / p.chord)
    lag_rates["downwash"] = ca.norm_2(center) / p.boom_length * (target - x.downwash)
    kinetic = sum(kinetic_energy(panel, r, v, p) for panel in panels) + carried
    seven = euler_lagrange(x, kinetic, force, panels, r, v, p)
    lags = {name: at_state(rate, x, r, v, p) for name, rate in lag_rates.items()}
    return seven, lags


def _surfaces(name, x, u, p):
    """Return a tuple for the wing and one for the tail of a panel.

    Each tuple contains:

    - name of the strip
    - control angle, rad
    - chord, ft
    - downwash, rad
    - distance from the quarter chord of the wing back to the three-quarter chord of the strip, ft
    """
    chord = ca.sqrt(p.tail_area / p.tail_aspect_ratio)
    aileron = getattr(u, f"aileron_{name}") * p.aileron_lift / p.lift_slope
    elevator = getattr(u, f"elevator_{name}")
    behind = p.boom_length + chord / 2
    return (
        (name, aileron, p.chord, 0, p.chord / 2),
        (f"tail_{name}", elevator, chord, p.downwash_share * x.downwash, behind),
    )


def _along_the_span(panel, air, density, slope, x, r, v, p, side, lag_rates):
    """Return the generalized force (4,) of a lift that increases linearly along an outer panel.

    The lift is 0 at the middle of the panel. The integral over the span uses Gauss-Legendre
    quadrature. The rates of the lag states of the tip are added to `lag_rates`.

    slope: lift slope of the wing, 1/rad
    side: 1 or -1, the side of the panel
    """
    flow = flow_at(panel, 0, air, r, v)
    angle = -p.local_motion * v[3] * p.panel_span / 2 / flow.speed
    tip = angle
    for i, (share, rate) in enumerate(zip(*MOTION, strict=True), start=1):
        followed = getattr(x, f"lag_tip_{i}")
        tip += p.lift_lag * share * (followed - angle)
        lag_rates[f"lag_tip_{i}"] = rate * flow.speed / (p.chord / 2) * (angle - followed)
    work = ca.SX(4, 1)
    for node, weight in zip(*np.polynomial.legendre.leggauss(3), strict=True):
        lift = (
            density * flow.speed**2 / 2 * p.chord * p.panel_span / 2 * weight * slope * tip * node
        )
        position = panel.position + panel.axes @ ca.vertcat(0, side * p.panel_span / 2 * node, 0)
        work += ca.jacobian(position, r).T @ (panel.axes @ ca.vertcat(0, 0, -lift))
    return work


def _carried(panel, air, density, r, v, p):
    """Return the kinetic energy of the air carried by a panel's wing and tail, and a moment.

    The moment (3,), in panel axes, cancels Kirchhoff's moment and adds Theodorsen's -m u (b/2) ω_y.
    The symbols are those of the module.
    """
    chord = ca.sqrt(p.tail_area / p.tail_aspect_ratio)
    energy = ca.SX(0)
    moment = ca.SX(3, 1)
    for b, span, behind in (
        (p.chord / 2, p.panel_span, p.chord / 4),
        (chord / 2, p.tail_area / chord, None),
    ):
        position = ca.vertcat(-(p.boom_length + chord / 4 if behind is None else behind), 0, 0)
        mass = p.apparent_mass * np.pi * density * b**2 * span
        through = velocity_at(panel, position, air, r, v)
        spin = panel.spin
        energy += mass * (through[2] ** 2 + (b * spin[1]) ** 2 / 8 + (span * spin[0]) ** 2 / 12) / 2
        moment += ca.cross(through, ca.vertcat(0, 0, mass * through[2]))
        moment[1] -= mass * through[0] * b / 2 * spin[1]
    return energy, moment
