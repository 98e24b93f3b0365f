"""State coordinates that separate the fast and the slow states of a plant.

In coordinates that mix fast and slow states, rounding errors are proportional to the fast states
and hide the slow states. For a plant with poles from 1e-4 to 1e4 rad/s, neither Riccati equation
would have a correct digit. The transformation and its inverse are computed in twice the digits and
rounded once at the end, so no digit of the given numbers is lost.
"""

from __future__ import annotations

from typing import NamedTuple, Self

import numpy as np

from controller.riccati.balancing import balanced
from controller.riccati.double_double import Pair, exact, product, transposed
from controller.riccati.normal_form import precise_inverse


class Axes(NamedTuple):
    """Coordinates y = T x of a state x, with T = D W'U⁻¹.

    units: diagonal of U, (n,), powers of two
    W: (n, n), orthogonal except for rounding
    inverse: (W')⁻¹, in twice the digits
    scale: diagonal of D, (n,), powers of two
    """

    units: np.ndarray
    W: np.ndarray
    inverse: Pair
    scale: np.ndarray

    @classmethod
    def of(cls, A: np.ndarray) -> Self:
        """Return the coordinates of the Schur form of A after balancing, for A (n, n)."""
        from scipy.linalg import schur

        matrix, units = balanced(A)
        W = schur(matrix)[1]
        return cls(units, W, precise_inverse(W), np.ones(len(W)))

    def scaled(self, units: np.ndarray) -> Self:
        """Return the coordinates z with y_i = u_i z_i.

        units: u, (n,), powers of two
        """
        return self._replace(scale=self.scale / units)

    def rows(self, M: np.ndarray) -> np.ndarray:
        """Return T M for a matrix M with one row for each state x."""
        high, _ = product(exact(self.W.T), exact(M / self.units[:, None]))
        return np.asarray(high * self.scale[:, None])

    def columns(self, M: np.ndarray) -> np.ndarray:
        """Return M T⁻¹ for a matrix M with one column for each state x."""
        high, _ = product(exact(M * self.units), self.inverse)
        return np.asarray(high / self.scale)

    def square(self, M: np.ndarray) -> np.ndarray:
        """Return T M T⁻¹ for a square matrix M in the coordinates x."""
        given = exact(M * self.units / self.units[:, None])
        high, _ = product(product(exact(self.W.T), given), self.inverse)
        return np.asarray(high * self.scale[:, None] / self.scale)

    def rows_back(self, M: np.ndarray) -> np.ndarray:
        """Return T⁻¹ M for a matrix M with one row for each coordinate y."""
        high, _ = product(self.inverse, exact(M / self.scale[:, None]))
        return np.asarray(high * self.units[:, None])

    def columns_back(self, M: np.ndarray) -> np.ndarray:
        """Return M T for a matrix M with one column for each coordinate y."""
        high, _ = product(exact(M * self.scale), exact(self.W.T))
        return np.asarray(high / self.units)

    def square_back(self, M: np.ndarray) -> np.ndarray:
        """Return T⁻¹ M T for a square matrix M in the coordinates y."""
        inner = exact(M * self.scale / self.scale[:, None])
        high, _ = product(product(self.inverse, inner), exact(self.W.T))
        return np.asarray(high * self.units[:, None] / self.units)

    def value_back(self, X: np.ndarray) -> np.ndarray:
        """Return T'X T, (n, n), symmetric, for a value y'X y."""
        inner = exact(X * np.outer(self.scale, self.scale))
        high, _ = product(product(exact(self.W), inner), exact(self.W.T))
        return _symmetric(high / np.outer(self.units, self.units))

    def dual_value_back(self, Y: np.ndarray) -> np.ndarray:
        """Return T⁻¹ Y T⁻ᵀ, (n, n), symmetric, for the value Y of the transposed plant."""
        inner = exact(Y / np.outer(self.scale, self.scale))
        high, _ = product(product(self.inverse, inner), transposed(self.inverse))
        return _symmetric(high * np.outer(self.units, self.units))


def _symmetric(M: np.ndarray) -> np.ndarray:
    return np.asarray((M + M.T) / 2.0)
