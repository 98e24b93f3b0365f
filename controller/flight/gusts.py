"""Vertical gusts: the discrete 1-cosine gust and Dryden turbulence, as stages of a compiled loop.

Of gusts that differ along the span one updraft is at the center panel and another at both outer panels: the aircraft
flies in its plane of symmetry, and the outer panels meet the mean of what is on the left and on the right.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Protocol

import casadi as ca
import numpy as np

from controller.policy.policies import Memoryless, Unvaried
from hfa_model.vectors import Quantity
from hfa_support.errors import BadInputError, refuse_unless_positive

#: Time scales of turbulence, in ticks: shorter ones a noise that is held for a tick cannot make, longer ones leave
#: the air as it was to rounding.
SHORTEST, LONGEST = 1.0, 1e6
_SIZES = ("memory_size", "constants_size")


class Gust(Protocol):
    """w(t): vertical velocity of the air, ft/s, positive up; with states of its own where it has a filter.

    The same at every panel, or (2,): at the center panel and at both outer panels (`SpanwiseGust`).

    p: what is handed to it anew at every tick (a sample of white noise, say).
    """

    @property
    def memory_size(self) -> int:
        """Number of filter states."""

    @property
    def constants_size(self) -> int:
        """Length of p."""

    def updraft(self, t: Quantity, memory: ca.SX, p: ca.SX) -> Quantity:
        """w(t), a scalar or (2,)."""

    def memory_rate(self, t: Quantity, memory: ca.SX, p: ca.SX) -> ca.SX:
        """d(memory)/dt, (memory_size,)."""

    def start(self) -> np.ndarray:
        """The filter states at t = 0, (memory_size,)."""

    def constants(self, tick: int) -> np.ndarray:
        """p of a tick, (constants_size,)."""


@dataclass(frozen=True)
class OneMinusCosine(Memoryless, Unvaried):
    """w = (peak/2) (1 - cos(2π V (t - begin) / length)) while 0 <= V (t - begin) <= length, else 0.

    length: ft, of the whole gust from still air to still air, twice the gust gradient distance H. peak: ft/s,
    negative for a downdraft. speed: V, ft/s, at which the gust is met. begin: s.
    Source: FAR 25.341(a)(2); MIL-F-8785C, Section 3.7.1.3, whose gust ends at its peak. BadInputError when a
    number is not positive or not finite.
    """

    length: float
    peak: float
    speed: float
    begin: float = 0.0

    def __post_init__(self) -> None:
        """Refuse what is no gust."""
        for name in ("length", "speed"):
            refuse_unless_positive(f"the gust's {name}", getattr(self, name))
        if not np.isfinite([self.peak, self.begin]).all():
            raise BadInputError(f"the gust's peak is {self.peak} and its begin {self.begin}; give finite numbers")

    def updraft(self, t: Quantity, memory: ca.SX, p: ca.SX) -> Quantity:
        """The gust at t; expressions or numbers."""
        phase = 2 * np.pi * self.speed * (t - self.begin) / self.length
        return self.peak / 2 * (1 - ca.cos(ca.fmin(ca.fmax(phase, 0.0), 2 * np.pi)))


@dataclass(frozen=True)
class Dryden:
    """w = sigma sqrt(τ) (1 + √3 τ s) / (1 + τ s)² n,  τ = scale / speed: white noise n through the Dryden filter.

    Spectrum Φ(Ω) = sigma² (scale/π) (1 + 3 (scale Ω)²) / (1 + (scale Ω)²)² over spatial frequencies Ω > 0.
    n is held during each tick of length `interval`; its variance is the one with which w has the variance
    sigma² at the ticks, exactly (1/interval in the limit of short ticks). The flight begins in stationary turbulence,
    which sets in at once; or w grows with t/fade, and is stationary from t = fade on.

    intensity: sigma, ft/s. scale: ft; MIL-F-8785C takes the altitude below 1000 ft and 1750 ft above 2000 ft.
    speed: V, ft/s. interval: s. ticks: how many the flight has. seed: of n and of the start. fade: s, 0 for none.
    Source: MIL-F-8785C, Section 3.7.1.2 (Dryden form) and 3.7.3. BadInputError when a number is not positive or τ does
    not lie between `SHORTEST` and `LONGEST` ticks.
    """

    #: The states of the filter, and one sample of the noise.
    memory_size, constants_size = 2, 1

    intensity: float
    scale: float
    speed: float
    interval: float
    ticks: int
    seed: int
    fade: float = 0.0

    def __post_init__(self) -> None:
        """Refuse what is no turbulence."""
        if not (np.isfinite(self.fade) and self.fade >= 0.0):
            raise BadInputError(f"the turbulence fades in over {self.fade} s; the time must not be negative")
        for name in ("intensity", "scale", "speed", "interval", "ticks"):
            refuse_unless_positive(f"the gust's {name}", getattr(self, name))
        low, high = (ticks * self.interval * self.speed for ticks in (SHORTEST, LONGEST))
        if not low <= self.scale <= high:
            raise BadInputError(
                f"the gust's scale is {self.scale:g} ft; at {self.speed:g} ft/s and ticks of {self.interval:g} s it"
                f" must lie between {low:.4g} and {high:.4g} ft"
            )
        if self.seed < 0:
            raise BadInputError(f"the gust's seed is {self.seed}; give a whole number from 0")

    def updraft(self, t: Quantity, memory: ca.SX, p: ca.SX) -> Quantity:
        """sigma sqrt(τ) (x1 + √3 τ x2) min(t/fade, 1) in the states of `memory_rate`."""
        w = self.intensity * (self._output[0] * memory[0] + self._output[1] * memory[1])
        return w * ca.fmin(t / self.fade, 1.0) if self.fade else w

    def memory_rate(self, t: Quantity, memory: ca.SX, p: ca.SX) -> ca.SX:
        """x1' = x2,  x2' = -x1/τ² - 2 x2/τ + n/τ²: x1 = n / (1 + τ s)²."""
        A, b = self._filter
        return ca.mtimes(ca.DM(A), memory) + ca.DM(b) * p

    def start(self) -> np.ndarray:
        """A draw from the stationary distribution of the filter states, (2,)."""
        return self._draws[0]

    def constants(self, tick: int) -> np.ndarray:
        """The noise of a tick, (1,)."""
        return self._draws[1][tick : tick + 1]

    @property
    def _tau(self) -> float:
        return self.scale / self.speed

    @property
    def _filter(self) -> tuple[np.ndarray, np.ndarray]:
        tau = self._tau
        return np.array([[0.0, 1.0], [-1.0 / tau**2, -2.0 / tau]]), np.array([0.0, 1.0 / tau**2])

    @property
    def _output(self) -> np.ndarray:
        """w / sigma from the filter states."""
        tau = self._tau
        return np.array([1.0, np.sqrt(3.0) * tau]) * np.sqrt(tau)

    @cached_property
    def _draws(self) -> tuple[np.ndarray, np.ndarray]:
        """Start (2,) and noise (ticks,): the held noise gets the variance that makes w's variance sigma²."""
        from scipy.linalg import expm, solve_discrete_lyapunov

        A, b = self._filter
        held = expm(np.block([[A, b[:, None]], [np.zeros((1, 3))]]) * self.interval)
        Phi, Gamma = held[:2, :2], held[:2, 2:]
        unit = solve_discrete_lyapunov(Phi, Gamma @ Gamma.T)
        variance = 1.0 / float(self._output @ unit @ self._output)
        rng = np.random.default_rng(self.seed)
        start = np.linalg.cholesky(variance * unit) @ rng.standard_normal(2)
        return start, np.sqrt(variance) * rng.standard_normal(self.ticks)


@dataclass(frozen=True)
class SpanwiseGust:
    """w = (w_c, w_o) = S (w_1, .., w_k): updrafts at the center panel and at both outer panels, ft/s.

    sources: gusts w_i with memories of their own. center, outer: the rows of S, (k,) each.
    """

    sources: tuple[Gust, ...]
    center: tuple[float, ...]
    outer: tuple[float, ...]

    @property
    def memory_size(self) -> int:
        """States of all filters."""
        return sum(source.memory_size for source in self.sources)

    @property
    def constants_size(self) -> int:
        """What all sources are handed."""
        return sum(source.constants_size for source in self.sources)

    def updraft(self, t: Quantity, memory: ca.SX, p: ca.SX) -> Quantity:
        """(w_c, w_o), (2,)."""
        each = [source.updraft(t, *own) for source, *own in self._own(memory, p)]
        return ca.mtimes(ca.DM(np.array([self.center, self.outer])), ca.vertcat(*each))

    def memory_rate(self, t: Quantity, memory: ca.SX, p: ca.SX) -> ca.SX:
        """Of all filters, one after the other."""
        return ca.vertcat(*(source.memory_rate(t, *own) for source, *own in self._own(memory, p)))

    def start(self) -> np.ndarray:
        """All filter states at t = 0."""
        return np.concatenate([source.start() for source in self.sources])

    def constants(self, tick: int) -> np.ndarray:
        """p of a tick."""
        return np.concatenate([source.constants(tick) for source in self.sources])

    def _own(self, memory: ca.SX, p: ca.SX) -> Iterator[tuple[Gust, ca.SX, ca.SX]]:
        """Each source, its memory and its p."""
        m, k = (np.cumsum([0, *(getattr(each, name) for each in self.sources)]).tolist() for name in _SIZES)
        return zip(self.sources, ca.vertsplit(memory, m), ca.vertsplit(p, k), strict=True)


def side_by_side(center: Gust, outer: Gust) -> SpanwiseGust:
    """One gust at the center panel, another at both outer panels."""
    return SpanwiseGust((center, outer), (1.0, 0.0), (0.0, 1.0))


def spanwise_dryden(turbulence: Dryden, distance: float) -> SpanwiseGust:
    """w_c = w_1,  w_o = ρ(d) w_1 + sqrt((1 + ρ(2d))/2 - ρ(d)²) w_2,  ρ(r) = (1 - r/(2 L)) exp(-r/L), at all times.

    Panels d apart meet turbulence of correlation ρ(d); the outer one is the mean of the left and of the right panel, 2d
    apart. ρ is the transverse correlation of isotropic turbulence whose longitudinal one is exp(-r/L): Dryden's. Along
    the path both have his spectrum; that the correlation across is the same for all wavelengths is an approximation.
    Each panel meets the air at its center, as everywhere in this model.

    turbulence: w_1; w_2 is like it, with noise of its own from the same seed. distance: d, ft, of the centers of two
    panels.
    Source: Batchelor, The Theory of Homogeneous Turbulence, Section 3.4. BadInputError when d is not positive.
    """
    refuse_unless_positive("the distance of the panels", distance, " ft")

    def correlation(r: float) -> float:
        return (1 - r / (2 * turbulence.scale)) * math.exp(-r / turbulence.scale)

    shared = correlation(distance)
    own = math.sqrt(max((1 + correlation(2 * distance)) / 2 - shared**2, 0.0))
    other = replace(turbulence, seed=int(np.random.SeedSequence((turbulence.seed, 1)).generate_state(1, np.uint64)[0]))
    return SpanwiseGust((turbulence, other), (1.0, 0.0), (shared, own))
