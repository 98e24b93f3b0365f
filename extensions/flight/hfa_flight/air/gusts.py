"""Gusts as parts of a simulation loop, and the discrete 1-cosine gust."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from hfa_aircraft.model import Model
from hfa_aircraft.signals import recognized
from hfa_support.errors import BadInputError, refuse_unless_positive
from hfa_support.units import conversion_factor, si_factor
from trim.point.operating_point import OperatingPoint

#: Disturbance of a model for a vertical gust.
UPDRAFT = "updraft"
#: Standard name of a state -> role for which another state may be recognized.
_ROLES = {
    **{"pitch": "theta", "roll": "phi"},
    **{"roll_rate": "p", "pitch_rate": "q", "yaw_rate": "r"},
}


def state_of(model: Model, name: str) -> str:
    """Return the state or output with a standard name, or the recognized state, or "".

    name: speed, alpha, beta, pitch, roll or one of their rates, or altitude
    """
    if name in model.states or name in model.outputs:
        return name
    return recognized(model.states).get(_ROLES.get(name, name), "")


def gust_speed(point: OperatingPoint) -> float:
    """Return the speed at which gusts pass an aircraft at its trim, in its units of length per s.

    It is a state or an output of the model. Raises BadInputError if the model has neither.
    """
    model = point.model
    name = state_of(model, "speed")
    if not name:
        raise BadInputError(
            f"{model.name} has no state that is recognized as its speed, which a gust requires; "
            "an aircraft in Python may declare a state or output speed"
        )
    value = point.values.get(name)
    if value is None:  # an output
        value = model.outputs_at(point.states, point.inputs, [name])[name]
    feet_per_second = conversion_factor(model.unit(name), "ft/s")
    if feet_per_second is None:  # not a unit of speed
        return value
    return value * feet_per_second * foot_in_length_unit(model)


def foot_in_length_unit(model: Model) -> float:
    """Return the length of a foot in the unit of length that belongs to the speed of a model.

    The unit is ft for ft/s, that of the altitude for knots (ft without an altitude), and else m.
    """
    unit = model.unit(state_of(model, "speed"))
    if unit == "ft/s":
        return 1.0
    if unit in ("kt", "kts", "knot"):
        altitude = state_of(model, "altitude")
        in_unit_of_altitude = conversion_factor("ft", model.unit(altitude)) if altitude else None
        return in_unit_of_altitude or 1.0
    return si_factor("ft")


class Gust:
    """Base class of gusts.

    names: disturbances of the model that the gust sets
    rises: whether the gust begins in calm and is stationary only later
    """

    names: tuple[str, ...] = (UPDRAFT,)
    rises = False

    def winds(self, t: Any, held: ca.SX) -> dict[str, Any]:
        """Return the gust at a time, as disturbance of the model -> value.

        t: s
        held: `held_inputs` of the sample, as symbols
        """
        raise NotImplementedError

    def left_out(self, model: Model) -> list[str]:
        """Return a sentence for each gust component that the model does not support.

        Each sentence states the reason.
        """
        return []

    def text(self, model: Model) -> str:
        """Return a note on the gust for the report of a flight, or ""."""
        return ""

    def held_inputs(self, sample: int) -> np.ndarray:
        """Return the inputs of `winds` that are constant during a sample."""
        return np.zeros(0)


@dataclass(frozen=True)
class OneMinusCosine(Gust):
    """Discrete gust w = (peak/2) (1 - cos(2π V (t - begin) / length)).

    The formula applies for 0 <= V (t - begin) <= length. Otherwise w is 0. Lengths and speeds are
    in the units of the model.

    length: length of the complete gust, twice the gust gradient distance H
    peak: largest w, negative for a downdraft
    speed: airspeed V
    begin: s

    Raises BadInputError if length or speed is not positive, or peak or begin not finite. Source:
    FAR 25.341(a)(2); MIL-F-8785C, Section 3.7.1.3, whose gust ends at its peak.

    >>> from hfa_flight import OneMinusCosine
    >>> OneMinusCosine(length=400.0, peak=5.0, speed=100.0, begin=1.0).until
    5.0
    """

    length: float
    peak: float
    speed: float
    begin: float = 0.0

    def __post_init__(self) -> None:
        """Raise BadInputError if a number is not finite, or if length or speed is not positive."""
        for name in ("length", "speed"):
            refuse_unless_positive(f"the gust's {name}", getattr(self, name))
        if not np.isfinite([self.peak, self.begin]).all():
            raise BadInputError(
                f"the peak of the gust is {self.peak} and the start time {self.begin}; give "
                "finite numbers"
            )

    @property
    def until(self) -> float:
        """Time at which the gust ends, s."""
        return self.begin + self.length / self.speed

    def winds(self, t: Any, held: ca.SX) -> dict[str, Any]:
        """Return the updraft w at time t, positive up."""
        phase = 2 * np.pi * self.speed * (t - self.begin) / self.length
        return {UPDRAFT: self.peak / 2 * (1 - ca.cos(ca.fmin(ca.fmax(phase, 0.0), 2 * np.pi)))}
