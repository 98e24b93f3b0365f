"""Numbers that change with one variable: linear between given places, constant beyond both ends."""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np

from hfa_support.errors import BadInputError
from hfa_support.reporting.fields import ByValue


@dataclass(frozen=True, eq=False)
class LinearTable(ByValue):
    """places: (N,), increasing. values: (N, ...), an array of any shape at each place.
    BadInputError where the places do not increase, or there are not as many values."""

    places: np.ndarray
    values: np.ndarray

    def __post_init__(self) -> None:
        """Keep both as arrays of numbers."""
        places, values = np.asarray(self.places, dtype=float), np.asarray(self.values, dtype=float)
        if (
            places.ndim != 1
            or not places.size
            or len(values) != len(places)
            or not (np.diff(places) > 0).all()
        ):
            raise BadInputError(
                "the places of a table must increase, with one value for each; sort them"
            )
        object.__setattr__(self, "places", places)
        object.__setattr__(self, "values", values)

    def at(self, where: float | np.ndarray) -> np.ndarray:
        """v_i + (v_i+1 - v_i) (x - x_i)/(x_i+1 - x_i): the values at x, their shape behind that of
        `where`."""
        x = np.clip(where, self.places[0], self.places[-1])
        if len(self.places) == 1:
            return np.broadcast_to(self.values[0], (*np.shape(x), *self.values.shape[1:])).copy()
        i = np.clip(np.searchsorted(self.places, x, side="right") - 1, 0, len(self.places) - 2)
        share = (x - self.places[i]) / (self.places[i + 1] - self.places[i])
        share = share.reshape(np.shape(share) + (1,) * (self.values.ndim - 1))
        return np.asarray(self.values[i] + share * (self.values[i + 1] - self.values[i]))

    def expression(self, where: ca.SX) -> ca.SX:
        """The same of a CasADi expression: v_0 + Σ_i (v_i+1 - v_i) sat((x - x_i)/(x_i+1 - x_i), 0,
        1), a column (k,), the values of each place row by row."""
        rows = self.values.reshape(len(self.places), -1)
        value = ca.SX(ca.DM(rows[0]))
        for low, high, difference in zip(
            self.places[:-1], self.places[1:], np.diff(rows, axis=0), strict=True
        ):
            share = ca.fmin(ca.fmax((where - float(low)) / float(high - low), 0.0), 1.0)
            value = value + ca.sparsify(ca.DM(difference)) * share
        return value
