"""The `Model` of a table of derivatives.

Forces and moments:

  L, D, Y = q̄ S (C_L, C_D, C_Y),  moments = q̄ S (b C_l, c C_m, b C_n)

q̄ is the dynamic pressure. S, b and c are the area, span and chord of the wing. Each coefficient is
linear in alpha - alpha_0, beta, p b/2V, q c/2V, r b/2V, alphadot c/2V, the deflections, and the
differences of the Mach number and of u = V/V_0 from the reference condition. C_D also has the term
C_D,CL2 C_L².

The thrust is proportional to the input T at every speed. With C_T,u and the density ρ, it is

  q̄ S C_T = T (ρ/ρ_0) u^(2 + C_T,u/C_T,0),  C_T,0 = C_D,0 + C_D,CL2 C_L,0²

so that dC_T/du is C_T,u at the reference condition, where the thrust of level flight has the
coefficient C_T,0. With dT/dV, it is T u^(V_0 dT/dV / (q̄_0 S C_T,0)).

The derivatives are about a point of the aircraft, the entry `cg`. If the parameter `cg` has another
value, the center of gravity is Δ behind this point, along the body axis x. The aerodynamic forces
and the thrust then add -Δ Z to the pitching moment and Δ Y to the yawing moment about the center of
gravity. Mass and inertias are unchanged. Derivatives with respect to q and alphadot:

- by default they are unchanged, and their forces act at the point too
- with `tail_arm`, l, they are those of a tail: C_m,q (1 - Δ/l)², C_m,alphadot (1 - Δ/l) and
  C_L,q (1 - Δ/l). Source: B. Etkin, L. D. Reid, *Dynamics of Flight*, 3rd ed., 1996, Section 5.4
- those of AVL are exact: alpha and beta are the angles of the flow at the point, alpha - q Δ/V and
  beta + r Δ/V

The angle of attack alpha_0 of the reference condition defines the body axes. The inertias are about
the body axes. C_l, C_n, p and r are about the axes given by the entry `axes`. The stability axes
are rotated from the body axes by alpha_0.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import casadi as ca

from hfa_aircraft.about import About, Domain
from hfa_aircraft.model import Model
from hfa_aircraft.readers.derivatives.names import (
    CENTER,
    CENTERS,
    INDUCED,
    LARGEST_LIFT,
    TAIL_ARM,
    THRUST_BY_SPEED,
    THRUST_INPUT,
)
from hfa_aircraft.readers.derivatives.plausible import warnings_about
from hfa_aircraft.readers.derivatives.table import DerivativeTable, read_table, table_of
from hfa_aircraft.rigid.aircraft import (
    FORCE,
    GRAVITY,
    LENGTH,
    Motion,
    flow_rates,
    inertia_matrix,
    rigid_aircraft,
    wind_axes,
)
from hfa_aircraft.rigid.atmosphere import air_at
from hfa_aircraft.signals import Signal
from hfa_support.errors import BadInputError
from hfa_support.units import conversion_factor

#: Coefficients of the forces.
_FORCES = ("CL", "CD", "CY")
#: Assumed limits: deviation of alpha from the reference condition, and of beta from 0, rad.
_LARGEST_DEVIATION = 0.3
#: Nominal value of alpha, beta and deflections, rad.
_NOMINAL_ANGLE = 0.1
#: Usual thrust in cruise as a share of the weight, which is that of a lift-to-drag ratio of 10.
_CRUISE_THRUST = 0.1


def read_model(text: str) -> Model:
    """Return the aircraft of a TOML or CSV file of derivatives.

    text: path of the file

    Raises BadInputError if the file cannot be read or an entry is missing, unknown or invalid.
    """
    return _model(read_table(text))


def read_avl(text: str) -> Model:
    """Return the aircraft of a stability file of AVL and a table, "FILE.st?mass=TABLE".

    Raises BadInputError if the table is missing, or as `read_model` does.
    """
    path, _, table = text.partition("?mass=")
    if not table:
        raise BadInputError(
            f"{path} contains no mass, inertias and speed; give --mass TABLE, which has them"
        )
    return _model(read_table(table, path))


def from_derivatives(table: str | Path | Mapping[str, Any]) -> Model:
    """Return the six-degree-of-freedom aircraft of a table of stability derivatives, as a `Model`.

    The table contains geometry, mass, inertias and non-dimensional derivatives. The model has a
    flat Earth and standard air. Its parameters are mass, inertias, gravity and derivatives.

    table: path of a TOML or CSV file, or a dictionary with the same entries. Values are numbers in
        the table's `units`, or texts with a unit, such as "2.4 deg". Derivatives are per rad, or
        those of angles per deg if `per` is "deg".

    Raises BadInputError if `table` is neither a path nor a dictionary, if the file cannot be read,
    or if an entry is missing, unknown or invalid.

    >>> import hfa
    >>> uav = hfa.from_derivatives("examples/uav.toml")
    >>> list(uav.inputs)
    ['thrust', 'elevator', 'aileron', 'rudder']
    """
    if isinstance(table, (str, Path)):
        return _model(read_table(str(table)))
    if not isinstance(table, Mapping):
        kind = type(table).__name__
        raise BadInputError(
            f"the table of derivatives is of type {kind}; give a file or a dictionary"
        )
    return _model(table_of(table))


def _model(table: DerivativeTable) -> Model:
    """Return the aircraft of a table as a `Model`."""
    outputs = {"lift_coefficient": Signal(), "drag_coefficient": Signal()}
    if LARGEST_LIFT in table.values:
        outputs["largest_lift_coefficient"] = Signal()
    # Signals have a unit, a nominal value, and a lower and an upper limit.
    surfaces = {
        name: Signal("rad", _NOMINAL_ANGLE, *limits) for name, limits in table.surfaces.items()
    }
    cruise_thrust = _CRUISE_THRUST * table.values["mass"] * GRAVITY[table.system]
    alpha = table.values.get("alpha", 0.0)
    beta = Signal(
        "rad", _NOMINAL_ANGLE, min=-_LARGEST_DEVIATION, max=_LARGEST_DEVIATION, assumed=True
    )
    return rigid_aircraft(
        table.name,
        _Equations(table),
        system=table.system,
        speed=table.values["speed"],
        altitude=table.values.get("altitude", 0.0),
        alpha=beta._replace(min=alpha + beta.min, max=alpha + beta.max, start=alpha),
        beta=beta,
        inputs={
            THRUST_INPUT: Signal(
                FORCE[table.system], cruise_thrust, *table.thrust, start=cruise_thrust
            ),
            **surfaces,
        },
        parameters=_parameters(table),
        outputs=outputs,
        holds_beta=_can_hold_sideslip(table),
        source=table.source,
        about=About(
            notes=table.notes,
            warnings_about=partial(warnings_about, table),
            equations="derivatives" if table.center is None else "AVL",
            configuration=partial(_configuration, table),
        ),
        domain=_domain(table),
    )


def _domain(table: DerivativeTable) -> Domain:
    """Return the domain: the condition of the derivatives, and the effects of the speed."""
    altitude = table.values.get("altitude", 0.0)
    speed = table.values["speed"]
    sound = float(air_at(altitude, table.system).sound)
    # Derivatives of AVL are those at the Mach number of its run case.
    mach = speed / sound if table.mach is None else table.mach
    alpha = table.values.get("alpha", 0.0)
    slopes = [
        name
        for name, meaning in table.meanings.items()
        if meaning.argument == "u" and table.derivatives[name]
    ]
    if table.values.get("thrust_slope"):
        slopes.append("thrust_slope")
    reference = {"alpha": alpha, "speed": speed, "altitude": altitude, "mach": mach}
    return Domain(reference=reference, by_speed=tuple(slopes))


def _configuration(
    table: DerivativeTable, x: Any, u: Any, p: Any
) -> dict[str, tuple[float | str, str]]:
    """Return sizes, center of gravity, flap and gear as far as known, name -> (value, unit)."""
    names = {"reference_area": "wing_area", "reference_span": "span", "reference_chord": "chord"}
    found: dict[str, tuple[float | str, str]] = {
        name: (table.values[entry], table.unit(entry)) for name, entry in names.items()
    }
    found |= {name: (word, "") for name, word in table.words.items()}
    shift = 0.0
    if CENTER in table.values:
        center = p[list(_parameters(table)).index(CENTER)]
        shift = (center - table.values[CENTER]) * table.values["chord"]
        found["center_of_gravity"] = center, table.unit(CENTER)
    if table.center is not None:
        place, length = table.center
        x_of_point, *others = place
        # `or` satisfies the type checker: the reader refuses a unit that is no length.
        in_length = conversion_factor(table.unit("chord"), length) or 1.0
        for axis, value in zip("xyz", (x_of_point + shift * in_length, *others), strict=True):
            found[f"center_of_gravity_{axis}"] = value, length
    return found


def _can_hold_sideslip(table: DerivativeTable) -> bool:
    """Return whether two or more control surfaces have a derivative of the roll or yaw moment."""
    # If so, they can balance both moments of an imposed sideslip.
    lateral = {
        meaning.argument
        for meaning in table.meanings.values()
        if meaning.coefficient in ("Cl", "Cn") and meaning.argument in table.surfaces
    }
    return len(lateral) >= 2


def _parameters(table: DerivativeTable) -> dict[str, Signal]:
    """Return name -> signal of the parameters: mass, inertias, gravity and derivatives."""
    mass = table.values["mass"]
    signals = {"mass": Signal(table.unit("mass"), nominal=mass, min=0.0, start=mass)}
    for name in ("Ixx", "Iyy", "Izz", "Ixz"):
        value = table.values.get(name, 0.0)
        nominal = abs(value) or table.values["Ixx"]  # Ixz may be 0
        signals[name] = Signal(table.unit(name), nominal, start=value)
    gravity = GRAVITY[table.system]
    signals["gravity"] = Signal(
        f"{LENGTH[table.system]}/s^2", nominal=gravity, min=0.0, start=gravity
    )
    if CENTER in table.values:
        # CENTERS are the lower and the upper limit.
        signals[CENTER] = Signal(table.unit(CENTER), 0.1, *CENTERS, start=table.values[CENTER])
    for name, value in table.derivatives.items():
        signals[name] = Signal(nominal=abs(value) or 1.0, start=value)
    return signals


class _ForceCoefficients(NamedTuple):
    """Coefficients of lift, drag and side force."""

    lift: Any
    drag: Any
    side: Any


class _Equations:
    """Equations of the aircraft of a table, (x, u, p, w) -> (rates, outputs) by name."""

    def __init__(self, table: DerivativeTable) -> None:
        """Compute what does not depend on the state: the reference condition, and directions."""
        self._table = table
        values = table.values
        self._reference_alpha = values.get("alpha", 0.0)
        air = air_at(values.get("altitude", 0.0), table.system)
        self._reference_mach = values["speed"] / float(air.sound)
        self._reference_pressure = 0.5 * float(air.density) * values["speed"] ** 2
        #: Rotation to body axes from the axes of the moments and the angular rates.
        self._moments_to_body = wind_axes(
            self._reference_alpha if table.axes == "stability" else 0.0, 0.0
        )
        angle = values.get("thrust_angle", 0.0)  # upward
        self._thrust_direction = ca.vertcat(ca.cos(angle), 0.0, -ca.sin(angle))

    def __call__(self, x: Any, u: Any, p: Any, w: Any) -> tuple[dict[str, Any], dict[str, Any]]:
        """Return the rates of the states and the outputs, each as name -> value."""
        values = self._table.values
        motion = Motion(x, p.gravity, self._table.system, p.isa)
        shift, tail = self._center_shift(p)
        variables = self._variables(x, u, motion, shift)
        of_forces = variables | {"q": tail * variables["q"]}
        of_moments = variables | {"q": tail**2 * variables["q"]}
        thrust = self._thrust(x, u, p, motion)
        thrust_force = thrust * self._thrust_direction

        # The rate of alpha follows from the forces without it.
        coefficients = self._force_coefficients(p, of_forces)
        air_force = self._force_in_body_axes(x, motion, coefficients)
        specific_force = (air_force + thrust_force) / p.mass
        alpha_rate = self._alpha_rate(x, p, motion, specific_force)
        alphadot = alpha_rate * values["chord"] / (2.0 * x.speed)
        of_alphadot = _ForceCoefficients(
            *(self._coefficient(name, p, {"alphadot": alphadot}) for name in _FORCES)
        )
        force_of_alphadot = self._force_in_body_axes(x, motion, of_alphadot)
        specific_force += force_of_alphadot / p.mass

        # Aerodynamic force that acts at the point of the derivatives, and the same force without
        # that of alphadot, for the pitching moment in reports. With a tail arm, the forces of q and
        # alphadot act at the tail instead: the powers of `tail` contain their moments.
        steady_force = air_force
        force_at_point = air_force + force_of_alphadot
        if TAIL_ARM in values:
            without_tail = self._force_coefficients(p, variables | {"q": 0.0})
            steady_force = force_at_point = self._force_in_body_axes(x, motion, without_tail)

        # Moment about the center of gravity, which is `shift` behind this point.
        moment = self._aerodynamic_moment(p, motion, of_moments | {"alphadot": tail * alphadot})
        moment -= ca.vertcat(0.0, values.get("thrust_height", 0.0) * thrust_force[0], 0.0)
        _, side_force, down_force = ca.vertsplit(force_at_point + thrust_force)
        moment += shift * ca.vertcat(0.0, -down_force, side_force)
        inertia = inertia_matrix((p.Ixx, p.Iyy, p.Izz), (0.0, p.Ixz, 0.0))
        rates, outputs = motion.rates_and_outputs(specific_force, moment, inertia)

        pressure_area = motion.pressure * values["wing_area"]
        pitching_moment = pressure_area * values["chord"] * self._coefficient("Cm", p, of_moments)
        outputs |= motion.forces(
            lift=pressure_area * coefficients.lift,
            drag=pressure_area * coefficients.drag,
            pitching_moment=pitching_moment - shift * steady_force[2],
            thrust=thrust,
            mass=p.mass,
            area=values["wing_area"],
            chord=values["chord"],
        )
        outputs["lift_coefficient"] = coefficients.lift + of_alphadot.lift
        outputs["drag_coefficient"] = coefficients.drag + of_alphadot.drag
        if LARGEST_LIFT in values:
            outputs["largest_lift_coefficient"] = values[LARGEST_LIFT]
        return rates, outputs

    def _force_in_body_axes(self, x: Any, motion: Motion, coefficients: _ForceCoefficients) -> Any:
        """Return the force q̄ S (C_L, C_D, C_Y) in body axes, (3,)."""
        along_axes = ca.vertcat(-coefficients.drag, coefficients.side, -coefficients.lift)
        along_body_axes = ca.mtimes(wind_axes(x.alpha, 0.0), along_axes)
        return motion.pressure * self._table.values["wing_area"] * along_body_axes

    def _aerodynamic_moment(self, p: Any, motion: Motion, variables: Mapping[str, Any]) -> Any:
        """Return the moment q̄ S (b C_l, c C_m, b C_n) in body axes, (3,)."""
        values = self._table.values
        coefficients = [self._coefficient(name, p, variables) for name in ("Cl", "Cm", "Cn")]
        lengths = ca.vertcat(values["span"], values["chord"], values["span"])
        pressure_area = motion.pressure * values["wing_area"]
        return ca.mtimes(self._moments_to_body, pressure_area * lengths * ca.vertcat(*coefficients))

    def _center_shift(self, p: Any) -> tuple[Any, Any]:
        """Return the shift Δ of the center of gravity, and the ratio of tail arms 1 - Δ/l."""
        values = self._table.values
        if CENTER not in values:
            return 0.0, 1.0
        shift = (p.cg - values[CENTER]) * values["chord"]
        ratio_of_arms = 1.0 - shift / values[TAIL_ARM] if TAIL_ARM in values else 1.0
        return shift, ratio_of_arms

    def _force_coefficients(self, p: Any, variables: Mapping[str, Any]) -> _ForceCoefficients:
        """Return the coefficients of the forces, with induced drag."""
        lift, drag, side = (self._coefficient(name, p, variables) for name in _FORCES)
        return _ForceCoefficients(lift, drag + getattr(p, INDUCED, 0.0) * lift**2, side)

    def _thrust(self, x: Any, u: Any, p: Any, motion: Motion) -> Any:
        """Return the thrust; the input T is the thrust at the reference condition."""
        # In level flight, the thrust coefficient is that of the drag. A power of the speed ratio
        # u = V/V_0 has the given slope at u = 1, and does not change the sign of the thrust:
        # T u^(V_0 dT/dV / (q̄_0 S C_T,0)) with dT/dV, T (q̄/q̄_0) u^(C_T,u/C_T,0) with C_T,u.
        values = self._table.values
        level_coefficient = p.CD_0 + getattr(p, INDUCED, 0.0) * p.CL_0**2  # C_T,0
        speed_ratio = x.speed / values["speed"]
        if "thrust_slope" in values:
            level_thrust = self._reference_pressure * values["wing_area"] * level_coefficient
            exponent = values["speed"] * values["thrust_slope"] / level_thrust
            return u.thrust * speed_ratio**exponent
        if THRUST_BY_SPEED in self._table.derivatives:
            exponent = getattr(p, THRUST_BY_SPEED) / level_coefficient
            return u.thrust * motion.pressure / self._reference_pressure * speed_ratio**exponent
        return u.thrust

    def _variables(self, x: Any, u: Any, motion: Motion, shift: Any) -> dict[str, Any]:
        """Return the variables that derivatives multiply, suffix -> value, without alphadot."""
        values = self._table.values
        alpha, beta = x.alpha, x.beta
        # AVL's angles are those of the flow at its point, `shift` ahead of the center of gravity.
        if self._table.center is not None:
            alpha = alpha - x.pitch_rate * shift * ca.cos(x.alpha) / x.speed
            beta = beta + x.yaw_rate * shift / x.speed
        half_span = values["span"] / (2.0 * x.speed)
        half_chord = values["chord"] / (2.0 * x.speed)
        roll_rate, pitch_rate, yaw_rate = ca.vertsplit(
            ca.mtimes(self._moments_to_body.T, motion.rates)
        )
        return {
            "0": 1.0,
            "alpha": alpha - self._reference_alpha,
            "beta": beta,
            "p": roll_rate * half_span,
            "q": pitch_rate * half_chord,
            "r": yaw_rate * half_span,
            "mach": motion.mach - self._reference_mach,
            "u": x.speed / values["speed"] - 1.0,
            **{name: getattr(u, name) for name in self._table.surfaces},
        }

    def _coefficient(self, name: str, p: Any, variables: Mapping[str, Any]) -> Any:
        """Return an aerodynamic coefficient, the sum of derivatives times variables."""
        total: Any = 0.0
        for derivative, meaning in self._table.meanings.items():
            if meaning.coefficient == name and meaning.argument in variables:
                total = total + getattr(p, derivative) * variables[meaning.argument]
        return total

    def _alpha_rate(self, x: Any, p: Any, motion: Motion, specific_force: Any) -> Any:
        """Return the rate of alpha, rad/s, including the effect of the lift C_L,alphadot."""
        # The lift of α', q̄ S C_L,alphadot c α'/(2V), divided by m V cos β, reduces α' itself:
        # α' = rate - slope α'.
        # specific_force: force without that of alphadot, divided by mass, in body axes, (3,)
        values = self._table.values
        _, rate, _ = flow_rates(motion.velocity, motion.acceleration(specific_force))
        acceleration_scale = (
            motion.pressure * values["wing_area"] * values["chord"] / (2.0 * x.speed * p.mass)
        )
        slope = getattr(p, "CL_alphadot", 0.0) * acceleration_scale / (x.speed * ca.cos(x.beta))
        return rate / (1.0 + slope)
