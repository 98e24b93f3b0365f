"""Gusts in the equations of an aircraft: linear and angular velocity of the air.

The components u, v and w are air velocities forward, to the right and down, in level axes along
the heading. p, q and r are added to the aircraft's angular rates relative to the air.

A component acts through a disturbance that the model declares. If the model declares none but has
the standard states and units, the still-air equations are evaluated at the motion relative to the
air (`in_gusts`).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any, NamedTuple

import casadi as ca

from hfa_aircraft.model import Model
from hfa_aircraft.rigid.aircraft import flow_rates, rotation, wind_axes
from hfa_aircraft.signals import VECTORS, Signal, record
from hfa_flight.air.gusts import UPDRAFT, state_of
from hfa_support.units import conversion_factor

#: Component of a gust -> disturbance that `in_gusts` adds for it.
ADDED = {
    "u": "gust_forward",
    "v": "gust_right",
    "w": UPDRAFT,
    "p": "gust_roll_rate",
    "q": "gust_pitch_rate",
    "r": "gust_yaw_rate",
}
#: Component of a gust -> factor on it: w is positive down, and an updraft positive up.
_SIGN = {"w": -1.0}
#: Component of a gust -> states that it requires.
_NEEDED = {
    "u": ("speed", "alpha", "pitch"),
    "v": ("speed", "alpha", "pitch", "beta", "roll"),
    "w": ("speed", "alpha", "pitch"),
    "p": ("speed", "alpha", "roll_rate"),
    "q": ("speed", "alpha", "pitch_rate"),
    "r": ("speed", "alpha", "yaw_rate"),
}
_STATES = ("speed", "alpha", "beta", "pitch", "roll", "roll_rate", "pitch_rate", "yaw_rate")
_RATES = {"p": "roll_rate", "q": "pitch_rate", "r": "yaw_rate"}
#: Output that `in_gusts` adds -> the standard name of its value in the air: a pitot tube and vanes.
IN_AIR = {"airspeed": "speed", "angle_of_attack": "alpha", "sideslip": "beta"}
#: States whose rates depend on the motion over the ground.
_OVER_GROUND = (
    *("roll", "pitch", "yaw", "heading", "altitude", "height"),
    *("north", "east", "distance", "position"),
)
#: Outputs that are relative to the ground.
_OUTPUTS_OVER_GROUND = {"gamma", "climb_rate", "ground_speed", "track"}


def gust_factors(model: Model, values: Mapping[str, Any]) -> dict[str, dict[str, Any]]:
    """Return gust component u, v, w, p, q or r -> {disturbance: factor}, for those that a model
    declares.

    The value of a disturbance is the sum of factor times component. Disturbances to the north and
    east are resolved along the heading.

    values: state -> number or expression. Without a yaw, the heading is 0
    """
    declared = {
        name: {added: _SIGN.get(name, 1.0)}
        for name, added in ADDED.items()
        if added in model.disturbances
    }
    if {"gust_north", "gust_east"} <= set(model.disturbances):
        heading = 0.0
        if "yaw" in model.states:
            heading = values.get("yaw", 0.0) * (conversion_factor(model.unit("yaw"), "rad") or 1.0)
        cosine, sine = ca.cos(heading), ca.sin(heading)
        # A declared forward or lateral gust has precedence over one by compass, and over headwind.
        declared.setdefault("u", {"gust_north": cosine, "gust_east": sine})
        declared.setdefault("v", {"gust_north": -sine, "gust_east": cosine})
    if "headwind" in model.disturbances:
        declared.setdefault("u", {"headwind": -1.0})
    return {name: declared[name] for name in ADDED if name in declared}


def missing_states(model: Model, component: str) -> list[str]:
    """Return the states that a gust component requires but the model lacks.

    A state that the model has in a unit without a known size counts as missing.
    """
    return [name for name in _NEEDED[component] if name not in _standard_states(model)]


class _StandardState(NamedTuple):
    """State of a model that has one of the standard names `_STATES`.

    name: name of the state in the model
    size: size of its unit in rad or rad/s; 1 for the speed, which keeps its unit
    """

    name: str
    size: float


@lru_cache(maxsize=16)
def _standard_states(model: Model) -> dict[str, _StandardState]:
    """Return standard name -> state of the model, for the states in units of known size."""
    standard_states = {}
    for standard_name in _STATES:
        name = state_of(model, standard_name)
        if name not in model.states:
            continue
        unit = "rad/s" if standard_name.endswith("_rate") else "rad"
        size = 1.0 if standard_name == "speed" else conversion_factor(model.unit(name), unit)
        if size is not None:
            standard_states[standard_name] = _StandardState(name, size)
    return standard_states


def kind_of_signal(model: Model, name: str) -> str:
    """Return the kind of the model's signal with a name, such as "input", or "" without one."""
    kinds = (*VECTORS.values(), "outputs")  # "states", "inputs", ...: attributes of a model
    return next((kind.removesuffix("s") for kind in kinds if name in getattr(model, kind)), "")


def undeclared(model: Model, disturbance: str, what: str) -> str:
    """Return the message that `in_gusts(model)` lacks a disturbance, and what to change.

    what: subject that requires the disturbance, such as "a gust"
    """
    kind = kind_of_signal(model, disturbance)
    change = f'declare it by disturbances={{"{disturbance}": Signal(unit)}}'
    if kind:
        change = f"rename its {kind} {disturbance}"
    return f"{model.name} declares no disturbance {disturbance}, which {what} requires; {change}"


@lru_cache(maxsize=16)
def in_gusts(model: Model) -> Model:
    """Return the model with added disturbances (`ADDED`) for undeclared gust components, and the
    outputs `IN_AIR`: speed and flow angles relative to the air, in all its disturbances.

    A component or an output is added only if the model has the states that it needs, and no other
    signal, such as an input, with its name. The states remain relative to the
    ground. Let V be the velocity and ω the angular velocity of the aircraft, and V_g the velocity
    (u, v, w) of the air, all resolved in body axes. Relative to the air, V_a = V - V_g and ω_a = ω
    + (p, q, r). Forces and moments are those of the model at V_a, ω_a. The model's equation V' =
    a(V_a, ω_a) - ω_a x V_a becomes V' = a(V_a, ω_a) - ω x V. Angles and position change with V and
    ω.

    Approximation: gyroscopic moments are evaluated at ω_a, an error of second order in the rates.
    """
    declared = gust_factors(model, {})
    added = [
        name
        for name in ADDED
        if name not in declared
        and not missing_states(model, name)
        and not kind_of_signal(model, ADDED[name])
    ]
    standard = _standard_states(model)
    outputs = {
        output: model.signals[standard[name].name]._replace(assumed=False)
        for output, name in IN_AIR.items()
        if {"speed", "alpha", "pitch", name} <= set(standard) and not kind_of_signal(model, output)
    }
    if not (added or outputs):
        return model
    speed = model.unit(state_of(model, "speed"))
    signals = {ADDED[name]: Signal("rad/s" if name in _RATES else speed) for name in added}
    return replace(
        model,
        equations=_InGusts(model, tuple(added), tuple(outputs)),
        disturbances={**model.disturbances, **signals},
        outputs={**model.outputs, **outputs},
    )


def relative_to_air(model: Model) -> dict[str, str]:
    """Return state -> output of `in_gusts(model)`: its value relative to the air, in its unit.

    A declared output of another unit is another quantity.
    """
    outputs, standard = in_gusts(model).outputs, _standard_states(model)
    return {
        state.name: output
        for output, name in IN_AIR.items()
        if (state := standard.get(name)) and output in outputs
        if outputs[output].unit == model.unit(state.name)
    }


def seen_in_air(
    model: Model,
    values: Mapping[str, Any],
    trim: Mapping[str, float],
    winds: Mapping[str, Any],
    *,
    is_over_ground: bool,
) -> dict[str, Any]:
    """Return state -> value that a policy sees in moving air, of the speed and the flow angles.

    The flow angles are relative to the air, as a vane measures them. The speed is the component of
    the velocity along the path of the trim, without the w²/2V that an updraft w adds to the speed
    over the ground if the path follows it, and else to the airspeed. Where nothing measures the
    motion over the ground, it is relative to the horizontal wind: the wind itself is then unknown.
    The result is empty if the model has no speed, alpha and pitch as states, and without winds.

    values: state -> value over the ground, as number or expression, of all states
    trim: state -> value at the trim
    winds: disturbance of `in_gusts(model)` -> value
    is_over_ground: whether the speed is that over the ground
    """
    states = _standard_states(model)
    if not winds or not {"speed", "alpha", "pitch"} <= set(states):
        return {}
    motion = {name: values[state.name] * state.size for name, state in states.items()}
    at_trim = {name: trim[state.name] * state.size for name, state in states.items()}
    wind = _wind(in_gusts(model), trim, winds)
    velocity, to_level = _velocity(motion), _to_level_axes(motion)
    flow = _flow(velocity - ca.mtimes(to_level.T, wind))
    path = ca.mtimes(_to_level_axes(at_trim), _velocity(at_trim))
    horizontal = ca.vertcat(wind[0], wind[1], 0.0) * (not is_over_ground)
    flow["speed"] = ca.dot(ca.mtimes(to_level, velocity) - horizontal, path / ca.norm_2(path))
    return {states[name].name: flow[name] / states[name].size for name in flow if name in states}


def _wind(model: Model, values: Mapping[str, Any], winds: Mapping[str, Any]) -> Any:
    """Return the velocity (u, v, w) of the air in level axes, (3,), in the unit of the speed.

    values: state -> value, for the heading of winds by compass
    winds: disturbance of the model -> value
    """
    unit = model.unit(_standard_states(model)["speed"].name)
    factors = gust_factors(model, values)
    wind: list[Any] = [0.0, 0.0, 0.0]
    for place, component in enumerate("uvw"):
        for name, factor in factors.get(component, {}).items():
            size = conversion_factor(model.disturbances[name].unit, unit) or 1.0
            wind[place] += factor * size * winds.get(name, 0.0)
    return ca.vertcat(*wind)


def _velocity(motion: Mapping[str, Any]) -> Any:
    """Return the velocity in body axes, (3,). A motion without sideslip has the sideslip 0.

    motion: standard name of a state -> its value
    """
    along = wind_axes(motion["alpha"], motion.get("beta", 0.0))[:, 0]  # direction of the velocity
    return motion["speed"] * along


def _to_level_axes(motion: Mapping[str, Any]) -> Any:
    """Return the rotation from body axes to level axes along the heading. An angle that is not a
    state is 0.
    """
    # no yaw: the level axes turn with the heading
    return rotation(motion.get("roll", 0.0), motion.get("pitch", 0.0), 0.0)


def _flow(velocity: Any) -> dict[str, Any]:
    """Return the speed and the flow angles of a velocity in body axes, (3,)."""
    speed = ca.norm_2(velocity)
    return {
        "speed": speed,
        "alpha": ca.atan2(velocity[2], velocity[0]),
        "beta": ca.asin(velocity[1] / speed),
    }


@dataclass(frozen=True)
class _InGusts:
    """Equations (x, u, p, w) -> (rates by state, outputs by name) of a model in gusts."""

    model: Model
    added: tuple[str, ...]  # gust components that the model does not declare
    outputs: tuple[str, ...]  # those of `IN_AIR` that it does not declare

    def __call__(self, x: Any, u: Any, p: Any, w: Any) -> tuple[Mapping[str, Any], Any]:
        """Return the rates by state and the outputs by name, by the equations in `in_gusts`.

        x, u, p, w: states, inputs, parameters and disturbances, each an attribute by its name
        """
        names = self.model.layout.names
        declared = record(names.disturbances)(*(getattr(w, name) for name in names.disturbances))
        gust = dict.fromkeys(ADDED, 0.0)  # the model's own equations have the declared ones
        gust |= {name: _SIGN.get(name, 1.0) * getattr(w, ADDED[name]) for name in self.added}

        # Motion over the ground, V and ω, and relative to the air, V_a and ω_a.
        standard = _standard_states(self.model)
        motion = {name: getattr(x, state.name) * state.size for name, state in standard.items()}
        velocity = _velocity(motion)
        air = ca.vertcat(*(gust[name] for name in "uvw"))
        velocity_in_air = velocity - ca.mtimes(_to_level_axes(motion).T, air)
        rates = ca.vertcat(*(motion.get(name, 0.0) for name in _RATES.values()))
        rates_in_air = rates + ca.vertcat(gust["p"], gust["q"], gust["r"])
        in_air = _flow(velocity_in_air)
        in_air |= zip(_RATES.values(), ca.vertsplit(rates_in_air), strict=True)
        motion_in_air = {name: in_air.get(name, angle) for name, angle in motion.items()}

        # The model at V_a and ω_a.
        x_in_air = {name: getattr(x, name) for name in names.states}
        for name, state in standard.items():
            x_in_air[state.name] = motion_in_air[name] / state.size
        rates_of_model, outputs_in_air = self.model.equations(
            record(names.states)(*x_in_air.values()), u, p, declared
        )
        outputs = dict(outputs_in_air)

        # From V' = a - ω_a x V_a of the model to V' = a - ω x V.
        acceleration = _acceleration(
            motion_in_air,
            {name: rates_of_model[state.name] * state.size for name, state in standard.items()},
        )
        acceleration += ca.cross(rates_in_air, velocity_in_air) - ca.cross(rates, velocity)
        flow_rates_over_ground = dict(
            zip(("speed", "alpha", "beta"), flow_rates(velocity, acceleration), strict=True)
        )

        # Angles and position change with V and ω, the speed and the flow angles with V'.
        rates_over_ground, outputs_over_ground = self.model.equations(x, u, p, declared)
        over_ground = {state_of(self.model, name) or name for name in _OVER_GROUND}
        changed = {
            name: rates_over_ground[name] for name in self.model.states if name in over_ground
        }
        for name, state in standard.items():
            if name in flow_rates_over_ground:
                changed[state.name] = flow_rates_over_ground[name] / state.size

        # Outputs in all moving air, and those that are relative to the ground.
        values = {name: getattr(x, name) for name in names.states}
        winds = {name: getattr(w, name) for name in names.disturbances}
        wind = air + (_wind(self.model, values, winds) if self.outputs else 0.0)
        flow = _flow(velocity - ca.mtimes(_to_level_axes(motion).T, wind))
        for output in self.outputs:
            outputs[output] = flow[IN_AIR[output]] / standard[IN_AIR[output]].size
        for output in _OUTPUTS_OVER_GROUND & set(outputs):
            outputs[output] = outputs_over_ground[output]
        return {**rates_of_model, **changed}, outputs


def _acceleration(motion: Mapping[str, Any], rates: Mapping[str, Any]) -> Any:
    """Return the time derivatives of the body-axis velocity components, (3,).

    motion, rates: standard name of a state -> its value, and its time derivative
    """
    speed, alpha, beta = (motion.get(name, 0.0) for name in ("speed", "alpha", "beta"))
    # V' = (V', V β', V cos β α') along the wind axes, which turn with the velocity
    in_wind_axes = ca.vertcat(
        rates["speed"],
        speed * rates.get("beta", 0.0),
        speed * ca.cos(beta) * rates["alpha"],
    )
    return ca.mtimes(wind_axes(alpha, beta), in_wind_axes)
