"""Tables that are piecewise linear in one variable, and constant beyond both ends."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hfa_support.errors import BadInputError
from hfa_support.reporting.results import ByValue


@dataclass(frozen=True, eq=False)
class LinearTable(ByValue):
    """Array of any shape that is piecewise linear in one variable and constant beyond both ends.

    breakpoints: (N,), strictly increasing
    values: (N, ...), the array at each breakpoint

    Raises BadInputError if the breakpoints do not increase, or if the numbers of breakpoints and
    values differ.
    """

    breakpoints: np.ndarray
    values: np.ndarray

    def __post_init__(self) -> None:
        """Convert both fields to arrays of floats.

        Raises BadInputError, as described for the class.
        """
        breakpoints = np.asarray(self.breakpoints, dtype=float)
        values = np.asarray(self.values, dtype=float)
        increasing = (
            breakpoints.ndim == 1 and breakpoints.size > 0 and (np.diff(breakpoints) > 0).all()
        )
        if not increasing or len(values) != len(breakpoints):
            raise BadInputError(
                "a table is invalid; give increasing breakpoints, and one value for each"
            )
        vars(self).update(breakpoints=breakpoints, values=values)

    def at(self, where: float | np.ndarray) -> np.ndarray:
        """Return the array at x, interpolated linearly and constant beyond both ends.

            v_i + (v_i+1 - v_i) (x - x_i)/(x_i+1 - x_i)

        where: x, a number or an array of any shape

        The shape of the result is the shape of x, followed by the shape of the tabulated array.
        """
        x = np.clip(where, self.breakpoints[0], self.breakpoints[-1])
        if len(self.breakpoints) == 1:
            return np.broadcast_to(self.values[0], (*np.shape(x), *self.values.shape[1:])).copy()
        last = len(self.breakpoints) - 2
        left = np.clip(np.searchsorted(self.breakpoints, x, side="right") - 1, 0, last)
        right = left + 1
        width = self.breakpoints[right] - self.breakpoints[left]
        share = (x - self.breakpoints[left]) / width
        share = share.reshape(np.shape(share) + (1,) * (self.values.ndim - 1))
        change = self.values[right] - self.values[left]
        return np.asarray(self.values[left] + share * change)
