"""Gridded tables of DAVE-ML, evaluated at CasADi expressions.

Outside the points of a table, the value is that of the nearest point on the border.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from hfa_aircraft.rigid.tables import Interpolator


@dataclass(frozen=True)
class GriddedTable:
    """A table on a grid, linear in each argument between breakpoints.

    breakpoints: an increasing array for each argument
    values: array with one dimension for each argument
    """

    breakpoints: tuple[np.ndarray, ...]
    values: np.ndarray

    @property
    def ends(self) -> list[tuple[float, float]]:
        """First and last breakpoint of each argument."""
        return [(float(points[0]), float(points[-1])) for points in self.breakpoints]

    def value(self, arguments: Sequence[Any], interpolator: Interpolator) -> Any:
        """Return the interpolated value of the table.

        arguments: number or expression for each dimension of the table
        interpolator: interpolator shared by the tables of an aircraft
        """
        return interpolator(self.values, self.breakpoints, arguments)
