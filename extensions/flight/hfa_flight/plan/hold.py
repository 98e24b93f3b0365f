"""Linear model and cost over a hold, during which the inputs are constant.

Source: C. Van Loan, IEEE Transactions on Automatic Control 23 (1978) 395.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from hfa_support.errors import NoSolutionError

#: Norm above which the exponential of a longer hold is computed by doubling a shorter hold.
_SHORT = 0.5


class Hold(NamedTuple):
    """Linear model and cost over one hold.

      z⁺ = A z + B v,    ∫ z'Qz + v'Rv dt = [z; v]' W [z; v]

    A: (n, n)
    B: (n, m)
    W: (n + m, n + m)
    """

    A: np.ndarray
    B: np.ndarray
    W: np.ndarray

    def back(self, P: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the optimal gain K of the hold, v = -K z, and P before the hold.

        P: matrix of the least cost z'Pz after the hold, (n, n)
        """
        n = len(self.A)
        price = self.W[n:, n:] + self.B.T @ P @ self.B
        K = np.linalg.solve(price, self.B.T @ P @ self.A + self.W[n:, :n])
        before = self.W[:n, :n] + self.A.T @ P @ self.A - K.T @ price @ K
        return K, 0.5 * (before + before.T)

    def infinite_horizon(self) -> tuple[np.ndarray, np.ndarray]:
        """Return the gain K and the matrix P of the optimum over infinitely many equal holds.

        P is the solution of the discrete Riccati equation, which a hold does not change.

        Raises NoSolutionError if the held model cannot be stabilized.
        """
        from scipy.linalg import LinAlgError, solve_discrete_are

        n = len(self.A)
        Q, N, R = self.W[:n, :n], self.W[:n, n:], self.W[n:, n:]
        try:
            P = solve_discrete_are(self.A, self.B, Q, R, s=N)
        except (LinAlgError, ValueError) as error:
            raise NoSolutionError(f"no linear optimum with held inputs: {error}") from error
        return self.back(P)


def hold_of(A: np.ndarray, B: np.ndarray, Q: np.ndarray, R: np.ndarray, seconds: float) -> Hold:
    """Return z' = A z + B v and ∫ z'Qz + v'Rv dt over a hold.

    seconds: duration of the hold, s
    """
    from scipy.linalg import block_diag, expm

    n, m = B.shape
    rates = np.zeros((n + m, n + m))
    rates[:n] = np.hstack([A, B])
    size = float(np.abs(rates).sum(axis=1).max()) * seconds
    _, exponent = math.frexp(size / _SHORT)  # size / _SHORT < 2^exponent, 0 for 0
    doublings = max(0, exponent)
    of_both = np.block([[-rates.T, block_diag(Q, R)], [np.zeros_like(rates), rates]])
    exponential = expm(of_both * seconds / 2**doublings)
    transition = exponential[n + m :, n + m :]  # of (z; v)
    W = transition.T @ exponential[: n + m, n + m :]
    for _ in range(doublings):
        W = W + transition.T @ W @ transition
        transition = transition @ transition
    return Hold(transition[:n, :n], transition[:n, n:], 0.5 * (W + W.T))
