"""Records of simulated flights with sensor noise."""

from __future__ import annotations

from collections.abc import Mapping
from types import SimpleNamespace
from typing import Any

import numpy as np

from hfa import Flight, Model

#: Measured state -> standard deviation of its noise.
SENSORS = {"speed": 0.3, "alpha": 0.003, "pitch_rate": 0.01, "pitch": 0.003}


def noisy_columns(
    model: Model,
    flight: Flight,
    every: int,
    seed: int,
    sensors: Mapping[str, float] = SENSORS,
) -> dict[str, np.ndarray]:
    """Return the columns of a record by name: the time, the inputs, and noisy states, (N,) each.

    every: number of simulation steps between samples.
    seed: seed of the noise.
    sensors: state -> standard deviation of its noise.
    """
    generator = np.random.default_rng(seed)
    columns = {"time": flight.time[::every]}
    for place, name in enumerate(model.inputs):
        columns[name] = flight.inputs[::every, place]
    for name, size in sensors.items():
        states = flight.states[::every, list(model.states).index(name)]
        columns[name] = states + size * generator.standard_normal(len(states))
    return columns


#: States of the longitudinal motion, and the inputs that affect them.
_STATES = ("speed", "alpha", "pitch_rate", "pitch")
_INPUTS = ("thrust", "elevator")


def longitudinal(aircraft: Model) -> Model:
    """Return the longitudinal motion of a rigid aircraft at constant altitude, as a model."""
    states, inputs = list(aircraft.states), list(aircraft.inputs)
    held = {name: aircraft.trim.get(name, 0.0) for name in (*states, *inputs)}

    def equations(x: Any, u: Any, p: Any, w: Any) -> Any:
        at = held | {name: getattr(x, name) for name in _STATES}
        at |= {name: getattr(u, name) for name in _INPUTS}
        full_x = SimpleNamespace(**{name: at[name] for name in states})
        full_u = SimpleNamespace(**{name: at[name] for name in inputs})
        rates, outputs = aircraft.equations(full_x, full_u, p, w)
        return {name: rates[name] for name in _STATES}, {"gamma": outputs["gamma"]}

    return Model(
        name=aircraft.name,
        states={name: aircraft.states[name] for name in _STATES},
        inputs={name: aircraft.inputs[name] for name in _INPUTS},
        equations=equations,
        parameters=aircraft.parameters,
        outputs={"gamma": aircraft.outputs["gamma"]},
        trim={name: aircraft.trim[name] for name in ("speed", "gamma")},
    )
