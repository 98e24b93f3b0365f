"""A model's steady flights and linear models as Functions of what a trim imposes and finds, for
balls and series."""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache
from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from hfa_aircraft.model import Model
from verification.proof.arithmetic.ball_function import BallFunction


class SteadyFlight(NamedTuple):
    """Functions of (v, p): v the variables of a trim, p the parameters, in the order of
    `arguments`.

    residual: F, the rates that a trim balances, then the `outputs` that it imposes. full: values of
    all states, inputs, and imposed or limited outputs, which `names` names; F_w, w the variables
    that are `free`; A, B of the linear model. rows: the equations that the free variables move.
    heights: rows of the parts of `full`."""

    residual: BallFunction
    full: BallFunction
    arguments: tuple[tuple[str, ...], tuple[str, ...]]
    outputs: tuple[str, ...]
    names: tuple[str, ...]
    free: tuple[str, ...]
    rows: tuple[int, ...]
    heights: tuple[int, ...]

    def left(self, values: Mapping[str, Any]) -> list[Any]:
        """F less what is imposed, where every variable and parameter has a value: a ball, a series,
        a Taylor model."""
        found = self.residual(*([values[name] for name in names] for names in self.arguments))[0]
        rates = len(found) - len(self.outputs)
        return found[:rates] + [
            y - values[name] for y, name in zip(found[rates:], self.outputs, strict=True)
        ]

    def linear(self, values: Mapping[str, Any]) -> list[list[list[Any]]]:
        """The values by `names`, F_w, A and B, row by row."""
        found = self.full(*([values[name] for name in names] for names in self.arguments))
        return [[part[i::h] for i in range(h)] for part, h in zip(found, self.heights, strict=True)]


def steady_flight(model: Model, imposed: Mapping[str, float]) -> SteadyFlight:
    """Of a model, whatever its parameters, with the values imposed on a trim.

    BadInputError names an operation that balls do not take, such as that of a table.
    """
    outputs = [name for name in imposed if name not in model.variables]
    limited = [
        name
        for name in model.outputs
        if np.isfinite(model.limits[name]).any() and name not in model.variables
    ]
    free = tuple(name for name in model.variables if name not in imposed and name != model.schedule)
    return _steady_flight(model, free, tuple(outputs), tuple(dict.fromkeys((*outputs, *limited))))


@lru_cache(maxsize=16)
def _steady_flight(
    model: Model, free: tuple[str, ...], imposed: tuple[str, ...], outputs: tuple[str, ...]
) -> SteadyFlight:
    states, names = list(model.states), model.variables
    v, (p,) = ca.SX.sym("v", len(names)), model.layout.symbols("p")
    x, u, f, y = model.layout.in_variables(
        dict(zip(names, ca.vertsplit(v), strict=True)), p, outputs
    )
    y = ca.vec(y)
    _, _, A, B, *_ = model.functions(())(x, u, p)
    balanced, rows = (
        [states.index(name) for name in chosen] for chosen in (model.steady, model.linear)
    )
    given = y[: len(imposed), :]
    F = ca.densify(ca.vertcat(f[balanced], given))
    w = ca.vertcat(*(v[names.index(name)] for name in free))
    slopes = ca.mtimes(A[balanced, :], ca.jacobian(x, w)) + ca.mtimes(
        B[balanced, :], ca.jacobian(u, w)
    )
    parts = [
        ca.vertcat(x, u, y),
        ca.vertcat(slopes, ca.jacobian(given, w)),
        A[rows, rows],
        B[rows, :],
    ]
    moved = np.array(ca.DM(ca.jacobian_sparsity(F, w), 1)).any(axis=1)
    return SteadyFlight(
        BallFunction(ca.Function("residual", [v, p], [F]), model.name),
        BallFunction(ca.Function("full", [v, p], list(map(ca.densify, parts))), model.name),
        (tuple(names), tuple(model.parameters)),
        imposed,
        (*states, *model.inputs, *outputs),
        free,
        tuple(np.flatnonzero(moved).tolist()),
        tuple(part.shape[0] for part in parts),
    )
