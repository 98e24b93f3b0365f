"""Position of each panel and its velocity relative to the air.

The axes are x forward, y to the right and z down, at the center of mass of the entire aircraft. The
reference point of a panel is its center of mass, at mid-span on the quarter chord. The wings bend
up. With dihedral η the center panel is (s/3) sin η below the common center of mass, and each outer
panel is (s/6) sin η above the common center of mass. The right and left panels are mirror images.
One "outer" panel therefore represents both.

The air at a panel moves by (-h, ±o, -w) north, east and down, ft/s, with headwind h, outward wind o
and updraft w. These winds add h forward, o inward and w downward to the velocity of the panel
relative to the air, in body axes (h cos θ - w sin θ, ∓o, h sin θ + w cos θ).

The aircraft moves north in its plane of symmetry. The winds at both outer panels are mirror images.
A difference between left and right would cause roll and yaw. There is no side wind at the center
panel.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import casadi as ca

from hfa_model.parameters import Parameters, Quantity, State


class Wind(NamedTuple):
    """Velocity of the air at a panel, relative to the ground.

    updraft: upward, ft/s
    headwind: from ahead, ft/s
    outward: toward the wing tips, ft/s
    """

    updraft: Quantity = 0.0
    headwind: Quantity = 0.0
    outward: Quantity = 0.0


class PanelWinds(NamedTuple):
    """Winds at the panels.

    center: wind at the center panel
    outer: wind at each outer panel
    """

    center: Wind
    outer: Wind


STILL_AIR = PanelWinds(Wind(), Wind())
#: Disturbances of a model, ft/s: a component of `Wind` at all panels, at the center panel or at the
#: outer panels.
DISTURBANCES = (
    *("updraft", "updraft_center", "updraft_outer"),
    *("headwind", "headwind_center", "headwind_outer", "outward_outer"),
)


def winds_of(w: Any) -> PanelWinds:
    """Return the winds at the panels, each the sum of the disturbances that act on the panel, ft/s.

    w: named tuple of disturbances in `DISTURBANCES`; one without a panel acts on all panels
    """
    sums: dict[str, dict[str, Quantity]] = {"center": {}, "outer": {}}
    for name, value in w._asdict().items():
        component, _, panel = name.partition("_")
        for name_of_panel in (panel,) if panel else tuple(sums):
            at_panel = sums[name_of_panel]
            at_panel[component] = at_panel.get(component, 0.0) + value
    return PanelWinds(Wind(**sums["center"]), Wind(**sums["outer"]))


class Velocity(NamedTuple):
    """Velocity of a panel relative to the air, in the axes of this panel.

    forward: ft/s
    sideward: toward the center panel, ft/s
    downward: ft/s
    """

    forward: Quantity
    sideward: Quantity
    downward: Quantity


class Flow(NamedTuple):
    """Air flow at one panel, in the axes of this panel.

    speed: speed of the panel relative to the air, ft/s
    alpha: angle of attack, rad
    sideslip: rad
    """

    speed: Quantity
    alpha: Quantity
    sideslip: Quantity


def center_height(dihedral: Quantity, p: Parameters[Quantity]) -> Quantity:
    """Return z_c = (s/3) sin η, ft, the distance of the center panel below the center of mass.

    dihedral: η, rad
    p: parameters, with the span s of a panel
    """
    return p.panel_span / 3 * ca.sin(dihedral)


def outer_height(dihedral: Quantity, p: Parameters[Quantity]) -> Quantity:
    """Return z_o = -(s/6) sin η, ft, the distance of an outer panel below the center of mass.

    The distance is negative if the panel is above the center of mass.

    dihedral: η, rad
    p: parameters, with the span s of a panel
    """
    return -p.panel_span / 6 * ca.sin(dihedral)


def airspeed(x: State[Quantity], wind: Wind) -> Quantity:
    """Return the speed of the center of mass relative to the air at a panel, ft/s.

    V_a = sqrt(V² + w² - 2 V w sin γ + 2 V h cos γ + h² + o²), with the climb angle γ = θ - α. In
    still air V_a = V.

    x: states, with the speed V over ground
    wind: updraft w, headwind h and outward wind o at the panel
    """
    if _is_still(wind):
        return x.speed
    w = wind.updraft
    h = wind.headwind
    gamma = x.pitch - x.alpha
    with_updraft = x.speed**2 + w**2 - 2 * x.speed * w * ca.sin(gamma)
    return ca.sqrt(with_updraft + 2 * x.speed * h * ca.cos(gamma) + h**2 + wind.outward**2)


def angle_of_attack(x: State[Quantity], wind: Wind) -> Quantity:
    """Return the angle of attack of the center of mass in the air at a panel, rad.

    α_a = atan2(V sin α + w cos θ + h sin θ, V cos α - w sin θ + h cos θ), with the pitch angle θ.
    In still air α_a = α.

    x: states
    wind: updraft w and headwind h at the panel; the outward wind has no effect
    """
    if _is_still(wind):
        return x.alpha
    downward = (
        x.speed * ca.sin(x.alpha) + wind.updraft * ca.cos(x.pitch) + wind.headwind * ca.sin(x.pitch)
    )
    return ca.atan2(downward, _forward_velocity(x, wind))


def center_velocity(x: State[Quantity], p: Parameters[Quantity], wind: Wind) -> Velocity:
    """Return the velocity (u, v, w_c) of the center panel relative to the air there.

    u = V cos α + q z_c - w sin θ + h cos θ,
    v = 0,
    w_c = V sin α + (s/3) cos η η' + w cos θ + h sin θ,

    with the updraft w and headwind h at the center panel, the pitch rate q, the dihedral η, the
    span s of a panel, and z_c as in `center_height`. The hinges, at the ends of this panel, have
    the same velocity. Source: Gibson et al. 2011, Eqs. 75-76.

    x: states
    p: parameters
    wind: wind at the center panel
    """
    forward = _forward_velocity(x, wind) + x.pitch_rate * center_height(x.dihedral, p)
    descent = x.speed * ca.sin(x.alpha) + p.panel_span / 3 * ca.cos(x.dihedral) * x.dihedral_rate
    downward = descent + wind.updraft * ca.cos(x.pitch) + wind.headwind * ca.sin(x.pitch)
    return Velocity(forward, 0.0, downward)


def outer_velocity(x: State[Quantity], p: Parameters[Quantity], wind: Wind) -> Velocity:
    """Return the velocity (u, v, w_o) of an outer panel relative to the air there.

    u = V cos α + q z_o - w sin θ + h cos θ,
    v = w_h sin η + o cos η,
    w_o = w_h cos η - o sin η - (s/2) η',

    with the updraft w, headwind h and outward wind o at the outer panels, the pitch rate q, the
    dihedral η, the span s of a panel, z_o as in `outer_height`, and the downward velocity w_h of
    the hinge relative to the air at the outer panels.
    Source: Gibson et al. 2011, Eqs. 69, 77-78.

    x: states
    p: parameters
    wind: wind at the outer panels
    """
    hinge = center_velocity(x, p, wind).downward  # which moves like the center panel
    sin_eta = ca.sin(x.dihedral)
    cos_eta = ca.cos(x.dihedral)
    forward = _forward_velocity(x, wind) + x.pitch_rate * outer_height(x.dihedral, p)
    normal = hinge * cos_eta - wind.outward * sin_eta - p.panel_span / 2 * x.dihedral_rate
    return Velocity(forward, hinge * sin_eta + wind.outward * cos_eta, normal)


def flow_of(velocity: Velocity) -> Flow:
    """Return the flow at a panel that moves relative to the air with a velocity (u, v, w).

    V = |(u, v, w)|, α = atan2(w, u), β = asin(v / V). Source: Gibson et al. 2011, Eq. 14.
    """
    forward, sideward, downward = velocity
    speed = ca.sqrt(forward**2 + sideward**2 + downward**2)
    return Flow(speed, ca.atan2(downward, forward), ca.asin(sideward / speed))


def _is_still(wind: Wind) -> bool:
    """Return whether all components of a wind are the number 0."""
    # The result is False for a wind with a CasADi expression.
    return all(isinstance(part, float) and part == 0.0 for part in wind)


def _forward_velocity(x: State[Quantity], wind: Wind) -> Quantity:
    """Return the forward component of the velocity relative to the air, ft/s."""
    # The component is V cos α - w sin θ + h cos θ in body axes, with the speed V over ground.
    return (
        x.speed * ca.cos(x.alpha) - wind.updraft * ca.sin(x.pitch) + wind.headwind * ca.cos(x.pitch)
    )
