"""Gusts that differ along the span: one updraft at the center panel, another at both outer panels.

The aircraft flies in its plane of symmetry: the outer panels meet the mean of what is on the left and on the right.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import casadi as ca
import numpy as np

from controller.flight.gusts import Dryden, Gust
from hfa_model.support.errors import BadInputError
from hfa_model.vectors import Quantity


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
        each = [source.updraft(t, *own) for source, own in zip(self.sources, self._own(memory, p), strict=True)]
        rows = (self.center, self.outer)
        return ca.vertcat(*(sum(share * w for share, w in zip(row, each, strict=True)) for row in rows))

    def memory_rate(self, t: Quantity, memory: ca.SX, p: ca.SX) -> ca.SX:
        """Of all filters, one after the other."""
        pairs = zip(self.sources, self._own(memory, p), strict=True)
        return ca.vertcat(*(source.memory_rate(t, *own) for source, own in pairs))

    def start(self) -> np.ndarray:
        """All filter states at t = 0."""
        return np.concatenate([source.start() for source in self.sources])

    def constants(self, tick: int) -> np.ndarray:
        """p of a tick."""
        return np.concatenate([source.constants(tick) for source in self.sources])

    def _own(self, memory: ca.SX, p: ca.SX) -> list[tuple[ca.SX, ca.SX]]:
        """Memory and p of each source."""
        found, m, k = [], 0, 0
        for source in self.sources:
            found.append((memory[m : m + source.memory_size], p[k : k + source.constants_size]))
            m, k = m + source.memory_size, k + source.constants_size
        return found


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
    if not (math.isfinite(distance) and distance > 0.0):
        raise BadInputError(f"the panels are {distance} ft apart; the distance must be a positive number")

    def correlation(r: float) -> float:
        return (1 - r / (2 * turbulence.scale)) * math.exp(-r / turbulence.scale)

    shared = correlation(distance)
    own = math.sqrt(max((1 + correlation(2 * distance)) / 2 - shared**2, 0.0))
    other = replace(turbulence, seed=int(np.random.SeedSequence((turbulence.seed, 1)).generate_state(1, np.uint64)[0]))
    return SpanwiseGust((turbulence, other), (1.0, 0.0), (shared, own))
