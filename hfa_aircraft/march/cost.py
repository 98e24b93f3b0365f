"""Cost of a simulated flight."""

from __future__ import annotations

import numpy as np


def cost_of_flight(
    times: np.ndarray,
    z: np.ndarray,
    v: np.ndarray,
    Q: np.ndarray,
    R: np.ndarray,
    is_held: bool = False,
) -> float:
    """Return the cost ∫ z'Qz + v'Rv dt of a flight by the trapezoidal rule.

    times: (N,), s
    z: (N, k), deviations of the states from the requested trim
    v: (N, m), deviations of the inputs
    Q: (k, k)
    R: (m, m)
    is_held: True if v is constant between consecutive times. v'Rv is then integrated exactly
    """
    of_states = np.einsum("ij,jk,ik->i", z, Q, z)
    of_inputs = np.einsum("ij,jk,ik->i", v, R, v)
    cost = np.trapezoid(of_states, times)
    if is_held:
        cost += of_inputs[:-1] @ np.diff(times)
    else:
        cost += np.trapezoid(of_inputs, times)
    return float(cost)
