"""A model's steady flights and linear models as Functions of what a trim imposes and finds, for balls and series."""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache
from typing import NamedTuple

import casadi as ca
import numpy as np

from hfa_support.errors import BadInputError
from hfa_support.model import Model
from verification.arithmetic.ball_function import BallFunction, operations

#: CasADi's operations that are not smooth, as people write them.
_SWITCHES = {
    "IF_ELSE_ZERO": "if_else", "FABS": "fabs", "SIGN": "sign", "FLOOR": "floor", "CEIL": "ceil", "FMAX": "fmax",
    "FMIN": "fmin", "FMOD": "fmod", "REMAINDER": "remainder", "COPYSIGN": "copysign", "LE": "<=", "LT": "<", "EQ": "==",
    "NE": "!=", "NOT": "not", "AND": "and", "OR": "or",
}  # fmt: skip


class SteadyFlight(NamedTuple):
    """Functions of (v, p): v the variables of a trim, p the parameters, in the model's order.

    residual: F, the rates that a trim balances, then the outputs that it imposes: `equations`. full: values of all
    states, inputs, and imposed or limited outputs, which `names` names; F_v; A, B of the linear model. moves: whether a
    row of F depends on a variable.
    """

    residual: BallFunction
    full: BallFunction
    equations: tuple[str, ...]
    names: tuple[str, ...]
    moves: np.ndarray


def steady_flight(model: Model, imposed: Mapping[str, float]) -> SteadyFlight:
    """Of a model, whatever its parameters are, with what is imposed on a trim.

    BadInputError names an operation that is not smooth and that more than imposed constants reach.
    """
    outputs = [name for name in imposed if name not in model.variables]
    limited = [name for name in model.outputs if np.isfinite(model.limits[name]).any() and name not in model.variables]
    known = tuple((name, value) for name, value in imposed.items() if name in model.variables)
    return _steady_flight(model, known, tuple(outputs), tuple(dict.fromkeys((*outputs, *limited))))


@lru_cache(maxsize=16)
def _steady_flight(
    model: Model, known: tuple[tuple[str, float], ...], imposed: tuple[str, ...], outputs: tuple[str, ...]
) -> SteadyFlight:
    states, names = list(model.states), model.variables
    v, (p,) = ca.SX.sym("v", len(names)), model.layout.symbols("p")
    x, u, f, y = model.layout.in_variables(dict(zip(names, ca.vertsplit(v), strict=True)), p, outputs)
    y, constants = ca.vec(y), dict(known)
    fixed = ca.vertcat(*(constants.get(name, v[i]) for i, name in enumerate(names)))
    smooth = ca.Function("smooth", [v, p], [ca.Function("f", [v, p], [ca.vertcat(f, y)])(fixed, p)])
    for operation in (name for name in _SWITCHES if name in operations(smooth)):
        raise BadInputError(
            f"{model.name}: its equations use {_SWITCHES[operation]}; a proof takes smooth equations: put a "
            "polynomial in place of a table or a switch"
        )
    _, _, A, B, *_ = model.functions(())(x, u, p)
    balanced, rows = ([states.index(name) for name in chosen] for chosen in (model.steady, model.linear))
    given = y[: len(imposed), :]
    F = ca.densify(ca.vertcat(f[balanced], given))
    slopes = ca.mtimes(A[balanced, :], ca.jacobian(x, v)) + ca.mtimes(B[balanced, :], ca.jacobian(u, v))
    parts = [ca.vertcat(x, u, y), ca.vertcat(slopes, ca.jacobian(given, v)), A[rows, rows], B[rows, :]]
    return SteadyFlight(
        BallFunction(ca.Function("residual", [v, p], [F]), model.name),
        BallFunction(ca.Function("full", [v, p], list(map(ca.densify, parts))), model.name),
        (*model.steady, *imposed),
        (*states, *model.inputs, *outputs),
        np.array(ca.DM(ca.jacobian_sparsity(F, v), 1)) != 0.0,
    )
