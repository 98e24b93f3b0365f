"""Effect of rounding on the value of a state."""

from __future__ import annotations

import math
import warnings

import numpy as np

from controller.riccati.existence import ROUNDING
from controller.riccati.normal_form import NormalForm


def value_error(form: NormalForm, P: np.ndarray, vector: np.ndarray) -> float:
    """Return the effect of rounding on v'P v for the stabilizing P, to first order.

    The result is inf where rounding hides whether L is stable.

    form: normal form of the game, not turned
    P: (n, n), in the user's coordinates
    vector: v, (n,), in the user's coordinates

    A change R of the Riccati equation at P changes P by D with L'D + D L = -R, L = A - S P. v'D v
    is the sum of Z R entry by entry where L Z + Z L' = -v v'. The weights are therefore 2 P Z for
    A, 2 P Z P B for B, 2 P Z P E / δ² for E, and Z for Q, entry by entry. Source: Kenney and Hewer,
    The sensitivity of the algebraic and differential Riccati equations, SIAM J. Control and
    Optimization 28 (1990).
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
    except RuntimeWarning:  # two eigenvalues whose sum is 0 to rounding
        return math.inf
    sizes = form.sizes
    moved = X @ Z
    by_A = np.sum(np.abs(moved) * sizes.A)
    by_B = np.sum(np.abs(moved @ X @ form.B) * sizes.B)
    by_E = np.sum(np.abs(moved @ X @ form.E) * sizes.E) / form.delta
    by_Q = np.sum(np.abs(Z) * sizes.Q)
    own = np.abs(direction) @ np.abs(X) @ np.abs(direction)
    return float(2 * n * ROUNDING * (2.0 * (by_A + by_B + by_E) + by_Q + own))
