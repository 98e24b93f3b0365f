"""Where each panel is and how the air meets it.

Axes: x forward, y to the right, z down, at the center of mass of the whole aircraft. A panel's reference
point is its own center of mass, at mid-span on the quarter chord. Wings bend up: with dihedral η the center
panel sits (s/3) sin η below the common center of mass and each outer panel (s/6) sin η above it.
The right and the left panel mirror each other, so one "outer" panel stands for both.

An updraft w (ft/s, positive up, the same at every panel) moves the air by (0, 0, -w) in north, east, down. Relative
to the air every panel then moves by w downward more, which in body axes is (-w sin θ, 0, w cos θ).
"""

from __future__ import annotations

from typing import NamedTuple

import casadi as ca

from hfa_model.parameters import Parameters
from hfa_model.vectors import Quantity, State


class Flow(NamedTuple):
    """Air relative to one panel, in panel axes: speed (ft/s), angle of attack and sideslip (rad)."""

    speed: Quantity
    alpha: Quantity
    sideslip: Quantity


def center_height(dihedral: Quantity, p: Parameters[Quantity]) -> Quantity:
    """z_c = (s/3) sin η: the center panel below the center of mass, ft."""
    return p.panel_span / 3 * ca.sin(dihedral)


def outer_height(dihedral: Quantity, p: Parameters[Quantity]) -> Quantity:
    """z_o = -(s/6) sin η: an outer panel above the center of mass (negative), ft."""
    return -p.panel_span / 6 * ca.sin(dihedral)


def airspeed(x: State[Quantity], updraft: Quantity = 0.0) -> Quantity:
    """V_a = sqrt(V² + w² - 2 V w sin γ): the speed of the center of mass relative to the air, ft/s; V in still air."""
    if isinstance(updraft, float) and updraft == 0.0:
        return x.speed
    return ca.sqrt(x.speed**2 + updraft**2 - 2 * x.speed * updraft * ca.sin(x.pitch - x.alpha))


def angle_of_attack(x: State[Quantity], updraft: Quantity = 0.0) -> Quantity:
    """α_a = atan2(V sin α + w cos θ, V cos α - w sin θ): of the center of mass through the air, rad; α in still air."""
    if isinstance(updraft, float) and updraft == 0.0:
        return x.alpha
    return ca.atan2(x.speed * ca.sin(x.alpha) + updraft * ca.cos(x.pitch), _forward(x, updraft))


def center_flow(x: State[Quantity], p: Parameters[Quantity], updraft: Quantity = 0.0) -> Flow:
    """u = V cos α + q z_c - w sin θ,  w_c = V sin α + (s/3) cos η η' + w cos θ  (Gibson et al. 2011, Eqs. 75-76)."""
    forward = _forward(x, updraft) + x.pitch_rate * center_height(x.dihedral, p)
    return flow_of(forward, 0.0, _hinge_descent(x, p, updraft))


def outer_flow(x: State[Quantity], p: Parameters[Quantity], updraft: Quantity = 0.0) -> Flow:
    """u = V cos α + q z_o - w sin θ,  v = w_h sin η,  w_o = w_h cos η - (s/2) η',
    w_h = V sin α + (s/3) cos η η' + w cos θ.

    w_h is the descent of the hinge through the air, split along and across the outer panel (Gibson et al. 2011,
    Eqs. 69, 77-78).
    """
    hinge = _hinge_descent(x, p, updraft)
    forward = _forward(x, updraft) + x.pitch_rate * outer_height(x.dihedral, p)
    normal = hinge * ca.cos(x.dihedral) - p.panel_span / 2 * x.dihedral_rate
    return flow_of(forward, hinge * ca.sin(x.dihedral), normal)


def flow_of(forward: Quantity, sideward: Quantity, downward: Quantity) -> Flow:
    """V = |(u, v, w)|,  α = atan2(w, u),  β = asin(v / V)  (Gibson et al. 2011, Eq. 14)."""
    speed = ca.sqrt(forward**2 + sideward**2 + downward**2)
    return Flow(speed, ca.atan2(downward, forward), ca.asin(sideward / speed))


def _forward(x: State[Quantity], updraft: Quantity) -> Quantity:
    return x.speed * ca.cos(x.alpha) - updraft * ca.sin(x.pitch)


def _hinge_descent(x: State[Quantity], p: Parameters[Quantity], updraft: Quantity) -> Quantity:
    descent = x.speed * ca.sin(x.alpha) + p.panel_span / 3 * ca.cos(x.dihedral) * x.dihedral_rate
    return descent + updraft * ca.cos(x.pitch)
