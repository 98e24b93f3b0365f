"""Effect of rounding on the value v'P v of a state v."""

from __future__ import annotations

import math
import warnings

import numpy as np

from controller.riccati.existence import ROUNDING
from controller.riccati.normal_form import NormalForm


def value_error(form: NormalForm, P: np.ndarray, vector: np.ndarray) -> float:
    """Return a bound on the effect of rounding on v'P v, to first order, for the stabilizing P.

    Returns inf if rounding hides whether L = A - S P is stable.

    With L Z + Z L' = -v v', the weights of relative changes are, entry by entry, 2 P Z for A, 2 P Z
    P B for B, 2 P Z P E / δ² for E, and Z for Q. Source: Kenney and Hewer, The sensitivity of the
    algebraic and differential Riccati equations, SIAM J. Control and Optimization 28 (1990).

    form: normal form of the game, without rotation of the coordinates
    P: (n, n), in the user's coordinates
    vector: v, (n,), in the user's coordinates
    """
    from scipy.linalg import solve_continuous_lyapunov

    n = len(form.A)
    X = form.of_value(P)
    direction = vector / form.units
    loop = form.A - form.S @ X
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error", RuntimeWarning)
            Z = solve_continuous_lyapunov(loop, -np.outer(direction, direction))
    except RuntimeWarning:  # the sum of two eigenvalues is 0 within rounding
        return math.inf
    sizes = form.sizes
    moved = X @ Z
    by_A = np.sum(np.abs(moved) * sizes.A)
    by_B = np.sum(np.abs(moved @ X @ form.B) * sizes.B)
    by_E = np.sum(np.abs(moved @ X @ form.E) * sizes.E) / form.delta
    by_Q = np.sum(np.abs(Z) * sizes.Q)
    own = np.abs(direction) @ np.abs(X) @ np.abs(direction)
    return float(2 * n * ROUNDING * (2.0 * (by_A + by_B + by_E) + by_Q + own))
