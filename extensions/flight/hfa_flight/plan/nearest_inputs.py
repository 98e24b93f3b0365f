"""Nearest inputs of one sample with which the next states stay within their limits."""

from __future__ import annotations

from typing import Any

import numpy as np

from hfa_flight.plan.held_model import HeldModel
from hfa_flight.plan.scaled import ScaledProblem

#: Fraction of the distance from trim to limit within which the next state must stay.
WITHIN = 0.96
#: Largest number of Newton steps.
_STEPS = 4


class NearestInputs:
    """Inputs nearest to those of one sample, with which some states are within their limits next.

    The states are those that the inputs can move by a tenth of the range in one sample, such as a
    pitch rate. The change is least in fractions of the inputs' ranges.

    scaled: the problem in nominal units
    dt: sample time, s
    within: fraction of the distances from trim to limits that the next states keep
    """

    def __init__(self, scaled: ScaledProblem, dt: float, within: float = WITHIN) -> None:
        self.model = HeldModel(scaled, np.array([dt]))
        k = scaled.sizes[0]
        lowest, highest = scaled.input_limits
        below, above = (limit[:k] for limit in scaled.state_limits)
        ranges = 0.5 * (highest - lowest)
        self._kept = np.flatnonzero(scaled.reached(dt))
        self._within = within
        self._limits = within * below[self._kept], within * above[self._kept]
        #: Squares of the inputs' ranges, which weigh their changes.
        self._squares = np.where(np.isfinite(ranges), ranges, 1.0) ** 2

    def __reduce__(self) -> tuple[type[NearestInputs], tuple[Any, ...]]:
        """Return the constructor and its arguments, for copies and pickle."""
        return NearestInputs, (self.model.scaled, float(self.model.holds[0]), self._within)

    @property
    def states(self) -> tuple[str, ...]:
        """Names of the states whose limits are kept."""
        return tuple(self.model.scaled.problem.states[place] for place in self._kept)

    def __call__(self, z: np.ndarray, v: np.ndarray) -> np.ndarray:
        """Return the inputs of a sample: v itself if the next states stay within the limits.

        z: states, (n,)
        v: inputs, (m,)
        """
        lowest, highest = self.model.scaled.input_limits
        n = len(z)
        for _ in range(_STEPS):
            after, slopes = self.model.moved_along(z[None], v[None])
            kept = after[0, self._kept]
            excess = kept - np.clip(kept, *self._limits)
            if not np.any(excess):
                return v
            v = np.clip(v, lowest, highest)
            # Of each state in turn, the least change of the inputs that removes its excess.
            for by_inputs, beyond in zip(slopes[0, self._kept, n:], excess, strict=True):
                can_move = np.where(beyond * by_inputs > 0.0, v > lowest, v < highest)
                direction = self._squares * by_inputs * can_move
                if direction @ by_inputs > 0.0:
                    v = v - direction * beyond / (direction @ by_inputs)
                    v = np.clip(v, lowest, highest)
        return v
