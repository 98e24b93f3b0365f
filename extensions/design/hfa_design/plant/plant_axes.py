"""State coordinates that separate the fast and the slow states of a plant."""

from __future__ import annotations

from typing import NamedTuple, Self

import numpy as np

from controller.riccati.balancing import balanced


class Axes(NamedTuple):
    """Coordinates y = T x of a state x.

    T: (n, n)
    inverse: T⁻¹, (n, n)
    """

    T: np.ndarray
    inverse: np.ndarray

    @classmethod
    def of(cls, A: np.ndarray) -> Self:
        """Return the coordinates of the Schur form of A after balancing, for A (n, n)."""
        from scipy.linalg import schur

        matrix, units = balanced(A)
        W = schur(matrix)[1]
        return cls(W.T / units, units[:, None] * W)

    def scaled(self, units: np.ndarray) -> Self:
        """Return the coordinates z with y_i = u_i z_i.

        units: u, (n,), powers of two
        """
        return type(self)(self.T / units[:, None], self.inverse * units)

    def rows(self, M: np.ndarray) -> np.ndarray:
        """Return T M for a matrix M with one row for each state x."""
        return self.T @ M

    def columns(self, M: np.ndarray) -> np.ndarray:
        """Return M T⁻¹ for a matrix M with one column for each state x."""
        return M @ self.inverse

    def square(self, M: np.ndarray) -> np.ndarray:
        """Return T M T⁻¹ for a square matrix M in the coordinates x."""
        return self.T @ M @ self.inverse

    def rows_back(self, M: np.ndarray) -> np.ndarray:
        """Return T⁻¹ M for a matrix M with one row for each coordinate y."""
        return self.inverse @ M

    def columns_back(self, M: np.ndarray) -> np.ndarray:
        """Return M T for a matrix M with one column for each coordinate y."""
        return M @ self.T

    def square_back(self, M: np.ndarray) -> np.ndarray:
        """Return T⁻¹ M T for a square matrix M in the coordinates y."""
        return self.inverse @ M @ self.T

    def value_back(self, X: np.ndarray) -> np.ndarray:
        """Return T'X T, (n, n), symmetric, for a value y'X y."""
        P = self.T.T @ X @ self.T
        return (P + P.T) / 2.0

    def dual_value_back(self, Y: np.ndarray) -> np.ndarray:
        """Return T⁻¹ Y T⁻ᵀ, (n, n), symmetric, for the value Y of the transposed plant."""
        P = self.inverse @ Y @ self.inverse.T
        return (P + P.T) / 2.0
