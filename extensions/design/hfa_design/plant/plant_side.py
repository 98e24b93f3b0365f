"""The control side of a generalized plant, converted to a game.

The filter side is the control side of the transposed plant. Completing the squares in u and then
in w converts the Riccati equation of a side to that of a `Game`. [C D] is split into a part that u
can cancel and a remainder. The feedthrough of the remainder changes A, E and C of the game. The
cancellation causes rounding errors proportional to the canceled terms. The magnitudes of these
terms are stored with the game. Source: Zhou, Doyle and Glover, Robust and Optimal Control, Theorem
17.1 and Section 17.2.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from controller.game.zero_sum import Game
from controller.riccati.normal_form import RANK
from hfa_design.plant.feedthrough import without_feedthrough


class Reduced(NamedTuple):
    """Side of a generalized plant without cross terms, for the input v with u = v - N⁺ (C x + D w).

    The cost of v is v'N'N v.

    past: N⁺
    A, E, C, D: matrices of the reduced side
    """

    past: np.ndarray
    A: np.ndarray
    E: np.ndarray
    C: np.ndarray
    D: np.ndarray


class Side(NamedTuple):
    """One side of the problem: x' = A x + E w + B u, z = C x + D w + N u.

    The control side is the plant, and the filter side is the transposed plant.

    A: (n, n)
    E: (n, k)
    B: (n, m)
    C: (r, n)
    D: (r, k)
    N: (r, m)
    """

    A: np.ndarray
    E: np.ndarray
    B: np.ndarray
    C: np.ndarray
    D: np.ndarray
    N: np.ndarray

    def reduced(self) -> Reduced:
        """Return the side without cross terms, in which the cost is a sum of terms in v and in
        (x, w).
        """
        past, rest = self._split()
        into = self.B @ past
        left = rest @ self.C
        left[:, np.linalg.norm(left, axis=0) <= RANK * np.linalg.norm(self.C, axis=0)] = (
            0.0  # remove rounding errors from the cost
        )
        return Reduced(past, self.A - into @ self.C, self.E - into @ self.D, left, rest @ self.D)

    def game(self, delta: float) -> Game:
        """Return the game with the Riccati equation of this side at δ."""
        _, A, E, C, D = self.reduced()
        A, E, Q = without_feedthrough(A, E, C, D, delta)
        return Game(A=A, B=self.B, E=E, Q=(Q + Q.T) / 2.0, R=self.N.T @ self.N, delta=delta)

    def policies(self, X: np.ndarray, delta: float) -> tuple[np.ndarray, np.ndarray]:
        """Return F1 of the worst disturbance w = F1 x and F2 of the best input u = F2 x.

        X: (n, n), matrix of the value x'X x
        """
        past, _, E, C, D = self.reduced()
        F1 = np.linalg.solve(
            np.eye(D.shape[1]) - D.T @ D / delta**2, (D.T @ C + E.T @ X) / delta**2
        )
        return F1, -past @ (self.C + self.D @ F1) - np.linalg.solve(self.N.T @ self.N, self.B.T @ X)

    @property
    def feedthrough(self) -> float:
        """Largest singular value of the direct path from w to the part of z that u cannot
        affect.
        """
        left = self.reduced().D
        return float(np.linalg.norm(left, 2)) if min(left.shape) else 0.0

    def _split(self) -> tuple[np.ndarray, np.ndarray]:
        """Return N⁺, and orthonormal rows that span the part of z that u cannot affect."""
        Q, R = np.linalg.qr(self.N, mode="complete")
        m = self.N.shape[1]
        return np.linalg.solve(R[:m], Q[:, :m].T), Q[:, m:].T
