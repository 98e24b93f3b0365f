"""The aircraft from one sample to the next, its inputs held: X⁺ = F(X, U)."""

from __future__ import annotations

import math
from functools import lru_cache

import casadi as ca
import numpy as np

from hfa_aircraft.layout import Layout, components
from hfa_aircraft.model import Model
from trim.point.operating_point import OperatingPoint

#: Longest step of the integration, in parts of the time constant of the fastest mode: an error of
#: 1e-6 of a deviation.
_LONGEST = 0.2
_MOST_PARTS = 1000


def parts_of_a_sample(points: list[OperatingPoint], dt: float) -> int:
    """Into how many steps of the integration a sample is divided: by the fastest mode of the
    aircraft at any of these trims."""
    fastest = 0.0
    for point in points:
        A = point.model.at(point.states, point.inputs).A
        fastest = max(fastest, float(np.abs(np.linalg.eigvals(A)).max()))
    return min(max(1, math.ceil(dt * fastest / _LONGEST)), _MOST_PARTS)


@lru_cache(maxsize=16)
def rate_function(layout: Layout, linear: tuple[str, ...]) -> ca.Function:
    """(X, U, push, p) -> X' = f(X, U, p) + push on the states `linear`, in still air."""
    states, inputs, parameters = layout.names[0], layout.names[1], layout.names[2]
    X = ca.SX.sym("X", len(states))
    U = ca.SX.sym("U", len(inputs))
    push = ca.SX.sym("push", len(linear))
    p = ca.SX.sym("p", len(parameters))
    rates, _ = layout.expressions([components(vector) for vector in (X, U, p)], ())
    pushed = [
        rate + (push[linear.index(name)] if name in linear else 0.0)
        for name, rate in zip(states, ca.vertsplit(rates), strict=True)
    ]
    options = {"cse": True, "never_inline": True}
    return ca.Function("rate", [X, U, push, p], [ca.densify(ca.vertcat(*pushed))], options)


def held_step(model: Model, dt: float, parts: int) -> ca.Function:
    """(X, U, push, p) -> X after dt seconds, by `parts` steps of the classical Runge-Kutta method
    of order 4 (Hairer, Norsett, Wanner, Solving Ordinary Differential Equations I, Table II.1.2).

    X: (n,), absolute, as U (m,), which is held
    push: (k,), adds to the rates of the linear states
    p: the parameters of the model
    """
    rate = rate_function(model.layout, model.linear)
    X, U, push, p = (ca.MX.sym("x", rate.numel_in(index)) for index in range(4))
    h = dt / parts
    k1 = rate(X, U, push, p)
    k2 = rate(X + h / 2 * k1, U, push, p)
    k3 = rate(X + h / 2 * k2, U, push, p)
    k4 = rate(X + h * k3, U, push, p)
    after = X + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
    one = ca.Function("part", [X, U, push, p], [after])
    if parts == 1:
        return one
    whole = one.mapaccum("parts", parts)
    repeated = [ca.repmat(each, 1, parts) for each in (U, push, p)]
    return ca.Function("held_step", [X, U, push, p], [whole(X, *repeated)[:, -1]])
