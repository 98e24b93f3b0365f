"""Records of simulated flights, with the noise of sensors."""

from __future__ import annotations

from collections.abc import Mapping

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
    """Return the columns of a record: time, the inputs, and the states of `sensors` with noise.

    every: number of steps of the flight from one sample to the next.
    """
    generator = np.random.default_rng(seed)
    columns = {"time": flight.times[::every]}
    for place, name in enumerate(model.inputs):
        columns[name] = flight.inputs[::every, place]
    for name, size in sensors.items():
        states = flight.states[::every, list(model.states).index(name)]
        columns[name] = states + size * generator.standard_normal(len(states))
    return columns
