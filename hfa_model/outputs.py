"""What a flight can be watched by besides its states: outputs of state, input and air, each declared once.

Axes as in `kinematics.py`: x forward, y to the right, z down. Accelerations and load factors are those of an
accelerometer fixed to the panel, so that steady level flight has a load factor of 1.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from typing import NamedTuple

import casadi as ca

from hfa_model.aerodynamics import Loads, aircraft_loads
from hfa_model.atmosphere import density
from hfa_model.dynamics import rates_from_loads
from hfa_model.kinematics import angle_of_attack, center_flow, center_height, outer_flow, outer_height
from hfa_model.parameters import Parameters
from hfa_model.variants import Variant
from hfa_model.vectors import STATE_UNITS, STATES, Input, Quantity, State
from hfa_model.winds import Air, Winds, winds_of


class Moment(NamedTuple):
    """Everything that an output may look at, at one instant: numbers or CasADi expressions."""

    x: State[Quantity]
    u: Input[Quantity]
    p: Parameters[Quantity]
    air: Winds
    loads: Loads[Quantity]
    rates: State[Quantity]


class Output(NamedTuple):
    """One output: its unit, what it means, and how it follows from a `Moment`."""

    unit: str
    meaning: str
    of: Callable[[Moment], Quantity]


def moment_of(
    x: State[Quantity], u: Input[Quantity], p: Parameters[Quantity], variant: Variant, air: Air = 0.0
) -> Moment:
    """Loads and rates at (x, u) in air that rises, ft/s, or with the wind at each panel."""
    winds = winds_of(air)
    loads = aircraft_loads(x, u, density(x.altitude), p, variant, winds)
    return Moment(x, u, p, winds, loads, rates_from_loads(x, loads, p, variant))


class outputs_of(Mapping[str, Quantity]):  # a function to its callers
    """Every output at a moment, by name; each is computed when it is looked up."""

    def __init__(self, moment: Moment) -> None:
        self._moment = moment

    def __getitem__(self, name: str) -> Quantity:
        return OUTPUTS[name].of(self._moment)

    def __iter__(self) -> Iterator[str]:
        return iter(OUTPUTS)

    def __len__(self) -> int:
        return len(OUTPUTS)

    def __contains__(self, name: object) -> bool:
        return name in OUTPUTS


def unit_of(name: str) -> str:
    """Unit of an output or a state."""
    return str(getattr(STATE_UNITS, name)) if name in STATES else OUTPUTS[name].unit


def _vertical_acceleration(m: Moment) -> Quantity:
    """V (α' - q), ft/s^2, positive downward: of the path of the center of mass, in the axes of the path."""
    return m.x.speed * (m.rates.alpha - m.x.pitch_rate)


def _load_factor(m: Moment) -> Quantity:
    """n = (L + T sin α) / (m_tot g): force across the path over weight."""
    return (m.loads.lift + m.loads.thrust * ca.sin(m.x.alpha)) / (3 * m.p.panel_mass * m.p.gravity)


def _center_load_factor(m: Moment) -> Quantity:
    """n_c = cos θ - a_z / g of the center panel, a_z downward in body axes."""
    return ca.cos(m.x.pitch) - _body_descent(m, center_height(m.x.dihedral, m.p), 1 / 3) / m.p.gravity


def _outer_load_factor(m: Moment) -> Quantity:
    """n_o = cos θ cos η - (a_z cos η + a_y sin η) / g of an outer panel, across its own plane.

    y = (s/2)(1 + cos η) to the side, so a_y = y'' = -(s/2)(sin η η'' + cos η η'²).
    """
    sin_eta, cos_eta = ca.sin(m.x.dihedral), ca.cos(m.x.dihedral)
    outward = -m.p.panel_span / 2 * (sin_eta * m.rates.dihedral_rate + cos_eta * m.x.dihedral_rate**2)
    descent = _body_descent(m, outer_height(m.x.dihedral, m.p), -1 / 6)
    return ca.cos(m.x.pitch) * cos_eta - (descent * cos_eta + outward * sin_eta) / m.p.gravity


def _body_descent(m: Moment, height: Quantity, factor: float) -> Quantity:
    """a_z = (V sin α)' - q V cos α - q² z + z'',  z = factor s sin η: downward acceleration at height z, ft/s^2."""
    sin_eta, cos_eta = ca.sin(m.x.dihedral), ca.cos(m.x.dihedral)
    sin_alpha, cos_alpha = ca.sin(m.x.alpha), ca.cos(m.x.alpha)
    descent_rate = m.rates.speed * sin_alpha + m.x.speed * cos_alpha * m.rates.alpha
    bending = factor * m.p.panel_span * (cos_eta * m.rates.dihedral_rate - sin_eta * m.x.dihedral_rate**2)
    return descent_rate - m.x.pitch_rate * m.x.speed * cos_alpha - m.x.pitch_rate**2 * height + bending


def _elastic_moment(m: Moment) -> Quantity:
    """H - k_c η' - k_k η: what turns an outer panel about its hinge, spring and damper included."""
    return m.loads.hinge_moment - m.p.hinge_damping * m.x.dihedral_rate - m.p.hinge_stiffness * m.x.dihedral


#: Name -> output. States are outputs too, by their own names.
OUTPUTS: dict[str, Output] = {
    "vertical_acceleration": Output(
        "ft/s^2", "V (alpha' - q) of the center of mass, positive downward", _vertical_acceleration
    ),
    "load_factor": Output("1", "force across the path over weight, at the center of mass", _load_factor),
    "load_factor_center": Output("1", "accelerometer of the center panel, across it", _center_load_factor),
    "load_factor_outer": Output("1", "accelerometer of an outer panel, across it", _outer_load_factor),
    "angle_of_attack": Output(
        "rad", "of the center of mass through the air of the center panel", lambda m: angle_of_attack(m.x, m.air)
    ),
    "alpha_air_center": Output(
        "rad", "angle of attack of the center panel through the air", lambda m: center_flow(m.x, m.p, m.air).alpha
    ),
    "alpha_air_outer": Output(
        "rad", "angle of attack of an outer panel through the air", lambda m: outer_flow(m.x, m.p, m.air).alpha
    ),
    "gamma": Output("rad", "flight-path angle over ground", lambda m: m.x.pitch - m.x.alpha),
    "climb_rate": Output("ft/s", "rate of altitude", lambda m: m.rates.altitude),
    "hinge_moment": Output("ft lbf", "of loads and weight about a hinge", lambda m: m.loads.hinge_moment),
    "hinge_moment_total": Output("ft lbf", "with spring and damper", _elastic_moment),
    "lift_center": Output("lbf", "wing and tail of the center panel", lambda m: m.loads.center.lift),
    "lift_outer": Output("lbf", "wing and tail of one outer panel", lambda m: m.loads.outer.lift),
    "dynamic_pressure": Output(
        "lbf/ft^2", "half density times squared speed", lambda m: density(m.x.altitude) * m.x.speed**2 / 2
    ),
}
