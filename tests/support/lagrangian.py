"""Independent derivation of the equations of motion from energies, to check the `newton` dynamics.

The generalized coordinates of the three rigid panels are r = (X, Z, θ, η): the position of the
center panel in an inertial frame (X north, Z down), pitch and dihedral. Only the positions of the
panels are written down. The equations of motion follow by differentiation,

    d/dt ∂T/∂r' - ∂T/∂r + ∂U/∂r = Q

T is the kinetic energy of the panels, and U is the potential energy of weight and hinge springs. Q
contains the generalized forces of the panel loads, the thrust and the hinge dampers, by virtual
work. Nothing of the product's equations is used.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import casadi as ca

from hfa_model import State


class Panel(NamedTuple):
    """Position and motion of one panel.

    position: (3,), center of mass in the inertial frame, ft
    axes: (3, 3), rotation matrix from panel axes to the inertial frame
    spin: (3,), angular velocity in panel axes, rad/s
    """

    position: ca.SX
    axes: ca.SX
    spin: ca.SX


class Flow(NamedTuple):
    """Speed of the air at a panel, ft/s, its angle of attack and its sideslip, rad."""

    speed: Any
    alpha: Any
    sideslip: Any


class Wind(NamedTuple):
    """Velocity of the air at a panel, ft/s: upward, from ahead, and toward the wing tip."""

    updraft: Any
    headwind: Any
    outward: Any = 0.0


class Winds(NamedTuple):
    """Winds at the center panel and at each outer panel."""

    center: Wind
    outer: Wind


def winds_of(w):
    """Return the winds at the panels: those of the aircraft and of the panel are added."""
    return Winds(
        Wind(w.updraft + w.updraft_center, w.headwind + w.headwind_center),
        Wind(w.updraft + w.updraft_outer, w.headwind + w.headwind_outer, w.outward_outer),
    )


class PanelLoads(NamedTuple):
    """Loads on one panel in its axes, lbf and ft lbf; `tail_downward` acts at the boom's end."""

    forward: Any
    sideward: Any
    downward: Any
    tail_downward: Any
    moment: Any


def panel_loads(flow, speed, aileron, elevator, density, p):
    """Return the loads on one panel (Gibson et al. 2011, Eqs. 36-43).

    L_w = q_i S (C_Lα α_i + C_Lδ δ_a),  L_t = q_i S_t C_Lα (α_i + δ_e),
    D = q S (C_D0 + κ C_Lw²),  M = q_i c S (C_M0 + C_Mδ δ_a).

    speed: V of q, ft/s
    """
    q_local, q = density * flow.speed**2 / 2, density * speed**2 / 2
    S = p.panel_span * p.chord
    CL = p.lift_slope * flow.alpha + p.aileron_lift * aileron
    tail = q_local * p.tail_area * p.lift_slope * (flow.alpha + elevator)
    lift = q_local * S * CL + tail
    drag = q * S * (p.zero_lift_drag + p.induced_drag * CL**2)
    sin, cos = ca.sin(flow.alpha), ca.cos(flow.alpha)
    along = drag * ca.cos(flow.sideslip)
    moment = q_local * p.chord * S * (p.zero_lift_moment + p.aileron_moment * aileron)
    return PanelLoads(
        lift * sin - along * cos,
        -drag * ca.sin(flow.sideslip),
        -lift * cos - along * sin,
        -tail * cos,
        moment,
    )


def lagrangian_rates(x, u, density, p, winds):
    """Return dX/dt of the aircraft by the Euler-Lagrange equations, as CasADi expressions.

    density: slug/ft^3, or 0 for flight without air
    winds: velocity of the air at each panel, ft/s (`winds_of`)

    The airflow at a panel is its inertial velocity minus the velocity of the air. Source:
    Goldstein, Classical Mechanics, Section 1.4.
    """
    r = ca.SX.sym("r", 4)
    v = ca.SX.sym("v", 4)
    panels = panels_at(r, v, p)
    kinetic = sum(kinetic_energy(panel, r, v, p) for panel in panels)
    force = _generalized_force(panels, r, v, u, density, p, winds)
    return euler_lagrange(x, kinetic, force, panels, r, v, p)


def euler_lagrange(x, kinetic, force, panels, r, v, p):
    """Return dX/dt from the kinetic energy and the generalized forces.

    r, v: generalized coordinates and their rates, (4,)
    kinetic: kinetic energy, ft lbf
    force: generalized forces, (4,)
    """
    potential = sum(_potential_energy(panel, p) for panel in panels) + p.hinge_stiffness * r[3] ** 2
    momentum = ca.gradient(kinetic, v)
    inertia = ca.jacobian(momentum, v)
    bias = ca.jtimes(momentum, r, v) - ca.gradient(kinetic, r) + ca.gradient(potential, r)
    # The inertia is symmetric and positive definite. L D L' is more accurate than a symbolic QR.
    acceleration = ca.ldl_solve(force - bias, *ca.ldl(inertia))
    return _as_state_rates(x, r, v, acceleration, p)


def panels_at(r, v, p):
    """Return the center, the right and the left panel at given generalized coordinates.

    An outer panel is hinged half a panel span from the center, and its center of mass is half a
    panel span farther out.

    r, v: generalized coordinates and their rates, (4,)
    """
    sin_theta = ca.sin(r[2])
    cos_theta = ca.cos(r[2])
    body = ca.vertcat(
        ca.horzcat(cos_theta, 0, sin_theta),
        ca.horzcat(0, 1, 0),
        ca.horzcat(-sin_theta, 0, cos_theta),
    )
    origin = ca.vertcat(r[0], 0, r[1])
    spin = ca.vertcat(0, v[2], 0)
    wings = []
    for side in (1, -1):
        # The right wing (side 1) rises by a rotation of -η about the body's x axis, the left one by
        # +η.
        roll = -side * r[3]
        roll_rate = -side * v[3]
        lean = ca.vertcat(
            ca.horzcat(1, 0, 0),
            ca.horzcat(0, ca.cos(roll), -ca.sin(roll)),
            ca.horzcat(0, ca.sin(roll), ca.cos(roll)),
        )
        arm = side * p.panel_span / 2
        offset = ca.vertcat(0, arm, 0) + lean @ ca.vertcat(0, arm, 0)
        wing_spin = lean.T @ spin + ca.vertcat(roll_rate, 0, 0)
        wings.append(Panel(origin + body @ offset, body @ lean, wing_spin))
    return Panel(origin, body, spin), wings[0], wings[1]


def kinetic_energy(panel, r, v, p):
    """Return the kinetic energy of one panel, ft lbf."""
    velocity = ca.jtimes(panel.position, r, v)
    inertia = ca.vertcat(p.inertia_roll, p.inertia_pitch, p.inertia_yaw)
    return (p.panel_mass * ca.dot(velocity, velocity) + ca.dot(inertia, panel.spin**2)) / 2


def _potential_energy(panel, p):
    """Return the potential energy of the weight of one panel, ft lbf; z points down."""
    return -p.panel_mass * p.gravity * panel.position[2]


def _generalized_force(panels, r, v, u, density, p, winds):
    """Return the generalized forces (4,) of loads, thrust and hinge dampers."""
    # The drag depends on the speed of the common center of mass relative to the air at a panel.
    velocity = ca.jtimes(sum(panel.position for panel in panels) / 3, r, v)
    force = ca.vertcat(0, 0, 0, -2 * p.hinge_damping * v[3])
    controls = ((u.aileron_center, u.elevator_center), *((u.aileron_outer, u.elevator_outer),) * 2)
    places = ((winds.center, 0), (winds.outer, 1), (winds.outer, -1))
    for panel, (aileron, elevator), (wind, side) in zip(panels, controls, places, strict=True):
        air = ca.vertcat(-wind.headwind, side * wind.outward, -wind.updraft)
        speed = ca.norm_2(velocity - air)
        loads = panel_loads(flow_at(panel, 0, air, r, v), speed, aileron, elevator, density, p)
        force += virtual_work(panel, loads, p.thrust_per_throttle * u.throttle / 3, r, v, p)
    return force


def velocity_at(panel, place, air, r, v):
    """Return the velocity of a point of a panel relative to the air, in panel axes.

    place: the point, in panel axes
    """
    return panel.axes.T @ (ca.jtimes(panel.position + panel.axes @ place, r, v) - air)


def flow_at(panel, behind, air, r, v):
    """Return the flow at a point some ft behind the center of mass of a panel."""
    velocity = velocity_at(panel, ca.vertcat(-behind, 0, 0), air, r, v)
    forward, sideward, downward = ca.vertsplit(velocity)
    speed = ca.norm_2(velocity)
    return Flow(speed, ca.atan2(downward, forward), ca.asin(sideward / speed))


def virtual_work(panel, loads, thrust, r, v, p):
    """Return the generalized forces Q = Σ (∂point/∂r)' F + (∂spin/∂v)' M of one panel.

    The sum includes the forces at the wing and at the tail, and the moment of the section.
    """
    wing = ca.vertcat(loads.forward + thrust, loads.sideward, loads.downward - loads.tail_downward)
    tail = ca.vertcat(0, 0, loads.tail_downward)
    boom_end = panel.position + panel.axes @ ca.vertcat(-p.boom_length, 0, 0)
    work = ca.jacobian(panel.position, r).T @ (panel.axes @ wing)
    work += ca.jacobian(boom_end, r).T @ (panel.axes @ tail)
    return work + ca.jacobian(panel.spin, v).T @ ca.vertcat(0, loads.moment, 0)


def _as_state_rates(x, r, v, acceleration, p):
    """Return dX/dt, computed from the second derivatives of the generalized coordinates.

    The speed V, the angle α and the flight-path angle γ = θ - α are those of the center of mass.
    """
    center = sum(panel.position for panel in panels_at(r, v, p)) / 3
    velocity = ca.jtimes(center, r, v)
    velocity_rate = ca.jtimes(velocity, r, v) + ca.jtimes(velocity, v, acceleration)
    speed = ca.norm_2(velocity)
    gamma_rate = (velocity[2] * velocity_rate[0] - velocity[0] * velocity_rate[2]) / speed**2
    rates = State(
        speed=ca.dot(velocity, velocity_rate) / speed,
        alpha=v[2] - gamma_rate,
        altitude=-velocity[2],
        pitch=v[2],
        pitch_rate=acceleration[2],
        dihedral=v[3],
        dihedral_rate=acceleration[3],
    )
    return State(*(at_state(rate, x, r, v, p) for rate in rates))


def at_state(expression, x, r, v, p):
    """Return an expression in which the state x replaces the generalized coordinates and their
    rates.

    The center panel is (s/3) sin η below the center of mass, where s is the panel span.
    """
    height = p.panel_span / 3 * ca.sin(x.dihedral)
    height_rate = p.panel_span / 3 * ca.cos(x.dihedral) * x.dihedral_rate
    sin_theta = ca.sin(x.pitch)
    cos_theta = ca.cos(x.pitch)
    gamma = x.pitch - x.alpha
    position = ca.vertcat(height * sin_theta, height * cos_theta - x.altitude, x.pitch, x.dihedral)
    velocity = ca.vertcat(
        x.speed * ca.cos(gamma) + height_rate * sin_theta + height * cos_theta * x.pitch_rate,
        -x.speed * ca.sin(gamma) + height_rate * cos_theta - height * sin_theta * x.pitch_rate,
        x.pitch_rate,
        x.dihedral_rate,
    )
    return ca.substitute(expression, ca.vertcat(r, v), ca.vertcat(position, velocity))
