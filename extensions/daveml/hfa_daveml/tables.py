"""Gridded and ungridded tables of DAVE-ML, evaluated at CasADi expressions.

Outside the points of a table, the value is that of the nearest point on the border.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from hfa_aircraft.rigid.tables import Interpolator

#: A point is in a triangle if its smallest barycentric coordinate is at least minus this value.
_ON_THE_EDGE = 1e-12


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


@dataclass(frozen=True)
class UngriddedTable:
    """A table of scattered points with two arguments, linear on each Delaunay triangle.

    Outside all triangles, the value is that of the nearest point on the border.

    points: (N, 2)
    values: (N,)
    triangles: (M, 3), indices of points
    border: (L, 2), indices of the end points of each edge of the convex hull
    """

    points: np.ndarray
    values: np.ndarray
    triangles: np.ndarray
    border: np.ndarray

    @property
    def ends(self) -> list[tuple[float, float]]:
        """Smallest and largest value of each argument."""
        return [(float(column.min()), float(column.max())) for column in self.points.T]

    def value(self, arguments: Sequence[Any], interpolator: Interpolator) -> Any:
        """Return the interpolated value of the table.

        arguments: two numbers or expressions
        interpolator: not used; accepted as by `GriddedTable.value`
        """
        place = ca.vertcat(*map(ca.SX, arguments))
        value = self._on_the_border(place)
        for triangle in self.triangles:
            corner, *others = self.points[triangle]
            edges = np.column_stack([other - corner for other in others])
            shares = ca.mtimes(ca.DM(np.linalg.inv(edges)), place - ca.DM(corner))
            weights = ca.vertcat(1.0 - ca.sum1(shares), shares)
            inside = ca.mmin(weights) >= -_ON_THE_EDGE
            value = ca.if_else(inside, ca.dot(weights, ca.DM(self.values[triangle])), value)
        return value

    def _on_the_border(self, place: Any) -> Any:
        """Return the value at the point of the border that is nearest to a given point."""
        # place (2,)
        value: Any = 0.0
        least: Any = np.inf
        for first, second in self.border:
            start = ca.DM(self.points[first])
            edge = ca.DM(self.points[second]) - start
            share = ca.fmin(ca.fmax(ca.dot(place - start, edge) / ca.sumsqr(edge), 0.0), 1.0)
            distance = ca.sumsqr(place - start - share * edge)
            rise = self.values[second] - self.values[first]
            value = ca.if_else(distance < least, self.values[first] + share * rise, value)
            least = ca.fmin(distance, least)
        return value


def table_of_points(points: np.ndarray, values: np.ndarray) -> GriddedTable | UngriddedTable:
    """Return the table through given points.

    The table is gridded for one argument and ungridded for two arguments.

    points: (N, 1) or (N, 2)
    values: (N,)

    Raises ValueError if two points are equal, or if points with two arguments form no triangle.
    """
    from scipy.spatial import Delaunay, QhullError

    if len(np.unique(points, axis=0)) < len(points):
        raise ValueError("two points are equal")
    if points.shape[1] == 1:
        order = np.argsort(points[:, 0])
        return GriddedTable((points[order, 0],), values[order])
    try:
        triangulation = Delaunay(points)
    except QhullError as error:
        raise ValueError("all points lie on a line") from error
    return UngriddedTable(points, values, triangulation.simplices, triangulation.convex_hull)
