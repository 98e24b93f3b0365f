"""Trim equations and linear models as functions of balls, series and Taylor models."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from hfa_aircraft.model import Model
from verification.enclosure.ball_function import BallFunction

Rows = list[list[Any]]


class LinearParts(NamedTuple):
    """Trim values, Jacobian of the trim equations and linear model, each as a list of rows.

    The linear model is x' = A x + B u, y = C x + D u.

    values: (names, 1), values of the signals `SteadyFlight.names`
    slopes: (equations, unknowns), Jacobian F_w
    A: (n, n)
    B: (n, m)
    C: (k, n), rows of the measured outputs
    D: (k, m)
    """

    values: Rows
    slopes: Rows
    A: Rows
    B: Rows
    C: Rows
    D: Rows


@dataclass(frozen=True, eq=False)
class SteadyFlight:
    """Trim equations F(w; imposed, parameters) = 0 with unknowns w, and the linear model at a trim.

    balanced: BallFunction (v, p) -> the rates that must be 0, then the imposed outputs
    linear_parts: BallFunction (v, p) -> the parts of `LinearParts`
    variables: names of v, the variables of the trim: imposed, scheduling and unknown
    parameters: names of p
    imposed_outputs: names of the outputs that the trim imposes
    names: states, inputs and outputs with values in `LinearParts.values`
    unknowns: names of w
    moving_rows: indices of the equations that depend on an unknown
    heights: number of rows of each part of `LinearParts`
    """

    balanced: BallFunction
    linear_parts: BallFunction
    variables: tuple[str, ...]
    parameters: tuple[str, ...]
    imposed_outputs: tuple[str, ...]
    names: tuple[str, ...]
    unknowns: tuple[str, ...]
    moving_rows: tuple[int, ...]
    heights: tuple[int, ...]

    def residual(self, values: Mapping[str, Any]) -> list[Any]:
        """Return the residuals of the trim equations F.

        values: name -> ball, series or Taylor model, for every variable, parameter and imposed
            output
        """
        results = self.balanced(*self._arguments(values))[0]
        rates = len(results) - len(self.imposed_outputs)
        outputs = zip(results[rates:], self.imposed_outputs, strict=True)
        return results[:rates] + [output - values[name] for output, name in outputs]

    def linear(self, values: Mapping[str, Any]) -> LinearParts:
        """Return the trim values, the Jacobian of the trim equations and the linear model.

        values: name -> ball, series or Taylor model, for every variable and parameter
        """
        columns = self.linear_parts(*self._arguments(values))
        parts = []
        for entries, height in zip(columns, self.heights, strict=True):
            parts.append([entries[row::height] for row in range(height)])
        return LinearParts(*parts)

    def _arguments(self, values: Mapping[str, Any]) -> list[list[Any]]:
        """Return two lists: the values of the variables and the values of the parameters.

        values: name -> ball, series or Taylor model
        """
        return [[values[name] for name in names] for names in (self.variables, self.parameters)]


def steady_flight(
    model: Model,
    imposed: Mapping[str, float],
    limited: Sequence[str] = (),
    measured: Sequence[str] = (),
) -> SteadyFlight:
    """Return the trim equations and the linear model of an aircraft.

    imposed: variables and outputs that the trim imposes, besides the scheduling variable
    limited: names of signals with limits
    measured: names of the outputs of the linear model

    Raises BadInputError with the name of the operation if the equations contain an unsupported
    operation.
    """
    imposed_outputs = tuple(name for name in imposed if name not in model.variables)
    limited_outputs = [name for name in limited if name in model.outputs]
    unknowns = tuple(
        name for name in model.variables if name not in imposed and name != model.schedule
    )
    outputs = tuple(dict.fromkeys((*imposed_outputs, *limited_outputs)))
    return _steady_flight(model, unknowns, imposed_outputs, outputs, tuple(measured))


@lru_cache(maxsize=16)
def _steady_flight(
    model: Model,
    unknowns: tuple[str, ...],
    imposed_outputs: tuple[str, ...],
    outputs: tuple[str, ...],
    measured: tuple[str, ...],
) -> SteadyFlight:
    """Return the trim equations and the linear model of an aircraft, from hashable arguments.

    unknowns: names of the unknowns of the trim
    imposed_outputs: names of the outputs that the trim imposes
    outputs: names of the imposed outputs, then of other outputs with required values
    measured: names of the outputs of the linear model
    """
    states = list(model.states)
    variables = model.variables
    v = ca.SX.sym("v", len(variables))
    (p,) = model.layout.symbols("p")
    values = dict(zip(variables, ca.vertsplit(v), strict=True))
    x, u, f, y = model.layout.in_variables(values, p, outputs)
    y = ca.vec(y)
    _, _, A, B, C, D, *_ = model.functions(measured)(x, u, p)
    balanced = [states.index(name) for name in model.steady]
    linear = [states.index(name) for name in model.linear]

    F = ca.densify(ca.vertcat(f[balanced], y[: len(imposed_outputs), :]))
    w = ca.vertcat(*(values[name] for name in unknowns))
    rate_slopes = ca.mtimes(A[balanced, :], ca.jacobian(x, w))
    rate_slopes += ca.mtimes(B[balanced, :], ca.jacobian(u, w))
    output_slopes = ca.jacobian(y[: len(imposed_outputs), :], w)
    parts = [
        ca.vertcat(x, u, y),
        ca.vertcat(rate_slopes, output_slopes),
        A[linear, linear],
        B[linear, :],
        C[:, linear],
        D,
    ]
    moves = np.array(ca.DM(ca.jacobian_sparsity(F, w), 1)).any(axis=1)
    linear_parts = ca.Function("linear", [v, p], [ca.densify(part) for part in parts])
    return SteadyFlight(
        balanced=BallFunction(ca.Function("balanced", [v, p], [F]), model.name),
        linear_parts=BallFunction(linear_parts, model.name),
        variables=tuple(variables),
        parameters=tuple(model.parameters),
        imposed_outputs=imposed_outputs,
        names=(*states, *model.inputs, *outputs),
        unknowns=unknowns,
        moving_rows=tuple(np.flatnonzero(moves).tolist()),
        heights=tuple(part.shape[0] for part in parts),
    )
