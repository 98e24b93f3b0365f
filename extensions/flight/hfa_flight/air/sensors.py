"""Sensors: what they measure of an aircraft in its air, and their errors."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np
from numpy.random import SeedSequence

from hfa_aircraft.model import Model
from hfa_flight.air.gust_equations import in_gusts
from hfa_support.errors import BadInputError, is_finite, prefix_errors, refuse_unknown, shown
from trim.point.operating_point import OperatingPoint

#: Keys of the independent random streams of a member for the noise and the signs of biases.
_NOISE = 1
_BIAS = 3

#: Function number of samples -> errors of the next samples, (count, k).
Errors = Callable[[int], np.ndarray]


@dataclass(frozen=True)
class Sensor:
    """Errors of a sensor, in the unit of what it measures.

    noise: standard deviation of a value, white from sample to sample
    bias: size of a bias. A flight has it with a random sign; a filter estimates it, and takes the
        size as its standard deviation at the beginning
    every: time between values, s, a whole number of samples; 0 for a value in each sample

    Raises BadInputError for a negative number.

    >>> import hfa
    >>> hfa.Sensor(0.3, bias=2.0).every
    0.0
    """

    noise: float
    bias: float = 0.0
    every: float = 0.0

    def __post_init__(self) -> None:
        """Raise BadInputError for a negative number."""
        for name, value in vars(self).items():
            if not (is_finite(value) and value >= 0.0):
                raise BadInputError(f"the {name} is {shown(value)}; give a number of at least 0")


def measurable(model: Model) -> tuple[str, ...]:
    """Return what sensors may measure: linear states, and outputs of the model in moving air."""
    return (*model.linear, *(name for name in in_gusts(model).outputs if name not in model.linear))


def sensors_of(given: Mapping[str, Any], model: Model | None = None) -> dict[str, Sensor]:
    """Return the sensors, by what they measure, of standard deviations of noise or `Sensor`.

    model: aircraft of which each must measure a linear state or an output, if it is known
    """
    sensors = {}
    for name, value in given.items():
        if model is not None:
            refuse_unknown("unknown sensor of", name, measurable(model))
        with prefix_errors(f"the sensor of {name}"):
            sensors[name] = value if isinstance(value, Sensor) else Sensor(value)
    return sensors


def measured(
    point: OperatingPoint,
    names: tuple[str, ...],
    x: ca.SX,
    u: ca.SX,
    p: Any,
    winds: Mapping[str, Any],
) -> ca.SX:
    """Return what sensors measure without errors, (p,), as deviations from the trim in still air.

    x, u: deviations of all states and of the inputs from the trim
    p: parameters of the model
    winds: disturbance of `in_gusts(model)` -> value
    """
    values = dict(zip(point.model.states, ca.vertsplit(ca.SX(x)), strict=True))
    if outputs := tuple(name for name in names if name not in values):
        at = ca.DM(point.x) + x, ca.DM(point.u) + u, p
        in_air = values_in_air(point.model, outputs, at, winds) - ca.DM(at_trim(point, outputs))
        values |= zip(outputs, ca.vertsplit(in_air), strict=True)
    return ca.vertcat(*(values[name] for name in names))


def values_in_air(
    model: Model, names: tuple[str, ...], at: tuple[Any, Any, Any], winds: Mapping[str, Any]
) -> ca.SX:
    """Return states, and outputs of `in_gusts(model)`, (k,), absolute.

    at: states, inputs and parameters
    winds: disturbance -> value
    """
    values = dict(zip(model.states, ca.vertsplit(ca.SX(at[0])), strict=True))
    if outputs := tuple(name for name in names if name not in values):
        moving = in_gusts(model)
        w = [winds.get(name, 0.0) for name in moving.disturbances]
        _, found = moving.layout.expressions(at, outputs, w or None)
        values |= zip(outputs, ca.vertsplit(found), strict=True)
    return ca.vertcat(*(values[name] for name in names))


def at_trim(point: OperatingPoint, names: tuple[str, ...]) -> np.ndarray:
    """Return states and outputs at a trim in still air, (p,)."""
    values = values_in_air(point.model, names, (point.x, point.u, point.model.p), {})
    return np.asarray(ca.evalf(values)).ravel()


def names_with_errors(model: Model, sensors: Mapping[str, Sensor]) -> tuple[str, ...]:
    """Return what has errors in a flight: the linear states, then the measured outputs."""
    return tuple(dict.fromkeys((*model.linear, *sensors)))


def drawn_errors(sensors: Mapping[str, Sensor], model: Model, seed: int, member: int) -> Errors:
    """Return the errors of `names_with_errors` in a flight; without a sensor they are 0.

    The noise is drawn for each sample, and the sign of a bias once.
    """
    names = names_with_errors(model, sensors)
    of_names = [sensors.get(name, Sensor(0.0)) for name in names]
    noise, bias = np.array([(sensor.noise, sensor.bias) for sensor in of_names]).T
    random, signs = (
        np.random.default_rng(SeedSequence(seed, spawn_key=(member, stream)))
        for stream in (_NOISE, _BIAS)
    )
    bias = bias * signs.choice([-1.0, 1.0], len(names))
    return lambda count: noise * random.standard_normal((count, len(names))) + bias
