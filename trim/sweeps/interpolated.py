"""Interpolation of linear models between the points of a sweep."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from hfa_support.errors import BadInputError
from trim.sweeps.sweep import Sweep


class Interpolated(NamedTuple):
    """Trims and linear models at N points, with the k states of the linear model.

    At a single point, the arrays lack the axis N.

    states: X0, (N, n).
    inputs: U0, (N, m).
    A: (N, k, k).
    B: (N, k, m).
    """

    states: np.ndarray
    inputs: np.ndarray
    A: np.ndarray
    B: np.ndarray


@dataclass(frozen=True, eq=False)
class InterpolatedModel:
    """Trim, A and B, interpolated linearly in each variable of a sweep.

    sweep: sweep over a grid, with a trim at every point

    Raises BadInputError if the sweep is a list of points, a variable has fewer than two values, or
    a point has no trim.
    """

    sweep: Sweep

    def __post_init__(self) -> None:
        """Raise BadInputError if the sweep cannot be interpolated."""
        plan = self.sweep.plan
        for name, count in zip(plan.variables, plan.sizes, strict=not plan.listed):
            if plan.listed or count < 2:
                raise BadInputError(
                    f"the sweep has fewer than two values of {name}; sweep a grid with at least two"
                )
        for values, reason in zip(self.sweep.values, self.sweep.reasons, strict=True):
            if reason:
                describe = self.sweep.model.describe
                pairs = zip(self.sweep.variables, values, strict=True)
                place = ", ".join(f"{name} {describe(name, value)}" for name, value in pairs)
                raise BadInputError(
                    f"the sweep has no trim at {place} "
                    f"({reason.removeprefix('no trim: ')}); sweep a grid with a trim at every point"
                )

    @cached_property
    def axes(self) -> tuple[np.ndarray, ...]:
        """Values of each variable of the sweep, ascending."""
        return tuple(np.unique(column) for column in self.sweep.values.T)

    def at(self, **values: float | np.ndarray) -> Interpolated:
        """Return trims and linear models at given values of the variables of the sweep.

        values: for each variable of the sweep by name, a number or (N,)

        Raises BadInputError if a variable is missing or unknown, or if a value is outside the grid.
        """
        variables = self.sweep.variables
        if {*values} != {*variables}:
            raise BadInputError(
                f"an argument is missing or unknown; give {', '.join(variables)}, each by name"
            )
        columns = np.broadcast_arrays(*(values[name] for name in variables))
        for name, axis, column in zip(variables, self.axes, columns, strict=True):
            if not np.all((axis[0] <= column) & (column <= axis[-1])):
                describe = self.sweep.model.describe
                raise BadInputError(
                    f"{name} is outside the sweep, {describe(name, axis[0])} to"
                    f" {describe(name, axis[-1])}; choose a value within this range"
                )
        flat = self._interpolator(np.stack(columns, axis=-1))
        shapes = [table.shape[len(self.axes) :] for table in self._tables]
        ends = np.cumsum([math.prod(shape) for shape in shapes])
        parts = np.split(flat, ends[:-1], axis=-1)
        whole = [
            part.reshape(*columns[0].shape, *shape)
            for part, shape in zip(parts, shapes, strict=True)
        ]
        return Interpolated(*whole)

    def to_casadi(self) -> ca.Function:
        """Return the CasADi Function from the variables of the sweep to X0, U0, A and B.

        The argument is the vector of the variables. The results are constant beyond the grid. The
        method `.generate("models.c")` of the Function writes C code that needs no library.
        """
        at = ca.SX.sym("at", len(self.axes))
        weights = ca.SX(1)
        for x, axis in zip(ca.vertsplit(at), self.axes, strict=True):
            weights = ca.kron(weights, _hat_functions(x, axis))
        parts = []
        for table in self._tables:
            flat = ca.mtimes(table.reshape(weights.numel(), -1).T, weights)
            shape = table.shape[len(self.axes) :]
            parts.append(flat if len(shape) == 1 else ca.reshape(flat, *shape[::-1]).T)
        return ca.Function("models", [at], parts, ["at"], list(Interpolated._fields))

    @cached_property
    def _interpolator(self) -> Any:
        """SciPy interpolator of X0, U0, A and B over the variables of the sweep."""
        # It maps points (..., variables) to entries (..., entries). The entries are those of X0,
        # U0, A and B in this order, each row by row.
        from scipy.interpolate import RegularGridInterpolator

        sizes = tuple(len(axis) for axis in self.axes)
        rows = [table.reshape(*sizes, -1) for table in self._tables]
        return RegularGridInterpolator(self.axes, np.concatenate(rows, axis=-1))

    @cached_property
    def _tables(self) -> list[np.ndarray]:
        """Arrays of X0, U0, A and B over the grid of the sweep."""
        # The first axes are the variables of the sweep, ascending. The last axes are those of X0,
        # U0, A or B.
        order = np.lexsort(self.sweep.values.T[::-1])
        sizes = tuple(len(axis) for axis in self.axes)
        tables = []
        for name in Interpolated._fields:
            rows = getattr(self.sweep, name)[order]
            tables.append(rows.reshape(*sizes, *rows.shape[1:]))
        return tables


def _hat_functions(x: ca.SX, axis: np.ndarray) -> ca.SX:
    """Return the weight of each breakpoint for linear interpolation at x, as an expression."""
    # Beyond the first and the last breakpoint, the nearest breakpoint has the weight 1.
    rising = [(x - low) / (high - low) for low, high in pairwise(axis)]
    before = [ca.SX(1), *rising]
    after = [*(1 - share for share in rising), ca.SX(1)]
    hats = [ca.fmax(0, ca.fmin(up, down)) for up, down in zip(before, after, strict=True)]
    return ca.vertcat(*hats)
