"""Gusts as parts of a simulation loop, and the discrete 1-cosine gust."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from hfa_aircraft.model import Model
from hfa_flight.air.names import UPDRAFT
from hfa_support.errors import BadInputError, refuse_unless_positive


class Gust:
    """Base class of gusts.

    names: disturbances of the model that the gust sets
    held_size: number of inputs of the gust that are constant during a tick
    rises: whether the gust begins in calm and is stationary only later
    """

    names: tuple[str, ...] = (UPDRAFT,)
    held_size = 0
    rises = False

    def winds(self, t: Any, held: ca.SX) -> dict[str, Any]:
        """Return the gust at a time, as disturbance of the model -> value.

        t: s
        held: (held_size,), held inputs of the tick
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
        """Return the held inputs of a sample, (held_size,)."""
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
        """Return the updraft at time t."""
        return {UPDRAFT: ca.SX(self.updraft(t))}

    def updraft(self, t: Any) -> Any:
        """Return the updraft w at t, positive up, as a number or an expression."""
        phase = 2 * np.pi * self.speed * (t - self.begin) / self.length
        return self.peak / 2 * (1 - ca.cos(ca.fmin(ca.fmax(phase, 0.0), 2 * np.pi)))
