"""Gusts as stages of a compiled loop: the discrete 1-cosine gust and Dryden turbulence, both
vertical."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import casadi as ca
import numpy as np

from hfa_aircraft.model import Model
from hfa_flight.air import UPDRAFT
from hfa_support.errors import BadInputError, refuse_unless_positive, refuse_unless_whole

#: Time scales of turbulence, in ticks: shorter ones a noise that is held for a tick cannot make,
#: longer ones leave the air as it was to rounding.
SHORTEST = 1.0
LONGEST = 1e6


class Gust:
    """The motion of the air, a stage of a loop; unless it has other `winds`, w(t) positive up.

    names: disturbances of the model that it moves
    memory_size: number of states of its filter
    held_size: numbers that it is handed anew in each tick
    """

    names: tuple[str, ...] = (UPDRAFT,)
    memory_size = 0
    held_size = 0

    def winds(self, t: Any, memory: ca.SX, held: ca.SX) -> dict[str, Any]:
        """Disturbance of the model -> its value at t."""
        return {UPDRAFT: ca.SX(self.updraft(t, memory, held))}

    def updraft(self, t: Any, memory: ca.SX, held: ca.SX) -> Any:
        """w at t; expressions or numbers."""
        raise NotImplementedError

    def memory_rate(self, t: Any, memory: ca.SX, held: ca.SX) -> ca.SX:
        """Time derivative of the states of the filter, (memory_size,)."""
        return ca.SX(0, 1)

    def left_out(self, model: Model) -> list[str]:
        """Return sentences on the components that the equations of a model omit, with the
        reasons."""
        return []

    def text(self, model: Model) -> str:
        """Return the note on it for the report of a flight; "" for none."""
        return ""

    def start(self) -> np.ndarray:
        """States of the filter at the beginning, (memory_size,)."""
        return np.zeros(0)

    def held_inputs(self, tick: int) -> np.ndarray:
        """The held inputs in a tick, (held_size,)."""
        return np.zeros(0)


@dataclass(frozen=True)
class OneMinusCosine(Gust):
    """w = (peak/2) (1 - cos(2π V (t - begin) / length)) while 0 <= V (t - begin) <= length, else 0.

    length: ft, of the whole gust from still air to still air, twice the gust gradient distance H
    peak: ft/s, negative for a downdraft
    speed: V, ft/s, at which the gust is met
    begin: s

    Source: FAR 25.341(a)(2); MIL-F-8785C, Section 3.7.1.3, whose gust ends at its peak.
    BadInputError when a number is not positive or not finite.

    >>> from hfa_flight import OneMinusCosine
    >>> OneMinusCosine(length=400.0, peak=5.0, speed=100.0, begin=1.0).until
    5.0
    """

    length: float
    peak: float
    speed: float
    begin: float = 0.0

    def __post_init__(self) -> None:
        """Check that it is a gust."""
        for name in ("length", "speed"):
            refuse_unless_positive(f"the gust's {name}", getattr(self, name))
        if not np.isfinite([self.peak, self.begin]).all():
            raise BadInputError(
                f"the gust's peak is {self.peak} and its begin {self.begin}; give finite numbers"
            )

    @property
    def until(self) -> float:
        """When it ends, s."""
        return self.begin + self.length / self.speed

    def updraft(self, t: Any, memory: ca.SX, held: ca.SX) -> Any:
        """w at t; expressions or numbers."""
        phase = 2 * np.pi * self.speed * (t - self.begin) / self.length
        return self.peak / 2 * (1 - ca.cos(ca.fmin(ca.fmax(phase, 0.0), 2 * np.pi)))


@dataclass(frozen=True)
class Dryden(Gust):
    """w = sigma sqrt(τ) (1 + √3 τ s) / (1 + τ s)² n,  τ = scale / speed: white noise n through the
    Dryden filter.

    Spectrum Φ(Ω) = sigma² (scale/π) (1 + 3 (scale Ω)²) / (1 + (scale Ω)²)² over spatial frequencies
    Ω > 0. n is held during each tick of length `interval`; its variance is the one with which w has
    the variance sigma² at the ticks, exactly (1/interval in the limit of short ticks). The flight
    begins in stationary turbulence.

    intensity: sigma, ft/s
    scale: ft; MIL-F-8785C takes the altitude below 1000 ft and 1750 ft above 2000 ft
    speed: V, ft/s
    interval: s
    ticks: how many the flight has
    seed: of n and of the start

    Source: MIL-F-8785C, Section 3.7.1.2 (Dryden form) and 3.7.3. BadInputError when a
    number is not positive or τ does not lie between `SHORTEST` and `LONGEST` ticks."""

    memory_size = 2
    held_size = 1

    intensity: float
    scale: float
    speed: float
    interval: float
    ticks: int
    seed: int

    def __post_init__(self) -> None:
        """Check that it is turbulence."""
        for name in ("intensity", "scale", "speed", "interval", "ticks"):
            refuse_unless_positive(f"the gust's {name}", getattr(self, name))
        low, high = (ticks * self.interval * self.speed for ticks in (SHORTEST, LONGEST))
        if not low <= self.scale <= high:
            raise BadInputError(
                f"the gust's scale is {self.scale:g} ft; at {self.speed:g} ft/s and ticks of"
                f" {self.interval:g} s it must lie between {low:.4g} and {high:.4g} ft"
            )
        refuse_unless_whole("the gust's seed", self.seed, 0)

    def updraft(self, t: Any, memory: ca.SX, held: ca.SX) -> Any:
        """sigma sqrt(τ) (x1 + √3 τ x2) in the states of `memory_rate`."""
        _, _, output = self._filter
        return self.intensity * (output[0] * memory[0] + output[1] * memory[1])

    def memory_rate(self, t: Any, memory: ca.SX, held: ca.SX) -> ca.SX:
        """x1' = x2,  x2' = -x1/τ² - 2 x2/τ + n/τ²: x1 = n / (1 + τ s)²."""
        A, b, _ = self._filter
        return ca.mtimes(ca.DM(A), memory) + ca.DM(b) * held

    def start(self) -> np.ndarray:
        """A draw from the stationary distribution of the filter states, (2,)."""
        return self._draws[0]

    def held_inputs(self, tick: int) -> np.ndarray:
        """The noise of a tick, (1,)."""
        return self._draws[1][tick : tick + 1]

    @property
    def _filter(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """A and b of x' = A x + b n, and c of w / sigma = c x."""
        tau = self.scale / self.speed
        A = np.array([[0.0, 1.0], [-1.0 / tau**2, -2.0 / tau]])
        b = np.array([0.0, 1.0 / tau**2])
        c = np.array([1.0, np.sqrt(3.0) * tau]) * np.sqrt(tau)
        return A, b, c

    @cached_property
    def _draws(self) -> tuple[np.ndarray, np.ndarray]:
        """Start (2,) and noise (ticks,): the held noise gets the variance that makes w's variance
        sigma²."""
        from scipy.linalg import expm, solve_discrete_lyapunov

        A, b, output = self._filter
        transition = expm(np.block([[A, b[:, None]], [np.zeros((1, 3))]]) * self.interval)
        Phi = transition[:2, :2]
        Gamma = transition[:2, 2:]
        unit = solve_discrete_lyapunov(Phi, Gamma @ Gamma.T)
        variance = 1.0 / float(output @ unit @ output)
        rng = np.random.default_rng(self.seed)
        start = np.linalg.cholesky(variance * unit) @ rng.standard_normal(2)
        return start, np.sqrt(variance) * rng.standard_normal(self.ticks)
