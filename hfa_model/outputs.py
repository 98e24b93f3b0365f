"""Outputs of the aircraft other than its states, as functions of state, input and wind.

Axes are as in `kinematics.py`: x forward, y to the right, z down. `vertical_acceleration` is the
acceleration of the center of mass normal to its path. `load_factor` is normal to the path, and is
1 in steady level flight. `load_factor_center` and `load_factor_outer` are the values measured by
an accelerometer normal to the panel.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import casadi as ca

from hfa_model.atmosphere import Air
from hfa_model.dynamics import Loads
from hfa_model.kinematics import (
    PanelWinds,
    angle_of_attack,
    center_height,
    center_velocity,
    flow_of,
    outer_height,
    outer_velocity,
)
from hfa_model.parameters import Input, Parameters, Quantity, State


class Instant(NamedTuple):
    """State, loads and rates at one instant, from which the outputs are computed.

    All entries are numbers or CasADi expressions.

    x: states
    u: inputs
    p: parameters
    winds: winds at the panels
    air: air at the altitude
    loads: loads on the aircraft
    rates: dx/dt
    """

    x: State[Quantity]
    u: Input[Quantity]
    p: Parameters[Quantity]
    winds: PanelWinds
    air: Air
    loads: Loads[Quantity]
    rates: State[Quantity]


def _center_load_factor(at: Instant) -> Quantity:
    """Return the load factor n_c = cos θ - a_z / g of the center panel."""
    # θ is the pitch angle, and a_z the downward acceleration of the panel in body axes.
    descent = _body_descent(at, center_height(at.x.dihedral, at.p), factor=1 / 3)
    return ca.cos(at.x.pitch) - descent / at.p.gravity


def _outer_load_factor(at: Instant) -> Quantity:
    """Return n_o = cos θ cos η - (a_z cos η + a_y sin η) / g of an outer panel."""
    # The lateral position of the panel is y = (s/2)(1 + cos η), with the span s of a panel.
    # Therefore a_y = y'' = -(s/2)(sin η η'' + cos η η'²). a_z is the downward acceleration of the
    # panel in body axes.
    sin_eta = ca.sin(at.x.dihedral)
    cos_eta = ca.cos(at.x.dihedral)
    outward = (
        -at.p.panel_span / 2 * (sin_eta * at.rates.dihedral_rate + cos_eta * at.x.dihedral_rate**2)
    )
    descent = _body_descent(at, outer_height(at.x.dihedral, at.p), factor=-1 / 6)
    return ca.cos(at.x.pitch) * cos_eta - (descent * cos_eta + outward * sin_eta) / at.p.gravity


def _body_descent(at: Instant, height: Quantity, factor: float) -> Quantity:
    """Return the downward acceleration of a panel in body axes, ft/s^2.

    height: distance of the panel below the center of mass, factor s sin η
    """
    # a_z = (V sin α)' - q V cos α - q² z + z''. z = factor s sin η, `height`, is the distance of
    # the panel below the center of mass. The middles of both outer panels are (s/2) sin η above the
    # center panel, and the center of mass of the three equal panels is 2/3 of this, (s/3) sin η,
    # above it: the factor is 1/3 for the center panel, and 1/3 - 1/2 = -1/6 for an outer one.
    sin_eta = ca.sin(at.x.dihedral)
    cos_eta = ca.cos(at.x.dihedral)
    sin_alpha = ca.sin(at.x.alpha)
    cos_alpha = ca.cos(at.x.alpha)
    descent_rate = at.rates.speed * sin_alpha + at.x.speed * cos_alpha * at.rates.alpha
    bending = (
        factor
        * at.p.panel_span
        * (cos_eta * at.rates.dihedral_rate - sin_eta * at.x.dihedral_rate**2)
    )
    return (
        descent_rate
        - at.x.pitch_rate * at.x.speed * cos_alpha
        - at.x.pitch_rate**2 * height
        + bending
    )


#: Name of an output -> its unit, and its function of an `Instant`. States are also outputs, under
#: their names.
OUTPUTS: dict[str, tuple[str, Callable[[Instant], Quantity]]] = {
    # V (α' - q), normal to the path, positive downward.
    "vertical_acceleration": (
        "ft/s^2",
        lambda at: at.x.speed * (at.rates.alpha - at.x.pitch_rate),
    ),
    # (L + T sin α) / (m_tot g), with the lift L, the thrust T and the mass m_tot of the aircraft.
    "load_factor": (
        "1",
        lambda at: (
            (at.loads.lift + at.loads.thrust * ca.sin(at.x.alpha))
            / (3 * at.p.panel_mass * at.p.gravity)
        ),
    ),
    "load_factor_center": ("1", _center_load_factor),
    "load_factor_outer": ("1", _outer_load_factor),
    # Angle of attack of the center of mass in the air of the center panel, and of each panel in the
    # air there.
    "angle_of_attack": ("rad", lambda at: angle_of_attack(at.x, at.winds.center)),
    "alpha_air_center": (
        "rad",
        lambda at: flow_of(center_velocity(at.x, at.p, at.winds.center)).alpha,
    ),
    "alpha_air_outer": (
        "rad",
        lambda at: flow_of(outer_velocity(at.x, at.p, at.winds.outer)).alpha,
    ),
    "gamma": ("rad", lambda at: at.x.pitch - at.x.alpha),  # relative to the ground
    "climb_rate": ("ft/s", lambda at: at.rates.altitude),
    # Moment on an outer panel about its hinge: H of loads and weight, and H - k_c η' - k_k η with
    # the damper k_c and the spring k_k.
    "hinge_moment": ("ft lbf", lambda at: at.loads.hinge_moment),
    "hinge_moment_total": (
        "ft lbf",
        lambda at: (
            at.loads.hinge_moment
            - at.p.hinge_damping * at.x.dihedral_rate
            - at.p.hinge_stiffness * at.x.dihedral
        ),
    ),
    # Lift of wing and tail of one panel.
    "lift_center": ("lbf", lambda at: at.loads.center.lift),
    "lift_outer": ("lbf", lambda at: at.loads.outer.lift),
    "dynamic_pressure": ("lbf/ft^2", lambda at: at.air.density * at.x.speed**2 / 2),
    # Loads on the entire aircraft; the moment is about the center of mass.
    "lift": ("lbf", lambda at: at.loads.lift),
    "drag": ("lbf", lambda at: at.loads.drag),
    "thrust": ("lbf", lambda at: at.loads.thrust),
    "pitching_moment": ("ft lbf", lambda at: at.loads.pitching_moment),
    "weight": ("lbf", lambda at: 3 * at.p.panel_mass * at.p.gravity),
    "reference_area": ("ft^2", lambda at: 3 * at.p.panel_span * at.p.chord),  # without tails
    "reference_chord": ("ft", lambda at: at.p.chord),
    "mach": ("1", lambda at: at.x.speed / at.air.sound),
}
