"""Which of many trims are beyond the largest lift."""

from __future__ import annotations

import casadi as ca
import numpy as np

from hfa_aircraft.layout import components
from hfa_aircraft.model import Model, recognized
from hfa_support.native.bound import RowFunction

#: Outputs with which the lift is compared with a declared largest lift coefficient.
_LARGEST = ("dynamic_pressure", "reference_area", "largest_lift_coefficient")


def stalled(
    model: Model, states: np.ndarray, inputs: np.ndarray, parameters: np.ndarray
) -> np.ndarray:
    """Return which of N trims are stalled, (N,): the lift L is above q S CL_max, or without a
    declared CL_max, ∂L/∂α < 0.

    A model without the state alpha or the output lift is never stalled.

    states: (N, n); nan without a trim, which is not stalled
    inputs: (N, m)
    parameters: (N, number of parameters)
    """
    alpha = recognized(model.states).get("alpha", "")
    if not alpha or "lift" not in model.outputs:
        return np.zeros(len(states), dtype=bool)
    is_declared = {*_LARGEST} <= {*model.outputs}
    symbols = model.layout.symbols("x", "u", "p")
    names = ("lift", *(_LARGEST if is_declared else ()))
    _, outputs = model.layout.expressions([components(vector) for vector in symbols], names)
    lift = outputs[0]
    if is_declared:
        reserve = outputs[1] * outputs[2] * outputs[3] - lift
    else:
        reserve = ca.jacobian(lift, symbols[0][model.state_places([alpha])[0]])
    reserve_rows = RowFunction(ca.Function("reserve", symbols, [ca.densify(reserve)]))
    (reserves,) = reserve_rows(states, inputs, parameters)
    return np.asarray(reserves[:, 0] < 0.0)
