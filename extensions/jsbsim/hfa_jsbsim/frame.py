"""One frame of JSBSim, and flights of such frames: its order of models and its integrators
(`FGFDMExec::Run`, `FGPropagate`, `FGAccelerations`, `FGInertial`, `FGLocation`).

A frame moves the aircraft by the accelerations of the frame before; then control system, mass, air,
engines and forces follow in this order, each from the values set so far.
"""

from __future__ import annotations

from copy import copy
from dataclasses import dataclass, replace
from typing import Any

import casadi as ca
import numpy as np
from scipy.spatial.transform import Rotation

from hfa_aircraft.rigid_body import STATES, flow_rates, rotation, wind_axes
from hfa_jsbsim.aircraft import WINDS, Equations
from hfa_jsbsim.parts import Parts
from hfa_jsbsim.surfaces import PilotInput
from hfa_support.errors import BadInputError, shortened

#: Parts of the motion in an array, in their order, and their sizes: quaternion of the attitude,
#: position, velocity and rotation, all inertial; angle of the earth; accelerations now and a frame
#: before; acceleration of the rotation; velocities one and two frames before; rate of the
#: velocity's components in body axes.
_MOTION = {
    **{"attitude": 4, "position": 3, "velocity": 3, "rotation": 3, "earth": 1, "acceleration": 3},
    **{"last_acceleration": 3, "spin_up": 3, "last_velocity": 3, "older_velocity": 3, "body": 3},
}
_SIZE = sum(_MOTION.values())
#: Engines and filters come to rest for at most so long, s, until nothing of them moves by more.
_LONGEST = 60.0
_STEADY = 1e-13


@dataclass(frozen=True)
class Planet:
    """semimajor, semiminor: axes, ft. turning: rad/s. pull: G M, ft^3/s^2. flattening: J2."""

    semimajor: float = 20925646.32546
    semiminor: float = 20855486.5951
    turning: float = 0.00007292115
    pull: float = 14.0764417572e15
    flattening: float = 1.08262982e-03


class _FrameEquations(Equations):
    """Forces, moments, mass and memories at the end of a frame, as the rates of `Equations`."""

    def __init__(self, parts: Parts) -> None:
        self.planet_rates = ca.SX.sym("planet_rates", 3)
        super().__init__(parts)

    def _planet_rates(self) -> Any:
        return self.planet_rates

    def _move(self, x: Any, air_force: ca.SX, air_moment: ca.SX, *outside: ca.SX) -> None:
        """Force, moment, mass and inertia, and the rates of the engines."""
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
        """Add the values kept for the next frame, including those that they depend on."""
        memories = self.properties.memories
        done = 0
        while done < len(memories):
            name = list(memories)[done]
            value = self.properties.value_of(memories[name].writer, name, "")
            self.rates[f"memory {name}"] = ca.SX(value)
            done += 1

    def _solve_rates_of_angles(self) -> None:
        """They are those of the frame before."""

    def _stop_clock(self) -> None:
        """The time is 0, as in the model."""
        self._substitute(self._time, ca.SX(0.0))


class Frames:
    """Flights of an aircraft in frames of JSBSim."""

    def __init__(
        self,
        parts: Parts,
        step: float,
        names: tuple[list[str], list[str], list[str]],
        planet: Planet | None = None,
    ) -> None:
        """names: states, inputs and parameters of the model.

        BadInputError where the model's inputs are not JSBSim's own, or filters are its states.
        """
        own_parts = copy(parts)
        own_parts.choices = replace(parts.choices, step=step, engines=True, filters=False)
        own_parts.notes = []
        self.step = step
        self.planet = planet or Planet()
        self._states, self._inputs, self._parameters = names
        self._equations = _FrameEquations(own_parts)
        self._engines = list(self._equations.states)[len(STATES) :]
        self._starts = {file.lag: file.usual_lag for file in parts.engines}
        for name in self._states:
            if name not in self._equations.states:
                raise BadInputError(
                    f"the state {shortened(name)} is a filter's, which JSBSim steps itself; leave"
                    " ?filters=states out"
                )
        self._memories = list(self._equations.properties.memories.values())
        self._frame = self._compiled(moving=True)
        self._still = self._compiled(moving=False)
        self._around = [self._states.index(name) for name in ("roll", "yaw")]
        self._z = np.zeros(0)
        self._p = np.zeros(0)
        self._x = np.zeros(0)

    def begin(self, x: Any, p: Any, u: Any) -> None:
        """Start a flight at a state, over the equator: what is no state of the model, lags of
        engines and filters, comes to rest first.

        x, p, u: (n,) states, parameters and inputs of the model
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
        parts = _split(z)
        parts["last_acceleration"][:] = parts["acceleration"]
        self._z = z
        self._x = np.array(x, dtype=float)

    def advance(self, u: Any) -> np.ndarray:
        """The state of the model, (n,), after a frame with these inputs, (m,)."""
        z, shown = self._frame(self._z, u, self._p)
        self._z = np.array(z).ravel()
        x = np.array(shown).ravel()
        turns = np.round((x[self._around] - self._x[self._around]) / (2.0 * np.pi))
        x[self._around] -= 2.0 * np.pi * turns  # angles go on beyond half a turn
        self._x = x
        return x.copy()

    def _begun(self, values: dict[str, float], wind: np.ndarray) -> np.ndarray:
        """The motion at a state, over the equator, accelerations 0."""
        planet = self.planet
        turning = np.array([0.0, 0.0, planet.turning])
        position = np.array([planet.semimajor + values["altitude"], 0.0, 0.0])
        local = np.array(_local_axes(ca.DM(position), planet)[1])  # north, east, down
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
        """(z, u, p) -> z and x after a frame; not moving: z alone, in place."""
        z = ca.SX.sym("z", _SIZE + len(self._engines) + len(self._memories))
        u = ca.SX.sym("u", len(self._inputs))
        p = ca.SX.sym("p", len(self._parameters))
        parts = _split(z[:_SIZE])
        engines = z[_SIZE : _SIZE + len(self._engines)]
        memories = z[_SIZE + len(self._engines) :]
        if moving:
            parts |= _propagated(parts, self.step, self.planet.turning)
        turning = ca.vertcat(0.0, 0.0, self.planet.turning)
        to_earth = _turned(parts["earth"])
        place = ca.mtimes(to_earth, parts["position"])
        altitude, to_local = _local_axes(place, self.planet)
        to_body = _matrix(parts["attitude"])
        body_from_local = ca.mtimes([to_body, to_earth.T, to_local.T])
        drift = ca.cross(turning, parts["position"])
        velocity = ca.mtimes(to_body, parts["velocity"] - drift)
        planet_rates = ca.mtimes(to_body, turning)
        rates = parts["rotation"] - planet_rates
        by_name = dict(zip(self._parameters, ca.vertsplit(p), strict=True))
        wind = ca.vertcat(*(by_name.get(name, 0.0) for name in WINDS))
        air = velocity - ca.mtimes(body_from_local, wind)
        x = ca.vertcat(*_flow(air), rates, *_angles(body_from_local), altitude)
        x = ca.vertcat(*(dict(zip(_ORDER, ca.vertsplit(x), strict=True))[name] for name in STATES))
        angle_rates = ca.vertcat(*flow_rates(air, parts["body"])[1:])
        loads, engines, memories = self._loads(
            ca.vertcat(x, engines), u, p, angle_rates, planet_rates, memories
        )
        force, moment, mass, inertia = ca.vertsplit(loads, [0, 3, 6, 7, 16])
        inertia = ca.reshape(inertia, 3, 3)
        pull = ca.mtimes(to_earth.T, _gravity(place, self.planet))
        pushed = force / mass
        parts["last_acceleration"] = parts["acceleration"]
        parts["acceleration"] = ca.mtimes(to_body.T, pushed) + pull
        spin = ca.cross(parts["rotation"], ca.mtimes(inertia, parts["rotation"]))
        parts["spin_up"] = ca.mtimes(ca.inv(inertia), moment - spin)
        parts["body"] = (
            pushed
            - ca.cross(rates + 2.0 * planet_rates, velocity)
            - ca.mtimes(to_body, ca.cross(turning, drift))
            + ca.mtimes(to_body, pull)
        )
        after = ca.vertcat(*(parts[name] for name in _MOTION), engines, memories)
        states = [*STATES, *self._engines]
        every = ca.vertcat(x, engines)
        shown = ca.vertcat(*(every[states.index(name)] for name in self._states))
        results = [after, shown] if moving else [after]
        return ca.Function(
            "frame", [z, u, p], [ca.densify(each) for each in results], {"cse": True}
        )

    def _loads(self, x: ca.SX, u: ca.SX, p: ca.SX, *others: ca.SX) -> tuple[ca.SX, ca.SX, ca.SX]:
        """Loads, and engines and memories at the end of the frame.

        x: states, those of engines of the frame before. others: alphadot and betadot, the rotation
        of the earth in body axes, memories
        """
        equations = self._equations
        step = self.step
        symbols = {name: equations.states[name] for name in self._engines}
        rates = ca.vertcat(*(equations.rates[name] for name in self._engines))
        loads = ca.vertcat(*(equations.rates[name] for name in equations.loads))
        kept = [f"memory {name}" for name in equations.properties.memories]
        memories = ca.vertcat(ca.SX(0, 1), *(equations.rates[name] for name in kept))
        # shafts and blades move before the thrust is worked out, propellers after it
        before = [name for name in self._engines if not name.startswith("rpm")]
        after = [name for name in self._engines if name.startswith("rpm")]
        early = ca.vertcat(ca.SX(0, 1), *(symbols[name] for name in before))
        moved = early + step * ca.vertcat(ca.SX(0, 1), *(equations.rates[name] for name in before))
        loads, rates, memories = ca.substitute([loads, rates, memories], [early], [moved])
        speeds = ca.vertcat(ca.SX(0, 1), *(symbols[name] for name in after))
        places = [self._engines.index(name) for name in after]
        turned = speeds + step * ca.vertcat(ca.SX(0, 1), *(rates[place] for place in places))
        late = ca.substitute(memories, speeds, turned)
        is_speed = [name.endswith("-rpm") for name in kept]
        memories = ca.vertcat(
            ca.SX(0, 1),
            *(late[i] if is_speed[i] else memories[i] for i in range(len(kept))),
        )
        values = dict(zip(before, ca.vertsplit(moved), strict=True)) if before else {}
        values |= dict(zip(after, ca.vertsplit(turned), strict=True)) if after else {}
        engines = ca.vertcat(ca.SX(0, 1), *(values[name] for name in self._engines))
        inputs = {name: each.symbol for name, each in equations.inputs.items()}
        for name in self._inputs:
            refuse_surface(name, equations.inputs[name], name in equations.cut_throttles)
        parameters = dict(equations.parameters)
        given = [
            *equations.states.values(),
            *(inputs.pop(name) for name in self._inputs),
            *(parameters.pop(name) for name in self._parameters),
            *equations.rate_symbols,
            equations.planet_rates,
            *(memory.symbol for memory in self._memories),
        ]
        unused = [*inputs.values(), *parameters.values()]
        zeros = [1.0 if name.startswith("engine") else 0.0 for name in (*inputs, *parameters)]
        function = ca.Function(
            "loads",
            [ca.vertcat(*given), ca.vertcat(ca.SX(0, 1), *unused)],
            [loads, engines, memories],
        )
        values_given = ca.vertcat(x, u, p, *others)
        at_end: Any = function(values_given, ca.SX(ca.DM(zeros)))
        return at_end


def refuse_surface(name: str, pilot_input: PilotInput, is_position: bool) -> None:
    """BadInputError for an input that is no command of the pilot: a surface, or is_position: the
    position of a throttle."""
    if is_position or pilot_input.unit != "1":
        part = "the position of a throttle" if is_position else "a surface itself"
        raise BadInputError(
            f"the input {name} is {part}, which JSBSim's control system moves; its frames are not"
            " flown"
        )


#: The order in which `_compiled` finds the states.
_ORDER = (
    *("speed", "alpha", "beta", "roll_rate", "pitch_rate", "yaw_rate"),
    *("roll", "pitch", "yaw", "altitude"),
)


def _split(motion: Any) -> dict[str, Any]:
    """The parts of a motion, by name."""
    parts = {}
    begin = 0
    for name, size in _MOTION.items():
        parts[name] = motion[begin : begin + size]
        begin += size
    return parts


def _propagated(parts: dict[str, Any], step: float, turning: float) -> dict[str, Any]:
    """Return the states after `FGPropagate`: attitude and rotation by Euler's rule, the velocity by
    the rule of Adams and Bashforth of order 2, the position by that of order 3."""
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
    """(3, 3): axes of the earth from inertial ones."""
    cos = ca.cos(angle)
    sin = ca.sin(angle)
    return ca.vertcat(
        ca.horzcat(cos, sin, 0.0), ca.horzcat(-sin, cos, 0.0), ca.horzcat(0.0, 0.0, 1.0)
    )


def _matrix(attitude: Any) -> Any:
    """(3, 3): body axes from inertial ones, of a quaternion."""
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
    """Altitude above the ellipsoid at sea level, ft, and (3, 3): axes north, east and down from
    those of the earth, at a place in these (Fukushima, Journal of Geodesy 79, 2006)."""
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
    """(3,) acceleration of gravity in axes of the earth (`FGInertial::GetGravityJ2`)."""
    radius = ca.norm_2(place)
    sine = place[2] / radius
    share = 1.5 * planet.flattening * (planet.semimajor / radius) ** 2
    in_plane = 1.0 + share * (1.0 - 5.0 * sine**2)
    along = 1.0 + share * (3.0 - 5.0 * sine**2)
    factors = ca.vertcat(in_plane, in_plane, along)
    return -planet.pull / radius**2 * factors * place / radius


def _flow(air: Any) -> tuple[Any, Any, Any]:
    """Speed, alpha and beta of a velocity through the air in body axes."""
    u, v, w = ca.vertsplit(air)
    in_plane = u * u + w * w
    return ca.sqrt(in_plane + v * v), ca.atan2(w, u), ca.atan2(v, ca.sqrt(in_plane))


def _angles(body_from_local: Any) -> tuple[Any, Any, Any]:
    """Roll, pitch and yaw."""
    roll = ca.atan2(body_from_local[1, 2], body_from_local[2, 2])
    pitch = ca.asin(-body_from_local[0, 2])
    yaw = ca.atan2(body_from_local[0, 1], body_from_local[0, 0])
    return roll, pitch, yaw
