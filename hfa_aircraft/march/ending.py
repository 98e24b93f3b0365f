"""Ends of flights: convergence, departure from the limits, divergence."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from hfa_aircraft.march.march import History

#: Nominal values by which a state deviates from the trim when a flight diverges.
FAR = 1e4


class Outcome(StrEnum):
    """Outcome of a flight."""

    CONVERGED = "converges"
    LEFT = "leaves the envelope"
    LOST = "does not converge"
    UNDECIDED = "is not decided within the time"


#: Function from states (N, n) to a mask (N,).
Mask = Callable[[np.ndarray], np.ndarray]


@dataclass(frozen=True, eq=False)
class EndRule:
    """When a flight is over, from its present state alone.

    A flight is over in the first of these cases that applies:

    - It has converged.
    - It is lost: a state is not a number, or deviates by more than `far`.
    - It has left the limits.

    far: deviation of each state beyond which a flight diverges, (n,) or a number
    inside: mask of the states within the limits, or None without limits
    converged: mask of the states from which a flight counts as converged, or None
    """

    far: np.ndarray | float
    inside: Mask | None = None
    converged: Mask | None = None

    def outcomes(self, states: np.ndarray) -> np.ndarray:
        """Return the `Outcome` of each flight, (N,), from its states (N, n)."""
        outcomes = np.full(len(states), Outcome.UNDECIDED, dtype=object)
        if self.inside is not None:
            outcomes[~self.inside(states)] = Outcome.LEFT
        outcomes[~self._is_near(states)] = Outcome.LOST
        if self.converged is not None:
            outcomes[self.converged(states)] = Outcome.CONVERGED
        return outcomes

    def over(self, flown: History) -> np.ndarray:
        """Return a mask (N, T), True where a flight is over, for `march`."""
        states = flown.states
        over = self.is_over(states.reshape(-1, states.shape[-1]))
        return over.reshape(states.shape[:-1])

    def is_over(self, states: np.ndarray) -> np.ndarray:
        """Return a mask (N,) of the flights that are over at their states (N, n)."""
        over = ~self._is_near(states)
        if self.inside is not None:
            over |= ~self.inside(states)
        if self.converged is not None:
            over |= self.converged(states)
        return over

    def _is_near(self, states: np.ndarray) -> np.ndarray:
        return np.asarray((np.abs(states) <= self.far).all(axis=-1))
