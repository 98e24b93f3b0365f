"""Discrete-time zero-sum game with cross weights and a discount."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from controller.game.zero_sum import Game
from hfa_aircraft.names import PlantNames
from hfa_support.arguments import ArrayLike
from hfa_support.errors import BadInputError, is_finite
from hfa_support.matrices import LARGEST, checked_matrix, shape_text
from hfa_support.reporting.report import Reported


@dataclass(frozen=True, eq=False, repr=False)
class DiscreteGame(Reported):
    """Discrete-time game, x⁺ = A x + B u + E w, J = Σ αᵏ (x'Qx + 2 x'Nu + u'Ru - δ² w'w).

    u minimizes and w maximizes J.

    step: A, B, E, Q, R, delta and N of one step
    discount: α, 0 < α <= 1
    A_low: difference between A and its double-precision value, (n, n), or None for 0. The
        difference is used for short steps, for which A is nearly I.
    continuous: game in continuous time of which this game is the sampled one (`sampled`), or None
    dt: sample time, s, or None if the game is not sampled

    Raises BadInputError if the discount is out of range.
    """

    step: Game
    discount: float = 1.0
    A_low: Any = None
    continuous: Game | None = None
    dt: float | None = None

    def __post_init__(self) -> None:
        """Check the discount, and replace None by zeros in A_low.

        `Game` has checked the matrices of the step.
        """
        if not (is_finite(self.discount) and 0.0 < self.discount <= 1.0):
            raise BadInputError(
                f"discount is {self.discount}; give the factor per step, a number above 0 and at "
                "most 1"
            )
        A_low = np.zeros_like(self.step.A) if self.A_low is None else self.A_low
        object.__setattr__(self, "A_low", A_low)
        object.__setattr__(self, "discount", float(self.discount))

    @property
    def A(self) -> np.ndarray:
        """A of one step, (n, n)."""
        return self.step.A

    @property
    def B(self) -> np.ndarray:
        """B of one step, (n, m)."""
        return self.step.B

    @property
    def N(self) -> np.ndarray:
        """Cross weights of one step, (n, m)."""
        return self.step.N

    @property
    def F(self) -> np.ndarray:
        """R⁻¹ N' of one step, (m, n)."""
        return self.step.F

    @property
    def R_inverse_B_transposed(self) -> np.ndarray:
        """R⁻¹ B' of one step, (m, n)."""
        return self.step.R_inverse_B_transposed

    @property
    def names(self) -> PlantNames:
        """Names and units of the states and inputs."""
        return self.step.names

    def gain(self, P: np.ndarray) -> np.ndarray:
        """Return K (m, n) of the policy u = -K x that the value x'P x implies (`policies`)."""
        return self.policies(P)[0]

    def checked_gain(self, K: ArrayLike) -> np.ndarray:
        """Return K as an array of floats.

        Raises BadInputError if K is not a real m x n matrix.
        """
        return self.step.checked_gain(K)

    def policies(self, P: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return K (m, n) and L (k, n) of the optimal policies u = -K x and w = L x of one step.

        The cost after the step is x'P x at the next state.

          [K; -L] = (W + α G'P G)⁻¹ (α G'P A + [N 0]'),  G = [B E],  W = blkdiag(R, -δ² I)

        With δ = inf, L is 0. Both are nan if no extremum exists.

        P: (n, n)
        """
        step = self.step
        m = step.B.shape[1]
        G = np.hstack([step.B, step.E / step.delta])
        W = np.diag(np.repeat([0.0, -1.0], [m, G.shape[1] - m]))
        W[:m, :m] = step.R
        right = self.discount * G.T @ P @ step.A
        right[:m] += step.N.T
        try:
            with np.errstate(all="ignore"):
                gains = np.linalg.solve(W + self.discount * G.T @ P @ G, right)
        except np.linalg.LinAlgError:
            gains = np.full_like(right, np.nan)
        return gains[:m], -gains[m:] / step.delta

    def q_function(self, P: np.ndarray) -> np.ndarray:
        """Return H (n + m + k, n + m + k) of the Q-function Q(x, u, w) = [x; u; w]'H [x; u; w].

        Q is the cost of one step, followed by the cost x'P x at the next state.

          H = [[Q, N, 0], [N', R, 0], [0, 0, -δ² I]] + α [A B E]'P [A B E]

        With δ = inf, H is over (x, u), (n + m, n + m).

        P: (n, n)
        """
        step = self.step
        moved = np.hstack([step.A, step.B])
        weights = step.weights
        if math.isfinite(step.delta):
            moved = np.hstack([moved, step.E])
            k = step.E.shape[1]
            size = len(weights)
            weights = np.block(
                [
                    [weights, np.zeros((size, k))],
                    [np.zeros((k, size)), -(step.delta**2) * np.eye(k)],
                ]
            )
        return np.asarray(weights + self.discount * moved.T @ P @ moved)

    def of_q_function(self, H: np.ndarray) -> dict[str, np.ndarray]:
        """Return P, K and L, name -> matrix, at the extremum of a Q-function over u and w.

          [K; -L] = H_aa⁻¹ H_ax,  P = H_xx - H_xa H_aa⁻¹ H_ax,  a = (u, w)

        L is omitted if H is over (x, u).

        H: symmetric matrix of the Q-function, over (x, u, w) or (x, u). With δ = inf, only over (x,
            u).

        Raises BadInputError if H has a wrong shape or is not symmetric, or if H_aa is singular.
        """
        n, m = self.step.B.shape
        shapes = {"(x, u)": (n + m,) * 2}
        if math.isfinite(self.step.delta):
            shapes["(x, u, w)"] = (n + m + self.step.E.shape[1],) * 2
        H = checked_matrix("H", H, LARGEST)
        if H.shape not in shapes.values():
            rules = [f"{shape_text(shape)} over {names}" for names, shape in shapes.items()]
            raise BadInputError(f"H is {shape_text(H.shape)}; give {' or '.join(rules)}")
        asymmetry = np.abs(H - H.T)
        if asymmetry.max() > 1e-6 * np.abs(H).max():
            row, column = np.unravel_index(asymmetry.argmax(), H.shape)
            raise BadInputError(
                f"H is not symmetric (row {row + 1}, column {column + 1}); give (H + H')/2"
            )
        try:
            gains = np.linalg.solve(H[n:, n:], H[n:, :n])
        except np.linalg.LinAlgError as error:
            raise BadInputError(
                "the block of H over the inputs is singular, so no optimal input exists; correct H"
            ) from error
        parts = {"P": H[:n, :n] - H[:n, n:] @ gains, "K": gains[:m]}
        if len(H) > n + m:
            parts["L"] = -gains[m:]
        return parts
