"""Derivatives of functions that give none: central differences."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import casadi as ca
import numpy as np

#: Step of the central differences, relative to the nominal value of each argument.
STEP = 1e-5


def differenced(function: ca.Function, nominals: Sequence[np.ndarray], step: float) -> ca.Function:
    """Return a function whose derivatives are central differences of its values.

      df/dv_i = (f(v + h_i e_i) - f(v - h_i e_i)) / (2 h_i),  h_i = step nominal_i

    function: function of columns
    nominals: typical magnitudes of the entries of each column
    step: relative step
    """
    sizes = [len(each) for each in nominals]
    ends = np.cumsum([0, *sizes]).tolist()
    v: Any = ca.MX.sym("v", ends[-1])

    def stacked(arguments: ca.MX) -> ca.MX:
        return ca.vertcat(*function.call(ca.vertsplit(arguments, ends)))

    slopes = []
    for i, h in enumerate(step * np.concatenate(nominals)):
        moved = ca.DM.zeros(ends[-1])
        moved[i] = h
        slopes.append((stacked(v + moved) - stacked(v - moved)) / (2.0 * h))
    values = stacked(v)
    names = (["v", "out_f"], ["jac_f_v"])
    jacobian = ca.Function("jac_f", [v, ca.MX(*values.shape)], [ca.horzcat(*slopes)], *names)
    only_this: Any = {
        "custom_jacobian": jacobian,
        "jac_penalty": 0,
        "enable_forward": False,
        "enable_reverse": False,
        "never_inline": True,
    }
    of_stack = ca.Function("f", [v], [values], ["v"], ["f"], only_this)
    columns = [ca.SX.sym(f"v{i}", size) for i, size in enumerate(sizes)]
    rows = np.cumsum([0, *(function.size1_out(i) for i in range(function.n_out()))]).tolist()
    parts = ca.vertsplit(of_stack(ca.vertcat(*columns)), rows)
    return ca.Function(function.name(), columns, parts)


def slopes_at(function: ca.Function, point: Sequence[np.ndarray]) -> np.ndarray:
    """Return the derivatives of all results of a function with respect to all arguments."""
    v = [ca.SX.sym(f"v{i}", len(each)) for i, each in enumerate(point)]
    slopes = ca.jacobian(ca.vertcat(*function.call(v)), ca.vertcat(*v))
    return np.asarray(ca.Function("slopes", v, [ca.densify(slopes)])(*point))


def largest_difference(one: np.ndarray, other: np.ndarray, nominals: np.ndarray) -> float:
    """Return the largest difference of two Jacobians, relative to the largest entry of its row.

    The entries are multiplied by the nominal values of the arguments.

    one, other: (m, n)
    nominals: (n,)
    """
    sizes = np.abs(other * nominals).max(axis=1, keepdims=True)
    apart = np.abs(one - other) * nominals
    return float(np.max(np.divide(apart, sizes, out=np.zeros_like(apart), where=sizes > 0.0)))
