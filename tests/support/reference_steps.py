"""Reference solution of a discrete-time game by value iteration in `decimal` arithmetic."""

from __future__ import annotations

from decimal import Decimal, localcontext

import numpy as np
from reference_riccati import DIGITS, GUARD, decimal, inverse_of, largest

from controller import DiscreteGame


def reference_step_value(problem: DiscreteGame) -> np.ndarray:
    """Return P of a discrete-time game, (n, n), by value iteration in `decimal`, rounded to double.

    The game must have a value, every state must have a cost, and N must be 0. Each pass doubles the
    horizon:

      A <- A M A,  G <- G + A M G A',  H <- H + A'H M A,   M = (I + G H)⁻¹

    The initial values are A, G = B R⁻¹B' - E E'/δ² and H = Q. Source: Chu, Fan, Lin and Wang, Int.
    J. Control 77, 2004.
    """
    step = problem.step
    with localcontext() as context:
        context.prec = DIGITS + GUARD
        root = Decimal(problem.discount).sqrt()
        A, B, E, H, R = (decimal(matrix) for matrix in (step.A, step.B, step.E, step.Q, step.R))
        A = root * (A + decimal(problem.A_low))
        G = B @ inverse_of(R) @ B.T
        if np.isfinite(step.delta):
            G = G - E @ E.T / Decimal(step.delta) ** 2
        G = root**2 * G
        identity = decimal(np.eye(len(A)))
        increase = H
        while largest(increase) > Decimal(10) ** -DIGITS * largest(H):
            M = inverse_of(identity + G @ H)
            increase = A.T @ H @ M @ A
            G = G + A @ M @ G @ A.T
            H = H + increase
            A = A @ M @ A
        return ((H + H.T) / 2).astype(float)
