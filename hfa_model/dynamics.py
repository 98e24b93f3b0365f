"""The seven equations of motion, as a pure function of state, loads and parameters."""

from __future__ import annotations

import casadi as ca

from hfa_model.aerodynamics import Loads
from hfa_model.parameters import Parameters
from hfa_model.variants import Variant
from hfa_model.vectors import Quantity, State


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
    sin_alpha = ca.sin(x.alpha)
    cos_alpha = ca.cos(x.alpha)
    speed_rate = (loads.thrust * cos_alpha - loads.drag) / total_mass - p.gravity * ca.sin(gamma)
    alpha_rate = (
        -(loads.thrust * sin_alpha + loads.lift) / (total_mass * x.speed)
        + x.pitch_rate
        + p.gravity * ca.cos(gamma) / x.speed
    )
    return State(
        speed=speed_rate,
        alpha=alpha_rate,
        altitude=x.speed * ca.sin(gamma),
        pitch=x.pitch_rate,
        pitch_rate=_pitch_acceleration(x, loads, p),
        dihedral=x.dihedral_rate,
        dihedral_rate=_dihedral_acceleration(x, speed_rate, alpha_rate, loads, p, variant),
    )


def _pitch_acceleration(
    x: State[Quantity], loads: Loads[Quantity], p: Parameters[Quantity]
) -> Quantity:
    """Return the pitch acceleration q', rad/s^2."""
    sin_eta = ca.sin(x.dihedral)
    cos_eta = ca.cos(x.dihedral)
    gyroscopic = 2 * _bending_inertia(p) * sin_eta * cos_eta * x.dihedral_rate * x.pitch_rate
    return (loads.pitching_moment - gyroscopic) / pitch_inertia(x.dihedral, p)


def pitch_inertia(dihedral: Quantity, p: Parameters[Quantity]) -> Quantity:
    """Return the inertia of the aircraft about its pitch axis, c1 + c2 sin² η, slug ft^2.

    dihedral: η, rad
    p: parameters
    """
    c1 = 3 * p.inertia_pitch
    return c1 + _bending_inertia(p) * ca.sin(dihedral) ** 2


def _bending_inertia(p: Parameters[Quantity]) -> Quantity:
    """Return c2, by which the pitch inertia grows from a dihedral of 0 to 90 deg, slug ft^2."""
    return 2 * p.inertia_yaw - 2 * p.inertia_pitch + p.panel_mass * p.panel_span**2 / 6


def _dihedral_acceleration(
    x: State[Quantity],
    speed_rate: Quantity,
    alpha_rate: Quantity,
    loads: Loads[Quantity],
    p: Parameters[Quantity],
    variant: Variant,
) -> Quantity:
    """Return the dihedral acceleration η'', rad/s^2."""
    sin_eta = ca.sin(x.dihedral)
    cos_eta = ca.cos(x.dihedral)
    descent_rate = speed_rate * ca.sin(x.alpha) + x.speed * ca.cos(x.alpha) * alpha_rate
    inertial = p.panel_mass * p.panel_span / 2 * cos_eta * descent_rate
    spread = p.inertia_pitch - p.inertia_yaw - p.panel_mass * p.panel_span**2 / 12
    d2 = spread * sin_eta * cos_eta * x.pitch_rate**2
    elastic = -p.hinge_damping * x.dihedral_rate - p.hinge_stiffness * x.dihedral
    moment = loads.hinge_moment + elastic + inertial + variant.hinge_coupling(x, p) - d2
    return moment / variant.hinge_inertia(x.dihedral, p)
