"""Simulation with JSBSim's order of computations and JSBSim's integrators.

The source is `FGFDMExec::Run`, `FGPropagate`, `FGAccelerations`, `FGInertial` and `FGLocation`. A
frame is one time step. It first moves the aircraft with the accelerations of the previous frame.
Control system, mass, atmosphere, engines and forces follow in this order. Each uses the latest
values.
"""

from __future__ import annotations

from collections.abc import Iterable
from copy import copy
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import casadi as ca
import numpy as np
from scipy.spatial.transform import Rotation

from hfa_aircraft.rigid.motion import STATES, flow_rates, rotation, wind_axes
from hfa_jsbsim.aircraft import WINDS, Equations
from hfa_jsbsim.parts import Parts
from hfa_jsbsim.surfaces import PilotInput
from hfa_support.errors import BadInputError, shortened, warn

#: Variables of motion in an array, and their sizes: attitude quaternion, position, velocity and
#: angular velocity, all inertial; rotation angle of the earth; acceleration, also that of the
#: previous frame; angular acceleration; velocities one and two frames before; time derivative of
#: the velocity in body axes.
_MOTION = {
    **{"attitude": 4, "position": 3, "velocity": 3, "rotation": 3, "earth": 1, "acceleration": 3},
    **{"last_acceleration": 3, "spin_up": 3, "last_velocity": 3, "older_velocity": 3, "body": 3},
}
_SIZE = sum(_MOTION.values())
#: Engines and filters settle for at most _LONGEST s, or until no relative change per frame exceeds
#: _STEADY.
_LONGEST = 60.0
_STEADY = 1e-13
#: A larger relative change per frame after that time is reported.
_SETTLED = 1e-9


@dataclass(frozen=True)
class Planet:
    """Constants of the earth.

    semimajor, semiminor: axes of the ellipsoid, ft
    turning: angular velocity, rad/s
    pull: gravitational parameter G M, ft³/s²
    flattening: coefficient J2 of the gravity field
    """

    semimajor: float = 20925646.32546
    semiminor: float = 20855486.5951
    turning: float = 0.00007292115
    pull: float = 14.0764417572e15
    flattening: float = 1.08262982e-03


class _FrameEquations(Equations):
    """Equations of one JSBSim frame: forces, moments, mass and stored values at its end."""

    def __init__(self, parts: Parts) -> None:
        self.planet_rates = ca.SX.sym("planet_rates", 3)
        super().__init__(parts)

    def _planet_rates(self) -> Any:
        return self.planet_rates

    def _move(self, x: Any, air_force: ca.SX, air_moment: ca.SX, *outside: ca.SX) -> None:
        """Set force, moment, mass, inertia, and the derivatives of the engine states."""
        # air_force, air_moment (3,)
        force = sum((effect.force for effect in self.effects), start=air_force + outside[0])
        moment = sum((effect.moment for effect in self.effects), start=air_moment + outside[1])
        inertia = ca.reshape(self.mass.inertia, 9, 1)
        values = ca.vertcat(force, moment, self.mass.slugs, inertia)
        self.rates = {f"load {number}": each for number, each in enumerate(ca.vertsplit(values))}
        self.loads = list(self.rates)
        for effect in self.effects:
            self.rates |= effect.rates
        self.outputs = {}

    def _add_filters(self) -> None:
        """Add the values that components store for the next frame to the results of the frame."""
        # Stored values on which these values depend are added too.
        memories = self.properties.memories
        done = 0
        while done < len(memories):
            name = list(memories)[done]
            value = self.properties.value_of(memories[name].writer, name, "")
            self.rates[f"memory {name}"] = ca.SX(value)
            done += 1

    def _solve_rates_of_angles(self) -> None:
        """Do nothing, because the derivatives of alpha and beta are those of the previous frame."""

    def _stop_clock(self) -> None:
        """Set the simulation time to 0."""
        self._substitute(self._time, ca.SX(0.0))


class Frames:
    """Simulation of an aircraft with the time steps of JSBSim, called frames."""

    def __init__(
        self,
        parts: Parts,
        step: float,
        names: tuple[list[str], list[str], list[str]],
    ) -> None:
        """Build the CasADi functions of one frame, the time step of JSBSim.

        step: duration of a frame, s
        names: names of the model's states, inputs and parameters

        Raises BadInputError if an input is a surface or a throttle position rather than a pilot
        command, or if the model includes filter states.
        """
        own_parts = copy(parts)
        own_parts.choices = replace(parts.choices, step=step, engines=True, filters=False)
        own_parts.notes = []
        self.step = step
        self.planet = Planet()
        self._states, self._inputs, self._parameters = names
        self._equations = _FrameEquations(own_parts)
        self._engines = list(self._equations.states)[len(STATES) :]
        self._starts = {file.lag: file.usual_lag for file in parts.engines}
        for name in self._states:
            if name not in self._equations.states:
                raise BadInputError(
                    f"the filter state {shortened(name)} is integrated by JSBSim's frames; remove "
                    "filters=states from the name of the aircraft"
                )
        for name in self._inputs:
            refuse_surface(
                name, self._equations.inputs[name], name in self._equations.cut_throttles
            )
        self._memories = list(self._equations.properties.memories.values())
        self._frame = self._compiled(moving=True)
        self._still = self._compiled(moving=False)
        self._around = [self._states.index(name) for name in ("roll", "yaw")]
        self._z = np.zeros(0)
        self._p = np.zeros(0)
        self._x = np.zeros(0)

    def begin(self, x: Any, p: Any, u: Any) -> None:
        """Set the initial state, at a point on the equator.

        Engine lags and filters that are not states of the model settle first, for at most
        `_LONGEST` s. A warning is issued if a change in the last frame exceeds `_SETTLED`.

        x, p, u: states, parameters and inputs of the model
        """
        values = dict(zip(self._states, map(float, x), strict=True))
        self._p = np.array(p, dtype=float)
        wind = dict(zip(self._parameters, self._p.tolist(), strict=True))
        motion = self._begun(values, np.array([wind.get(name, 0.0) for name in WINDS]))
        engines = [values.get(name, self._starts.get(name, 0.0)) for name in self._engines]
        z = np.concatenate([motion, engines, np.zeros(len(self._memories))])
        held = [_SIZE + i for i, name in enumerate(self._engines) if name in values]
        for _ in range(round(_LONGEST / self.step)):
            later = np.array(self._still(z, u, self._p)).ravel()
            later[held] = z[held]
            moved = np.abs(later - z) / np.maximum(1.0, np.abs(z))
            z = later
            if moved.max() < _STEADY:
                break
        if moved.max() > _SETTLED:
            warn(
                f"engines or filters are not in steady state after {_LONGEST:g} s with the inputs"
                " of the trim, so the flight begins with a transient"
            )
        parts = _split(z)
        parts["last_acceleration"][:] = parts["acceleration"]
        self._z = z
        self._x = np.array(x, dtype=float)

    def advance(self, u: Any) -> np.ndarray:
        """Compute one frame and return the states of the model after it, (n,).

        u: inputs, (m,)
        """
        z, shown = self._frame(self._z, u, self._p)
        self._z = np.array(z).ravel()
        x = np.array(shown).ravel()
        turns = np.round((x[self._around] - self._x[self._around]) / (2.0 * np.pi))
        x[self._around] -= 2.0 * np.pi * turns  # angles are continuous beyond half a turn
        self._x = x
        return x.copy()

    def _begun(self, values: dict[str, float], wind: np.ndarray) -> np.ndarray:
        """Return JSBSim's variables of motion at a state over the equator, (_SIZE,)."""
        # All accelerations are 0.
        # wind (3,)
        planet = self.planet
        turning = np.array([0.0, 0.0, planet.turning])
        position = np.array([planet.semimajor + values["altitude"], 0.0, 0.0])
        local = np.array(_local_axes(ca.DM(position), planet)[1])  # rows north, east, down
        ned = np.array(rotation(values["roll"], values["pitch"], values["yaw"]))
        to_body = ned.T @ local
        air = values["speed"] * np.array(wind_axes(values["alpha"], values["beta"]))[:, 0]
        over_ground = to_body.T @ air + local.T @ wind
        rates = np.array([values[name] for name in ("roll_rate", "pitch_rate", "yaw_rate")])
        x, y, z, w = Rotation.from_matrix(to_body.T).as_quat()
        motion = np.zeros(_SIZE)
        parts = _split(motion)
        parts["attitude"][:] = [w, x, y, z]
        parts["position"][:] = position
        velocity = over_ground + np.cross(turning, position)
        for name in ("velocity", "last_velocity", "older_velocity"):
            parts[name][:] = velocity
        parts["rotation"][:] = rates + to_body @ turning
        return motion

    def _compiled(self, moving: bool) -> ca.Function:
        """Return the CasADi function (z, u, p) -> (z, x) of one frame."""
        # z contains the variables of motion, the engine states and the stored values.
        z = ca.SX.sym("z", _SIZE + len(self._engines) + len(self._memories))
        u = ca.SX.sym("u", len(self._inputs))
        p = ca.SX.sym("p", len(self._parameters))
        parts = _split(z[:_SIZE])
        engines = z[_SIZE : _SIZE + len(self._engines)]
        memories = z[_SIZE + len(self._engines) :]
        if moving:
            parts |= _propagated(parts, self.step, self.planet.turning)
        by_name = dict(zip(self._parameters, ca.vertsplit(p), strict=True))
        wind = ca.vertcat(*(by_name.get(name, 0.0) for name in WINDS))
        view = _viewed(parts, wind, self.planet)
        loads, engines, memories = self._loads(
            ca.vertcat(view.states, engines),
            u,
            p,
            view.angle_rates,
            view.planet_rates,
            memories,
        )
        parts |= _accelerated(parts, view, loads, self.planet)
        after = ca.vertcat(*(parts[name] for name in _MOTION), engines, memories)
        names = [*STATES, *self._engines]
        states = ca.vertcat(view.states, engines)
        shown = ca.vertcat(*(states[names.index(name)] for name in self._states))
        results = [after, shown] if moving else [after]
        return ca.Function(
            "frame", [z, u, p], [ca.densify(each) for each in results], {"cse": True}
        )

    def _loads(self, x: ca.SX, u: ca.SX, p: ca.SX, *others: ca.SX) -> tuple[ca.SX, ca.SX, ca.SX]:
        """Return loads, engine states and stored values at the end of the frame."""
        equations = self._equations
        inputs = {name: each.symbol for name, each in equations.inputs.items()}
        parameters = dict(equations.parameters)
        given = [
            *equations.states.values(),
            *(inputs.pop(name) for name in self._inputs),
            *(parameters.pop(name) for name in self._parameters),
            *equations.rate_symbols,
            equations.planet_rates,
            *(memory.symbol for memory in self._memories),
        ]
        unused = {**inputs, **parameters}
        at_rest = [1.0 if name.startswith("engine") else 0.0 for name in unused]  # engines run
        function = ca.Function(
            "loads", [ca.vertcat(*given), _column(unused.values())], [*self._end_of_frame()]
        )
        values: Any = function(ca.vertcat(x, u, p, *others), ca.SX(ca.DM(at_rest)))
        return values

    def _end_of_frame(self) -> tuple[ca.SX, ca.SX, ca.SX]:
        """Return loads, engine states and stored values at the end of a frame, as expressions."""
        # Engine states advance before the thrust is computed, except propeller speeds, which
        # advance afterwards.
        equations = self._equations
        kept = [f"memory {name}" for name in equations.properties.memories]
        speeds = [name for name in self._engines if name.startswith("rpm")]
        others = [name for name in self._engines if name not in speeds]
        before = _column(equations.states[name] for name in others)
        moved = before + self.step * _column(equations.rates[name] for name in others)
        groups = (equations.loads, speeds, kept)
        loads, speed_rates, memories = ca.substitute(
            [_column(equations.rates[name] for name in group) for group in groups],
            [before],
            [moved],
        )
        slow = _column(equations.states[name] for name in speeds)
        turned = slow + self.step * speed_rates
        late = ca.substitute(memories, slow, turned)
        memories = _column(
            late[place] if name.endswith("-rpm") else memories[place]
            for place, name in enumerate(kept)
        )
        order = [*others, *speeds]
        engines = ca.vertcat(moved, turned)
        engines = _column(engines[order.index(name)] for name in self._engines)
        return loads, engines, memories


def refuse_surface(name: str, pilot_input: PilotInput, is_position: bool) -> None:
    """Raise BadInputError for an input that is not a pilot command.

    is_position: whether the input is a throttle position
    """
    if is_position or pilot_input.unit != "1":
        part = "a throttle position" if is_position else "a surface"
        raise BadInputError(
            f"the input {name} is {part}, not a pilot command, which --method jsbsim does not "
            "support; use --method runge-kutta"
        )


class _View(NamedTuple):
    """Quantities derived from the motion that the forces of a frame depend on."""

    to_earth: Any  # rotation matrix from inertial axes to axes fixed to the earth, (3, 3)
    to_body: Any  # rotation matrix from inertial to body axes, (3, 3)
    place: Any  # position in axes fixed to the earth, ft
    drift: Any  # velocity due to the earth's rotation at this position, inertial axes, ft/s
    velocity: Any  # velocity relative to the ground, body axes, ft/s
    rates: Any  # angular velocity relative to the ground, body axes, rad/s
    planet_rates: Any  # angular velocity of the earth, body axes, rad/s
    states: Any  # states in the order of `STATES`
    angle_rates: Any  # time derivatives of alpha and beta, rad/s


def _viewed(parts: dict[str, Any], wind: Any, planet: Planet) -> _View:
    """Return the quantities derived from the motion on which the forces depend."""
    # wind (3,)
    turning = ca.vertcat(0.0, 0.0, planet.turning)
    to_earth = _turned(parts["earth"])
    to_body = _matrix(parts["attitude"])
    place = ca.mtimes(to_earth, parts["position"])
    altitude, to_local = _local_axes(place, planet)
    body_from_local = ca.mtimes([to_body, to_earth.T, to_local.T])
    drift = ca.cross(turning, parts["position"])
    velocity = ca.mtimes(to_body, parts["velocity"] - drift)
    planet_rates = ca.mtimes(to_body, turning)
    rates = parts["rotation"] - planet_rates
    air = velocity - ca.mtimes(body_from_local, wind)
    speed, alpha, beta = _flow(air)
    roll, pitch, yaw = _angles(body_from_local)
    states = {
        "speed": speed,
        "alpha": alpha,
        "beta": beta,
        "roll_rate": rates[0],
        "pitch_rate": rates[1],
        "yaw_rate": rates[2],
        "roll": roll,
        "pitch": pitch,
        "yaw": yaw,
        "altitude": altitude,
    }
    return _View(
        to_earth,
        to_body,
        place,
        drift,
        velocity,
        rates,
        planet_rates,
        states=ca.vertcat(*(states[name] for name in STATES)),
        angle_rates=ca.vertcat(*flow_rates(air, parts["body"])[1:]),
    )


def _accelerated(
    parts: dict[str, Any], view: _View, loads: ca.SX, planet: Planet
) -> dict[str, Any]:
    """Return the accelerations by name, as `FGAccelerations` computes them."""
    # loads (16,)
    force, moment, mass, inertia = ca.vertsplit(loads, [0, 3, 6, 7, 16])
    inertia = ca.reshape(inertia, 3, 3)
    turning = ca.vertcat(0.0, 0.0, planet.turning)
    pull = ca.mtimes(view.to_earth.T, _gravity(view.place, planet))
    specific_force = force / mass
    spin = ca.cross(parts["rotation"], ca.mtimes(inertia, parts["rotation"]))
    return {
        "last_acceleration": parts["acceleration"],
        "acceleration": ca.mtimes(view.to_body.T, specific_force) + pull,
        "spin_up": ca.mtimes(ca.inv(inertia), moment - spin),
        "body": specific_force
        - ca.cross(view.rates + 2.0 * view.planet_rates, view.velocity)
        - ca.mtimes(view.to_body, ca.cross(turning, view.drift))
        + ca.mtimes(view.to_body, pull),
    }


def _column(values: Iterable[Any]) -> ca.SX:
    """Return expressions as a column, (0, 1) if there are none."""
    return ca.vertcat(ca.SX(0, 1), *values)


def _split(motion: Any) -> dict[str, Any]:
    """Return the parts of the vector of motion by name, such as attitude or position."""
    parts = {}
    begin = 0
    for name, size in _MOTION.items():
        parts[name] = motion[begin : begin + size]
        begin += size
    return parts


def _propagated(parts: dict[str, Any], step: float, turning: float) -> dict[str, Any]:
    """Return the variables of motion after `FGPropagate`, by name."""
    # Attitude and rotation are integrated with Euler's method, the velocity with the second-order
    # and the position with the third-order method of Adams and Bashforth.
    q0, q1, q2, q3 = ca.vertsplit(parts["attitude"])
    p, q, r = ca.vertsplit(parts["rotation"])
    rate = 0.5 * ca.vertcat(
        -(q1 * p + q2 * q + q3 * r),
        q0 * p - q3 * q + q2 * r,
        q3 * p + q0 * q - q1 * r,
        -q2 * p + q1 * q + q0 * r,
    )
    attitude = parts["attitude"] + step * rate
    norm = ca.norm_2(attitude)
    attitude = attitude / ca.if_else(ca.fabs(norm - 1.0) < 1e-10, 1.0, norm)
    velocity = parts["velocity"]
    mean = 23.0 * velocity - 16.0 * parts["last_velocity"] + 5.0 * parts["older_velocity"]
    push = 1.5 * parts["acceleration"] - 0.5 * parts["last_acceleration"]
    return {
        "attitude": attitude,
        "rotation": parts["rotation"] + step * parts["spin_up"],
        "position": parts["position"] + step / 12.0 * mean,
        "velocity": velocity + step * push,
        "earth": parts["earth"] + step * turning,
        "last_velocity": velocity,
        "older_velocity": parts["last_velocity"],
    }


def _turned(angle: Any) -> Any:
    """Return the rotation matrix (3, 3) from inertial axes to axes fixed to the earth."""
    cos = ca.cos(angle)
    sin = ca.sin(angle)
    return ca.vertcat(
        ca.horzcat(cos, sin, 0.0), ca.horzcat(-sin, cos, 0.0), ca.horzcat(0.0, 0.0, 1.0)
    )


def _matrix(attitude: Any) -> Any:
    """Return the rotation matrix (3, 3) from inertial to body axes, from a quaternion."""
    q0, q1, q2, q3 = ca.vertsplit(attitude)
    return ca.vertcat(
        ca.horzcat(
            q0 * q0 + q1 * q1 - q2 * q2 - q3 * q3,
            2.0 * (q1 * q2 + q0 * q3),
            2.0 * (q1 * q3 - q0 * q2),
        ),
        ca.horzcat(
            2.0 * (q1 * q2 - q0 * q3),
            q0 * q0 - q1 * q1 + q2 * q2 - q3 * q3,
            2.0 * (q2 * q3 + q0 * q1),
        ),
        ca.horzcat(
            2.0 * (q1 * q3 + q0 * q2),
            2.0 * (q2 * q3 - q0 * q1),
            q0 * q0 - q1 * q1 - q2 * q2 + q3 * q3,
        ),
    )


def _local_axes(place: Any, planet: Planet) -> tuple[Any, Any]:
    """Return the altitude, ft, and the rotation matrix (3, 3) from earth-fixed to local axes."""
    # The local axes point north, east and down, and are geodetic. The altitude is relative to the
    # ellipsoid's radius at the same geocentric latitude.
    # Source: Fukushima, Journal of Geodesy 79, 2006.
    x, y, z = ca.vertsplit(place)
    a = planet.semimajor
    ec = planet.semiminor / a
    e2 = 1.0 - ec**2
    c = a * e2
    across = ca.sqrt(x * x + y * y)
    s0 = ca.fabs(z)
    c0 = ec * across
    a0 = ca.sqrt(c0 * c0 + s0 * s0)
    s1 = ec * s0 * a0**3 + c * s0**3
    c1 = across * a0**3 - c * c0**3
    b0 = 1.5 * c * c0 * s0 * ((across * s0 - ec * s0 * c0) * a0 - c * c0 * s0)
    s1 = s1 * a0**3 - b0 * s0
    cc = ec * (c1 * a0**3 - b0 * c0)
    norm = ca.sqrt(s1 * s1 + cc * cc)
    cos_latitude = cc / norm
    sin_latitude = ca.sign(z) * s1 / norm
    radius = ca.sqrt(across * across + z * z)
    cos_geocentric = across / radius
    sea_level = a * ec / ca.sqrt(1.0 - e2 * cos_geocentric**2)
    sin = y / across
    cos = x / across
    axes = ca.vertcat(
        ca.horzcat(-cos * sin_latitude, -sin * sin_latitude, cos_latitude),
        ca.horzcat(-sin, cos, 0.0),
        ca.horzcat(-cos * cos_latitude, -sin * cos_latitude, -sin_latitude),
    )
    return radius - sea_level, axes


def _gravity(place: Any, planet: Planet) -> Any:
    """Return the gravitational acceleration in earth-fixed axes, ft/s², (3,)."""
    # Source: `FGInertial::GetGravityJ2`.
    radius = ca.norm_2(place)
    sine = place[2] / radius
    share = 1.5 * planet.flattening * (planet.semimajor / radius) ** 2
    in_plane = 1.0 + share * (1.0 - 5.0 * sine**2)
    along = 1.0 + share * (3.0 - 5.0 * sine**2)
    factors = ca.vertcat(in_plane, in_plane, along)
    return -planet.pull / radius**2 * factors * place / radius


def _flow(air: Any) -> tuple[Any, Any, Any]:
    """Return speed, alpha and beta of an aircraft from its velocity."""
    # air (3,)
    u, v, w = ca.vertsplit(air)
    in_plane = u * u + w * w
    return ca.sqrt(in_plane + v * v), ca.atan2(w, u), ca.atan2(v, ca.sqrt(in_plane))


def _angles(body_from_local: Any) -> tuple[Any, Any, Any]:
    """Return roll, pitch and yaw, rad, from the rotation matrix from local axes to body axes."""
    roll = ca.atan2(body_from_local[1, 2], body_from_local[2, 2])
    pitch = ca.asin(-body_from_local[0, 2])
    yaw = ca.atan2(body_from_local[0, 1], body_from_local[0, 0])
    return roll, pitch, yaw
