"""The `Model` of a rigid aircraft in standard air over a flat Earth, from its forces and moments.

The equations of an aircraft create a `Motion` from the state, compute forces and moments with the
`Motion`, and return `Motion.rates_and_outputs`.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import casadi as ca
import numpy as np

from hfa_aircraft.about import About, Domain, Source
from hfa_aircraft.model import Model
from hfa_aircraft.rigid.atmosphere import ALTITUDES, air_at
from hfa_aircraft.signals import ISA, Signal
from hfa_support.units import FOOT, STANDARD_GRAVITY

#: Relative rounding of tabulated inertias.
_ROUNDING = 1e-3
#: Speed, angle of attack and sideslip relative to the air; body-axis angular rates; Euler angles;
#: altitude.
STATES = (
    *("speed", "alpha", "beta", "roll_rate", "pitch_rate", "yaw_rate"),
    *("roll", "pitch", "yaw", "altitude"),
)


def rotation(roll: Any, pitch: Any, yaw: Any) -> Any:
    """Return the matrix (3, 3) from rotated axes to reference axes.

    The axes are rotated by yaw, pitch and roll, rad, in this order. For the Euler angles of an
    aircraft, the matrix converts body-axis components to components north, east and down.
    """
    cos_roll = ca.cos(roll)
    sin_roll = ca.sin(roll)
    cos_pitch = ca.cos(pitch)
    sin_pitch = ca.sin(pitch)
    cos_yaw = ca.cos(yaw)
    sin_yaw = ca.sin(yaw)
    first = ca.vertcat(cos_pitch * cos_yaw, cos_pitch * sin_yaw, -sin_pitch)
    second = ca.vertcat(
        sin_roll * sin_pitch * cos_yaw - cos_roll * sin_yaw,
        sin_roll * sin_pitch * sin_yaw + cos_roll * cos_yaw,
        sin_roll * cos_pitch,
    )
    third = ca.vertcat(
        cos_roll * cos_yaw * sin_pitch + sin_roll * sin_yaw,
        cos_roll * sin_yaw * sin_pitch - sin_roll * cos_yaw,
        cos_roll * cos_pitch,
    )
    return ca.horzcat(first, second, third)


def wind_axes(alpha: Any, beta: Any) -> Any:
    """Return the matrix (3, 3) from wind axes to body axes.

    The first column is the direction of the velocity relative to the air.

    alpha, beta: angle of attack and sideslip, rad
    """
    cos_alpha = ca.cos(alpha)
    sin_alpha = ca.sin(alpha)
    cos_beta = ca.cos(beta)
    sin_beta = ca.sin(beta)
    return ca.vertcat(
        ca.horzcat(cos_alpha * cos_beta, -cos_alpha * sin_beta, -sin_alpha),
        ca.horzcat(sin_beta, cos_beta, 0.0),
        ca.horzcat(sin_alpha * cos_beta, -sin_alpha * sin_beta, cos_alpha),
    )


def angular_velocity(x: Any) -> Any:
    """Return the angular velocity of a state in body axes, (3,), rad/s."""
    return ca.vertcat(x.roll_rate, x.pitch_rate, x.yaw_rate)


def acceleration(velocity: Any, rates: Any, specific_force: Any, gravity: Any) -> Any:
    """Return v' = f + g - ω × v, the rate of the body-axis velocity, (3,).

    All vectors are in body axes.

    velocity: velocity v, (3,)
    rates: angular velocity ω, (3,), rad/s
    specific_force: force without weight, divided by mass, f, (3,)
    gravity: acceleration of gravity g, (3,)
    """
    return specific_force + gravity - ca.cross(rates, velocity)


def angular_acceleration(rates: Any, moment: Any, inertia: Any) -> Any:
    """Return the angular acceleration ω' = I⁻¹ (M - ω × I ω) in body axes, (3,), rad/s².

    rates: angular velocity ω, (3,), rad/s
    moment: moment M about the center of gravity, (3,)
    inertia: symmetric inertia matrix I, (3, 3)
    """
    spin = ca.cross(rates, ca.mtimes(inertia, rates))
    # The inverse by cofactors; columns of the symmetric matrix are its rows.
    rows = ca.horzsplit(inertia)
    cofactors = [ca.cross(rows[(i + 1) % 3], rows[(i + 2) % 3]) for i in range(3)]
    inverse = ca.horzcat(*cofactors).T / ca.dot(rows[0], cofactors[0])
    return ca.mtimes(inverse, moment - spin)


def inertia_matrix(moments: Sequence[Any], products: Sequence[Any]) -> Any:
    """Return the inertia matrix (3, 3) in body axes.

    moments: moments of inertia xx, yy, zz
    products: products of inertia xy, zx, yz, with xy = ∫ x y dm
    """
    xx, yy, zz = moments
    xy, zx, yz = products
    return ca.vertcat(ca.horzcat(xx, -xy, -zx), ca.horzcat(-xy, yy, -yz), ca.horzcat(-zx, -yz, zz))


def inertia_warning(inertia: Any) -> str:
    """Return a sentence if no rigid body has this inertia matrix (3, 3) of numbers, or "".

    Principal moments are positive, and the largest is at most the sum of the others.
    """
    least, middle, most = np.linalg.eigvalsh(np.asarray(inertia, dtype=float).reshape(3, 3))
    if least <= 0.0:
        return "a principal moment of inertia is not positive; no body has these inertias"
    if most > (least + middle) * (1.0 + _ROUNDING):
        return (
            f"a principal moment of inertia is {most / (least + middle):.4g} times the sum of the "
            "others; no rigid body has these inertias"
        )
    return ""


def flow_rates(velocity: Any, acceleration: Any) -> tuple[Any, Any, Any]:
    """Return the rate of the speed, and the rates of alpha and beta, rad/s.

    velocity: velocity relative to the air in body axes, (3,)
    acceleration: rate of this velocity in body axes, (3,)
    """
    u, v, w = ca.vertsplit(velocity)
    in_plane = u**2 + w**2
    speed = ca.sqrt(in_plane + v**2)
    speed_rate = ca.dot(velocity, acceleration) / speed
    alpha_rate = (u * acceleration[2] - w * acceleration[0]) / in_plane
    beta_rate = (speed * acceleration[1] - v * speed_rate) / (speed * ca.sqrt(in_plane))
    return speed_rate, alpha_rate, beta_rate


def load_factor(alpha: Any, specific_force: Any, gravity: Any) -> Any:
    """Return the load factor n = (f_x sin α - f_z cos α)/g, normal to the flight path.

    It is cos γ in steady wings-level flight, and 1/cos φ in a level turn with bank φ.

    alpha: angle of attack, rad
    specific_force: force without weight, divided by mass, f, in body axes, (3,)
    gravity: acceleration of gravity g
    """
    along, _, down = (specific_force[i] for i in range(3))
    return (along * ca.sin(alpha) - down * ca.cos(alpha)) / gravity


def turn_rate(x: Any) -> Any:
    """Return the rate of the yaw angle at a state, rad/s."""
    return (x.pitch_rate * ca.sin(x.roll) + x.yaw_rate * ca.cos(x.roll)) / ca.cos(x.pitch)


def state_rates(
    x: Any, velocity: Any, velocity_rate: Any, rotation_rate: Any, climb: Any
) -> dict[str, Any]:
    """Return name -> rate of each state in `STATES`.

    x: state
    velocity: velocity relative to the air, in body axes, (3,)
    velocity_rate: rate of `velocity` (`acceleration`), (3,)
    rotation_rate: rate of the angular velocity (`angular_acceleration`), (3,)
    climb: rate of the altitude
    """
    speed_rate, alpha_rate, beta_rate = flow_rates(velocity, velocity_rate)
    heading_rate = turn_rate(x)
    return {
        "speed": speed_rate,
        "alpha": alpha_rate,
        "beta": beta_rate,
        "roll_rate": rotation_rate[0],
        "pitch_rate": rotation_rate[1],
        "yaw_rate": rotation_rate[2],
        "roll": x.roll_rate + ca.sin(x.pitch) * heading_rate,
        "pitch": x.pitch_rate * ca.cos(x.roll) - x.yaw_rate * ca.sin(x.roll),
        "yaw": heading_rate,
        "altitude": climb,
    }


#: Standard gravity, and units of length and force, by system of units.
GRAVITY = {"english": STANDARD_GRAVITY / FOOT, "si": STANDARD_GRAVITY}
LENGTH = {"english": "ft", "si": "m"}
FORCE = {"english": "lbf", "si": "N"}
#: Deviation of the temperature from that of the standard atmosphere.
DEVIATION = Signal("K", 10.0, -100.0, 100.0)
#: Limits of the speed relative to that of the default trim.
_LOWEST_SPEED_RATIO = 0.3
_HIGHEST_SPEED_RATIO = 5.0


def force_signals(system: str) -> dict[str, Signal]:
    """Return the signals of the outputs of `Motion.forces`, name -> signal."""
    length = LENGTH[system]
    force = FORCE[system]
    moment = "N m" if system == "si" else "ft lbf"
    return {
        **dict.fromkeys(("lift", "drag", "thrust_force", "weight"), Signal(force, 100.0)),
        "pitching_moment": Signal(moment, 100.0),
        "dynamic_pressure": Signal(f"{force}/{length}^2", 100.0),
        "reference_area": Signal(f"{length}^2"),
        "reference_chord": Signal(length),
    }


class Motion:
    """Motion of a rigid aircraft at a state with the fields of `STATES`.

    Quantities are in the units of the aircraft, ft, slug and lbf or SI units.

    air: standard air at the altitude.
    pressure: dynamic pressure.
    mach: Mach number.
    velocity: velocity relative to the air in body axes, (3,).
    rates: angular velocity in body axes, (3,), rad/s.
    """

    def __init__(self, x: Any, gravity: Any, system: str, warmer: Any) -> None:
        """Compute the motion at a state.

        x: state, as numbers or expressions
        gravity: acceleration of gravity
        system: system of units, english or si
        warmer: deviation of the temperature from that of the standard atmosphere, K
        """
        self.air = air_at(x.altitude, system, warmer)
        self.pressure = 0.5 * self.air.density * x.speed**2
        self.mach = x.speed / self.air.sound
        self.velocity = x.speed * wind_axes(x.alpha, x.beta)[:, 0]
        self.rates = angular_velocity(x)
        self._x = x
        self._gravity = gravity
        # row `down` of the matrix from body axes to north, east and down: gravity's direction
        self._down = rotation(x.roll, x.pitch, x.yaw)[2, :].T

    def acceleration(self, specific_force: Any) -> Any:
        """Return the rate of the body-axis velocity, (3,), in body axes.

        specific_force: force without weight, divided by mass, in body axes, (3,)
        """
        gravity = self._gravity * self._down
        return acceleration(self.velocity, self.rates, specific_force, gravity)

    def forces(
        self,
        *,
        lift: Any,
        drag: Any,
        pitching_moment: Any,
        thrust: Any,
        mass: Any,
        area: Any,
        chord: Any,
    ) -> dict[str, Any]:
        """Return the outputs from which the reports of trims compute performance, name -> value.

        lift, drag: aerodynamic forces normal to the flight path and along it
        pitching_moment: aerodynamic moment about the center of gravity
        thrust, mass: thrust and mass of the aircraft
        area, chord: reference area and reference chord of the coefficients
        """
        return {
            "lift": lift,
            "drag": drag,
            "thrust_force": thrust,
            "weight": mass * self._gravity,
            "pitching_moment": pitching_moment,
            "dynamic_pressure": self.pressure,
            "reference_area": area,
            "reference_chord": chord,
        }

    def rates_and_outputs(
        self, specific_force: Any, moment: Any, inertia: Any
    ) -> tuple[dict[str, Any], dict[str, Any]]:
        """Return name -> rate of each state, and name -> value of the common outputs.

        specific_force: force without weight, divided by mass, in body axes, (3,)
        moment: moment about the center of gravity, in body axes, (3,)
        inertia: inertia matrix, (3, 3)
        """
        rotation_rate = angular_acceleration(self.rates, moment, inertia)
        climb = -ca.dot(self._down, self.velocity)
        velocity_rate = self.acceleration(specific_force)
        rates = state_rates(self._x, self.velocity, velocity_rate, rotation_rate, climb)
        outputs = {
            "gamma": ca.asin(climb / self._x.speed),
            "turn_rate": rates["yaw"],
            "load_factor": load_factor(self._x.alpha, specific_force, self._gravity),
            "mach": self.mach,
        }
        return rates, outputs


def rigid_aircraft(
    name: str,
    equations: Callable[[Any, Any, Any, Any], tuple[dict[str, Any], dict[str, Any]]],
    *,
    system: str,
    speed: float,
    altitude: float,
    alpha: Signal,
    beta: Signal,
    inputs: Mapping[str, Signal],
    parameters: Mapping[str, Signal],
    outputs: Mapping[str, Signal],
    holds_beta: bool,
    source: Source,
    about: About,
    domain: Domain,
) -> Model:
    """Return the `Model` of a rigid aircraft, with a straight and level default trim.

    name: name of the model.
    equations: (x, u, p, w) -> (rates, outputs).
    system: system of units, english or si.
    speed, altitude: values of the default trim.
    alpha, beta: signals of the angle of attack and the sideslip, rad. The limits of the other
        states are assumed.
    inputs: name -> signal.
    parameters: name -> signal, without the deviation of the temperature, `ISA`.
    outputs: name -> signal, for the outputs in addition to those of `Motion`.
    holds_beta: whether the default trim imposes the sideslip.
    source, about: the file, and texts about it.
    domain: where the equations are valid.
    """
    length = LENGTH[system]
    foot = 1.0 if system == "english" else FOOT
    lowest, highest = (foot * height for height in ALTITUDES)
    # The arguments of a signal are its unit, nominal value, lowest, highest and initial value.
    rate = Signal("rad/s", 0.1, rate=1.0)
    states = {
        "speed": Signal(
            f"{length}/s",
            speed,
            _LOWEST_SPEED_RATIO * speed,
            _HIGHEST_SPEED_RATIO * speed,
            speed,
            rate=GRAVITY[system],
            assumed=True,
        ),
        "alpha": alpha,
        "beta": beta,
        **dict.fromkeys(("roll_rate", "pitch_rate", "yaw_rate"), rate),
        "roll": Signal("rad", 0.1, -3.1, 3.1, assumed=True),
        "pitch": Signal("rad", 0.1, -1.5, 1.5, alpha.start, assumed=True),
        "yaw": Signal("rad", 0.1),
        "altitude": Signal(length, 10000.0 * foot, lowest, highest, assumed=True),
    }
    trim = {"speed": speed, "altitude": altitude, "yaw": 0.0, "gamma": 0.0, "turn_rate": 0.0}
    if holds_beta:
        trim["beta"] = 0.0
    steady = tuple(name for name in STATES if name not in ("yaw", "altitude"))
    return Model(
        name,
        {name: states[name] for name in STATES},
        inputs,
        equations,
        parameters={**parameters, ISA: DEVIATION},
        outputs={
            "gamma": Signal("rad", 0.1),
            "turn_rate": Signal("rad/s", 0.1),
            "load_factor": Signal(),
            "mach": Signal(nominal=0.1),
            **outputs,
            **force_signals(system),
        },
        trim=trim,
        steady=steady,
        linear=steady,
        schedule="speed",
        source=source,
        about=replace(about, atmosphere="U.S. Standard 1976"),
        domain=domain,
    )
