"""Linear models that vary: between the points of a sweep, and along a flight."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import TYPE_CHECKING, Any, NamedTuple

import casadi as ca
import numpy as np

from hfa_support.errors import BadInputError
from trim.sweeps.sweep import Sweep

if TYPE_CHECKING:
    from hfa_aircraft.model import Model


class Interpolated(NamedTuple):
    """At N points: X0 (N, n), U0 (N, m), A (N, k, k), B (N, k, m) of the sweep's k states; without
    N at one point."""

    states: np.ndarray
    inputs: np.ndarray
    A: np.ndarray
    B: np.ndarray


@dataclass(frozen=True, eq=False)
class InterpolatedModel:
    """Trim, A and B over the grid of a sweep, linear in each of its variables (bilinear in two).

    BadInputError when a variable has fewer than two values, or a point of the sweep has no trim.
    """

    sweep: Sweep

    def __post_init__(self) -> None:
        """Name what cannot be interpolated."""
        plan = self.sweep.plan
        for name, count in zip(plan.variables, plan.sizes, strict=not plan.listed):
            if plan.listed or count < 2:
                raise BadInputError(
                    f"{name} has one value in the sweep; models are interpolated over two or more"
                )
        for values, reason in zip(self.sweep.values, self.sweep.reasons, strict=True):
            if reason:
                raise BadInputError(
                    f"no trim at {self._place(values)}, so there is nothing to interpolate: {reason}"
                )

    @cached_property
    def axes(self) -> tuple[np.ndarray, ...]:
        """The values of each variable, ascending."""
        return tuple(np.unique(column) for column in self.sweep.values.T)

    def at(self, **values: float | np.ndarray) -> Interpolated:
        """At values of all variables, numbers or arrays (N,); BadInputError outside of the grid."""
        if {*values} != {*self.sweep.variables}:
            raise BadInputError(f"give {', '.join(self.sweep.variables)}, by name")
        asked = np.stack(
            np.broadcast_arrays(*(values[name] for name in self.sweep.variables)), axis=-1
        )
        for name, axis, column in zip(
            self.sweep.variables, self.axes, np.moveaxis(asked, -1, 0), strict=True
        ):
            if not np.all((axis[0] <= column) & (column <= axis[-1])):
                ends = (self.sweep.model.describe(name, end) for end in axis[[0, -1]])
                raise BadInputError(
                    f"{name} lies outside of the sweep, which goes from {' to '.join(ends)}"
                )
        shapes = [table.shape[len(self.axes) :] for table in self._tables]
        parts = np.split(
            self._interpolator(asked),
            np.cumsum([math.prod(shape) for shape in shapes])[:-1],
            axis=-1,
        )
        return Interpolated(
            *(p.reshape(*asked.shape[:-1], *shape) for p, shape in zip(parts, shapes, strict=True))
        )

    @cached_property
    def _interpolator(self) -> Any:
        """Of all quantities at once, (..., variables) -> (..., entries)."""
        from scipy.interpolate import RegularGridInterpolator

        flat = [table.reshape(*map(len, self.axes), -1) for table in self._tables]
        return RegularGridInterpolator(self.axes, np.concatenate(flat, axis=-1))

    def to_casadi(self) -> ca.Function:
        """(values of the variables,) -> X0, U0, A, B, as `at`, but held at the ends of the grid.

        `.generate("models.c")` of it writes C that needs no library.
        """
        asked, weights = ca.SX.sym("at", len(self.axes)), ca.SX(1)
        for x, axis in zip(ca.vertsplit(asked), self.axes, strict=True):
            x = ca.fmin(ca.fmax(x, axis[0]), axis[-1])
            up = [(x - low) / (high - low) for low, high in pairwise(axis)]
            hats = [
                ca.fmax(0, ca.fmin(*each))
                for each in zip([1, *up], [*(1 - each for each in up), 1], strict=True)
            ]
            weights = ca.kron(weights, ca.vertcat(*hats))
        parts = []
        for table in self._tables:
            flat = ca.mtimes(table.reshape(weights.numel(), -1).T, weights)
            shape = table.shape[len(self.axes) :]
            parts.append(flat if len(shape) == 1 else ca.reshape(flat, *shape[::-1]).T)
        return ca.Function("models", [asked], parts, ["at"], list(Interpolated._fields))

    @cached_property
    def _tables(self) -> list[np.ndarray]:
        """Each quantity over the grid, the axes of the variables first."""
        order, sizes = np.lexsort(self.sweep.values.T[::-1]), tuple(map(len, self.axes))
        found = (getattr(self.sweep, name)[order] for name in Interpolated._fields)
        return [table.reshape(*sizes, *table.shape[1:]) for table in found]

    def _place(self, values: np.ndarray | list[float]) -> str:
        names = zip(self.sweep.variables, values, strict=True)
        return ", ".join(
            f"{name} {self.sweep.model.describe(name, value)}" for name, value in names
        )


class Along(NamedTuple):
    """Along N states of a flight: the rates f (N, n), A = ∂f/∂x (N, n, n) and B = ∂f/∂u (N, n,
    m)."""

    rates: np.ndarray
    A: np.ndarray
    B: np.ndarray


def models_along(aircraft: Model, states: np.ndarray, inputs: np.ndarray) -> Along:
    """Exact linear models at states (N, n) and inputs (N, m) that need not balance: of small
    deviations δx from a flight, δx' = A(t) δx + B(t) δu. BadInputError when a shape is wrong or a
    derivative is not finite."""
    model = aircraft
    n, m = len(model.states), len(model.inputs)
    x, u = (
        np.atleast_2d(np.asarray(states, dtype=float)),
        np.atleast_2d(np.asarray(inputs, dtype=float)),
    )
    if x.shape[1:] != (n,) or u.shape != (len(x), m):
        raise BadInputError(f"states {x.shape} and inputs {u.shape} must be (N, {n}) and (N, {m})")
    function = model.functions(()).map(len(x))
    found = function(x.T, u.T, np.tile(model.p[:, None], (1, len(x))))
    rates, A, B = (np.array(found[i]).reshape(n, len(x), -1).transpose(1, 0, 2) for i in (0, 2, 3))
    whole = np.concatenate([rates, A, B], axis=2)
    if not np.isfinite(whole).all():
        first = int(np.argmin(np.isfinite(whole).all(axis=(1, 2))))
        at = dict(zip((*model.states, *model.inputs), (*x[first], *u[first]), strict=True))
        raise BadInputError(
            f"state {first} of the flight: {model.not_finite(rates[first, :, 0], at, list(model.states))}"
        )
    return Along(rates[:, :, 0], A, B)
