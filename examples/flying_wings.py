"""Two statically unstable flying wings in longitudinal flight, with elevons and throttle."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from typing import Any

import casadi as ca

import hfa

_GRAVITY = 9.81
_DENSITY = 1.225


def wing(numbers: Mapping[str, float], x: Any, u: Any, p: Any, w: Any) -> Any:
    """Return the state derivatives and the outputs of a flying wing.

    V' = (T cos α - D) / m - g sin γ,  α' = q - (L + T sin α) / (m V) + g cos γ / V,  θ' = q,
    q' = M / I, with γ = θ - α, C_L = a α + a_δ δ, C_D = C_D0 + k C_L²,
    C_m = m_0 + m_α α + m_δ δ + m_q q c / 2V

    numbers: mass, inertia, area, chord and coefficients, SI
    """
    pressure_area = 0.5 * _DENSITY * x.speed**2 * numbers["area"]
    lift_coefficient = numbers["lift_slope"] * x.alpha + numbers["lift_elevon"] * u.elevon
    drag_coefficient = numbers["drag"] + numbers["induced"] * lift_coefficient**2
    reduced_rate = x.pitch_rate * numbers["chord"] / (2.0 * x.speed)
    moment_coefficient = (
        numbers["moment"]
        + numbers["moment_alpha"] * x.alpha
        + numbers["moment_rate"] * reduced_rate
        + numbers["moment_elevon"] * u.elevon
    )
    lift = pressure_area * lift_coefficient
    drag = pressure_area * drag_coefficient
    gamma = x.pitch - x.alpha
    thrust = u.thrust
    mass = numbers["mass"]
    acceleration = (thrust * ca.cos(x.alpha) - drag) / mass - _GRAVITY * ca.sin(gamma)
    turn = (lift + thrust * ca.sin(x.alpha)) / (mass * x.speed)
    return {
        "speed": acceleration,
        "alpha": x.pitch_rate - turn + _GRAVITY * ca.cos(gamma) / x.speed,
        "pitch": x.pitch_rate,
        "pitch_rate": pressure_area * numbers["chord"] * moment_coefficient / numbers["inertia"],
    }, {"gamma": gamma}


def _model(name: str, speed: float, thrust: float, numbers: Mapping[str, float]) -> hfa.Model:
    """Return a flying wing that flies level at a speed, m/s.

    thrust: largest thrust, N
    numbers: as in `wing`
    """
    # Unit, nominal value, least and largest value of each signal.
    states = {
        "speed": hfa.Signal("m/s", 0.1 * speed, 0.7 * speed, 1.5 * speed),
        "alpha": hfa.Signal("rad", 0.1, -0.15, 0.25),
        "pitch": hfa.Signal("rad", 0.1),
        "pitch_rate": hfa.Signal("rad/s", 0.2),
    }
    inputs = {
        "elevon": hfa.Signal("rad", 0.1, -0.4, 0.4),
        "thrust": hfa.Signal("N", 0.2 * thrust, 0.0, thrust),
    }
    return hfa.Model(
        name,
        states,
        inputs,
        partial(wing, numbers),
        outputs={"gamma": hfa.Signal("rad")},
        trim={"speed": speed, "gamma": 0.0},
    )


#: Small wing of 3 kg, whose center of gravity is 3 % of the chord behind the neutral point.
SMALL = _model(
    "small flying wing",
    16.0,
    12.0,
    {
        "mass": 3.0,
        "inertia": 0.09,
        "area": 0.62,
        "chord": 0.34,
        "lift_slope": 4.3,
        "lift_elevon": 0.5,
        "drag": 0.018,
        "induced": 0.06,
        "moment": 0.0,
        "moment_alpha": 0.13,
        "moment_rate": -1.4,
        "moment_elevon": -0.35,
    },
)
#: Wing of 5 t, whose center of gravity is 9 % of the chord behind the neutral point.
LARGE = _model(
    "large flying wing",
    110.0,
    16000.0,
    {
        "mass": 5000.0,
        "inertia": 14000.0,
        "area": 38.0,
        "chord": 3.6,
        "lift_slope": 4.0,
        "lift_elevon": 0.6,
        "drag": 0.012,
        "induced": 0.055,
        "moment": 0.0,
        "moment_alpha": 0.36,
        "moment_rate": -1.1,
        "moment_elevon": -0.4,
    },
)
