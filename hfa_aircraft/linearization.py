"""Values of a model's equations at a point, with exact derivatives."""

from __future__ import annotations

import math
from functools import lru_cache
from typing import NamedTuple

import casadi as ca
import numpy as np

from hfa_aircraft.layout import Layout, components
from hfa_support.errors import refuse_unknown
from hfa_support.native.bound import RowFunction


class Linearization(NamedTuple):
    """Rates f and outputs y of a model at a point, with their derivatives.

    f: rates, (n,)
    y: outputs, (k,)
    A, B, E: derivatives of f with respect to x, u and w, (n, n), (n, m) and (n, d)
    C, D, F: derivatives of y with respect to x, u and w, (k, n), (k, m) and (k, d)
    """

    f: np.ndarray
    y: np.ndarray
    A: np.ndarray
    B: np.ndarray
    C: np.ndarray
    D: np.ndarray
    E: np.ndarray
    F: np.ndarray


@lru_cache(maxsize=64)
def linearized(
    layout: Layout, outputs: tuple[str, ...], disturbances: tuple[str, ...]
) -> ca.Function:
    """Return the CasADi function (x, u, p) -> fields of a `Linearization`, at w = 0.

    outputs: names of outputs or states
    disturbances: names of the disturbances in w

    Raises BadInputError for an unknown disturbance, for an input or a state of linear models that
    affects f only in steps, and for faulty equations.
    """
    x, u, p = layout.symbols("x", "u", "p")
    w = ca.SX.sym("w", len(disturbances))
    for name in disturbances:
        refuse_unknown("unknown disturbance", name, layout.names.disturbances)
    vectors = [components(vector) for vector in (x, u, p)]
    f, y = layout.expressions(vectors, outputs)
    A = ca.jacobian(f, x)
    B = ca.jacobian(f, u)
    columns = [layout.names.states.index(name) for name in layout.linear]
    layout.refuse_steps(A[:, columns], layout.linear)
    layout.refuse_steps(B, layout.names.inputs)
    parts = [f, y, A, B, ca.jacobian(y, x), ca.jacobian(y, u)]
    if disturbances:
        winds = dict(zip(disturbances, ca.vertsplit(w), strict=True))
        every_wind = [winds.get(name, 0.0) for name in layout.names.disturbances]
        for expression in layout.expressions(vectors, outputs, every_wind):
            parts.append(ca.substitute(ca.jacobian(expression, w), w, 0))
    else:
        parts += [ca.SX(f.numel(), 0), ca.SX(y.numel(), 0)]
    names = (
        *("ode", "ydef", "jac_ode_x", "jac_ode_u"),
        *("jac_ydef_x", "jac_ydef_u", "jac_ode_w", "jac_ydef_w"),
    )
    dense = [ca.densify(part) for part in parts]
    return ca.Function("linearized", [x, u, p], dense, ["x", "u", "p"], names)


@lru_cache(maxsize=16)
def linearized_rows(
    layout: Layout, outputs: tuple[str, ...], disturbances: tuple[str, ...]
) -> RowFunction:
    """Return a function that linearizes at many points: rows of (x, u, p) -> rows of numbers.

    Each row contains the fields of a `Linearization`, one after the other. Matrices are stored row
    by row (`places_of_parts`).

    outputs: names of outputs or states
    disturbances: names of the disturbances in w
    """
    function = linearized(layout, outputs, disturbances)
    vectors = layout.symbols("x", "u", "p")
    flat = ca.vertcat(*(ca.vec(part.T) for part in function(*vectors)))
    return RowFunction(ca.Function("flat", vectors, [flat]))


@lru_cache(maxsize=64)
def places_of_parts(n: int, m: int, k: int, d: int) -> list[tuple[slice, tuple[int, ...]]]:
    """Return the place and the shape, (slice, shape), of each field of a `Linearization` in a row.

    The row is that of `linearized_rows`.

    n, m, k, d: numbers of states, inputs, outputs and disturbances
    """
    places: list[tuple[slice, tuple[int, ...]]] = []
    first = 0
    for shape in ((n,), (k,), (n, n), (n, m), (k, n), (k, m), (n, d), (k, d)):
        last = first + math.prod(shape)
        places.append((slice(first, last), shape))
        first = last
    return places
