"""The cost of a flight: the one function by which flights are priced."""

from __future__ import annotations

import numpy as np


def cost_of_flight(
    times: np.ndarray, z: np.ndarray, v: np.ndarray, Q: np.ndarray, R: np.ndarray
) -> float:
    """∫ z'Qz + v'Rv dt of the rows of a flight, by the trapezoidal rule.

    times: (N,), s
    z: (N, k), deviations of the states from the trim that was asked for
    v: (N, m), deviations of the inputs
    Q: (k, k)
    R: (m, m)
    """
    rates = np.einsum("ij,jk,ik->i", z, Q, z) + np.einsum("ij,jk,ik->i", v, R, v)
    return float(np.trapezoid(rates, times))
