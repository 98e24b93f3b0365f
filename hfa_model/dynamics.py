"""The seven equations of motion, as a pure function of state, loads and parameters."""

from __future__ import annotations

from typing import Generic, NamedTuple

import casadi as ca

from hfa_model.kinematics import (
    STILL_AIR,
    Flow,
    PanelWinds,
    airspeed,
    center_height,
    center_velocity,
    flow_of,
    outer_velocity,
)
from hfa_model.parameters import Input, Parameters, Quantity, State, T
from hfa_model.variants import Variant


class PanelLoads(NamedTuple, Generic[T]):
    """Loads on one panel in the axes of this panel, from wing and tail unless stated otherwise.

    lift: lbf
    drag: lbf
    forward: force at the reference point, lbf
    sideward: force at the reference point, lbf
    downward: force at the reference point, lbf
    tail_downward: part of `downward` from the tail, lbf, which acts at the end of the boom
    moment: moment of the wing section about the quarter chord, ft lbf
    """

    lift: T
    drag: T
    forward: T
    sideward: T
    downward: T
    tail_downward: T
    moment: T


class Loads(NamedTuple, Generic[T]):
    """Loads on the aircraft.

    lift: perpendicular to the flight path, lbf
    drag: parallel to the flight path, lbf
    pitching_moment: about the center of mass, ft lbf
    hinge_moment: moment on one outer panel about its hinge, without spring and damper, ft lbf
    thrust: lbf
    center: loads on the center panel
    outer: loads on one outer panel
    """

    lift: T
    drag: T
    pitching_moment: T
    hinge_moment: T
    thrust: T
    center: PanelLoads[T]
    outer: PanelLoads[T]


def panel_loads(
    flow: Flow,
    speed: Quantity,
    aileron: Quantity,
    elevator: Quantity,
    density: Quantity,
    p: Parameters[Quantity],
) -> PanelLoads[Quantity]:
    """Return the loads on one panel.

    L_w = q_i S (C_Lα α_i + C_Lδ δ_a),  L_t = q_i S_t C_Lα (α_i + δ_e),
    D = q S (C_D0 + κ C_Lw²),  M = q_i c S (C_M0 + C_Mδ δ_a).

    L_w and L_t are the lifts of wing and tail, S and S_t their areas, c is the chord, and C_Lw =
    L_w/(q_i S). q_i = ½ρV_i² contains the speed V_i relative to the air at the panel. The drag
    contains q = ½ρV² with the speed V of the center of mass, and the tail has no drag, as in the
    published matrices.

    flow: air relative to the panel: V_i, α_i, sideslip
    speed: V relative to the air, or to the ground (`aircraft_loads`), ft/s
    aileron: δ_a, rad
    elevator: δ_e, rad
    density: ρ, slug/ft^3
    p: parameters

    Source: Gibson et al. 2011, Eqs. 36-43.
    """
    area = p.panel_span * p.chord
    local_pressure = density * flow.speed**2 / 2
    lift_coefficient = p.lift_slope * flow.alpha + p.aileron_lift * aileron
    wing_lift = local_pressure * area * lift_coefficient
    tail_lift = local_pressure * p.tail_area * p.lift_slope * (flow.alpha + elevator)
    drag = density * speed**2 / 2 * area * (p.zero_lift_drag + p.induced_drag * lift_coefficient**2)
    moment = local_pressure * p.chord * area * (p.zero_lift_moment + p.aileron_moment * aileron)
    lift = wing_lift + tail_lift
    sin_alpha = ca.sin(flow.alpha)
    cos_alpha = ca.cos(flow.alpha)
    along_panel = drag * ca.cos(flow.sideslip)
    return PanelLoads(
        lift=lift,
        drag=drag,
        forward=lift * sin_alpha - along_panel * cos_alpha,
        sideward=-drag * ca.sin(flow.sideslip),
        downward=-lift * cos_alpha - along_panel * sin_alpha,
        tail_downward=-tail_lift * cos_alpha,
        moment=moment,
    )


def aircraft_loads(
    x: State[Quantity],
    u: Input[Quantity],
    density: Quantity,
    p: Parameters[Quantity],
    variant: Variant,
    winds: PanelWinds = STILL_AIR,
) -> Loads[Quantity]:
    """Return the loads on the aircraft: the forces on its panels, their sums, and the moments.

    x: states
    u: inputs
    density: slug/ft^3
    p: parameters
    variant: variant of the equations
    winds: winds at the panels; the drag of a panel depends on the airspeed
    """
    center_speed = airspeed(x, winds.center)
    outer_speed = airspeed(x, winds.outer)
    center_flow = flow_of(center_velocity(x, p, winds.center))
    outer_flow = flow_of(outer_velocity(x, p, winds.outer))
    center = panel_loads(center_flow, center_speed, u.aileron_center, u.elevator_center, density, p)
    outer = panel_loads(outer_flow, outer_speed, u.aileron_outer, u.elevator_outer, density, p)
    return sum_of_panels(x, u, center, outer, p, variant)


def sum_of_panels(
    x: State[Quantity],
    u: Input[Quantity],
    center: PanelLoads[Quantity],
    outer: PanelLoads[Quantity],
    p: Parameters[Quantity],
    variant: Variant,
) -> Loads[Quantity]:
    """Return the loads on the aircraft, summed over its panels (c: center, o: one outer, t: tail).

    X = X_c + 2 X_o,  Z = Z_c + 2 (Z_o cos η + Y_o sin η),
    D = -(X cos α + Z sin α),  L = X sin α - Z cos α,
    M = M_c + 2 π M_o + l_b (Z_tc + 2 Z_to cos η) + z_c X_c - 2 l X_o,
    H = -(s/2) Z_o - (s/2) m g cos η cos θ.

    X, Y and Z are the forward, sideward and downward forces, M the pitching moment and H the hinge
    moment. η is the dihedral, θ the pitch angle, s and m are the span and mass of a panel, l_b is
    the boom length, and z_c the distance of the center panel below the center of mass.

    x: states
    u: inputs; the throttle determines the thrust
    center: loads on the center panel
    outer: loads on one outer panel
    p: parameters
    variant: determines the lever arm l of the outer panels' forward force and the projection factor
        π of their section moment (`variants.py`)

    Lift and drag are perpendicular and parallel to the path over ground, also in wind.
    Source: Gibson et al. 2011, Eqs. 31-44.
    """
    sin_eta = ca.sin(x.dihedral)
    cos_eta = ca.cos(x.dihedral)
    sin_alpha = ca.sin(x.alpha)
    cos_alpha = ca.cos(x.alpha)
    forward = center.forward + 2 * outer.forward
    downward = center.downward + 2 * (outer.downward * cos_eta + outer.sideward * sin_eta)
    pitching_moment = (
        center.moment
        + 2 * variant.section_projection(x.dihedral) * outer.moment
        + p.boom_length * (center.tail_downward + 2 * cos_eta * outer.tail_downward)
        + center_height(x.dihedral, p) * center.forward
        - 2 * variant.outer_lever(x.dihedral, p) * outer.forward
    )
    weight_moment = p.panel_mass * p.gravity * cos_eta * ca.cos(x.pitch)
    return Loads(
        lift=forward * sin_alpha - downward * cos_alpha,
        drag=-(forward * cos_alpha + downward * sin_alpha),
        pitching_moment=pitching_moment,
        hinge_moment=-p.panel_span / 2 * (outer.downward + weight_moment),
        thrust=p.thrust_per_throttle * u.throttle,
        center=center,
        outer=outer,
    )


def rates_from_loads(
    x: State[Quantity], loads: Loads[Quantity], p: Parameters[Quantity], variant: Variant
) -> State[Quantity]:
    """Return the rates dX/dt of the states X = [V, α, h, θ, q, η, η'] (paper Section 2.2).

    V'  = (T cos α - D)/m_tot - g sin γ,
    α'  = -(T sin α + L)/(m_tot V) + q + g cos γ / V,
    h'  = V sin γ,
    θ'  = q,
    q'  = (M - 2 c2 sin η cos η η' q) / (c1 + c2 sin² η),  c1 = 3 I_yy,
          c2 = 2 I_zz - 2 I_yy + m s²/6,
    η'' = (H - k_c η' - k_k η + (m s/2) cos η (V' sin α + V cos α α') + coupling - d2) / d3,
    d2  = (I_yy - I_zz - m s²/12) sin η cos η q².

    γ = θ - α is the climb angle, and m_tot = 3 m. m, s and I are the mass, span and inertias of a
    panel, and k_c and k_k are the damping and stiffness of a hinge.

    x: states, with the speed V over ground
    loads: L, D, M, H and T, which contain all effects of wind
    p: parameters
    variant: determines `coupling` and d3 (`variants.py`)

    Arguments and result are numbers or CasADi expressions.
    """
    gamma = x.pitch - x.alpha
    total_mass = 3 * p.panel_mass
    sin_eta = ca.sin(x.dihedral)
    cos_eta = ca.cos(x.dihedral)
    sin_alpha = ca.sin(x.alpha)
    cos_alpha = ca.cos(x.alpha)
    speed_rate = (loads.thrust * cos_alpha - loads.drag) / total_mass - p.gravity * ca.sin(gamma)
    alpha_rate = (
        -(loads.thrust * sin_alpha + loads.lift) / (total_mass * x.speed)
        + x.pitch_rate
        + p.gravity * ca.cos(gamma) / x.speed
    )
    c1, c2 = pitch_inertias(p)
    gyroscopic = 2 * c2 * sin_eta * cos_eta * x.dihedral_rate * x.pitch_rate
    descent_rate = speed_rate * sin_alpha + x.speed * cos_alpha * alpha_rate
    inertial = p.panel_mass * p.panel_span / 2 * cos_eta * descent_rate
    spread = p.inertia_pitch - p.inertia_yaw - p.panel_mass * p.panel_span**2 / 12
    d2 = spread * sin_eta * cos_eta * x.pitch_rate**2
    elastic = -p.hinge_damping * x.dihedral_rate - p.hinge_stiffness * x.dihedral
    about_hinge = loads.hinge_moment + elastic + inertial + variant.hinge_coupling(x, p) - d2
    return State(
        speed=speed_rate,
        alpha=alpha_rate,
        altitude=x.speed * ca.sin(gamma),
        pitch=x.pitch_rate,
        pitch_rate=(loads.pitching_moment - gyroscopic) / (c1 + c2 * sin_eta**2),
        dihedral=x.dihedral_rate,
        dihedral_rate=about_hinge / variant.hinge_inertia(x.dihedral, p),
    )


def pitch_inertias(p: Parameters[Quantity]) -> tuple[Quantity, Quantity]:
    """Return c1 and c2 of the aircraft's inertia about its pitch axis, c1 + c2 sin² η, slug ft^2.

    η is the dihedral.
    """
    c1 = 3 * p.inertia_pitch
    return c1, 2 * p.inertia_yaw - 2 * p.inertia_pitch + p.panel_mass * p.panel_span**2 / 6
