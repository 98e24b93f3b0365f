"""Proof that a matrix with Taylor models as entries is positive definite on a whole box."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from hfa_prove.check.piece import ROUNDING
from hfa_prove.enclosure.balls import hull, is_positive_definite
from hfa_prove.enclosure.taylor import Models, highest, lowest


class Ends(NamedTuple):
    """Lower and upper bounds of numbers, arrays of one shape."""

    low: np.ndarray
    high: np.ndarray


class Factor(NamedTuple):
    """Constant matrix of a product.

    value: (k, p)
    error: (k, p), bounds of the differences of its entries from the exact ones
    """

    value: np.ndarray
    error: np.ndarray

    @classmethod
    def exact(cls, value: np.ndarray) -> Factor:
        """Return a matrix of which all entries are exact."""
        return cls(value, np.zeros_like(value))


class ModelMatrix(NamedTuple):
    """Taylor models of the entries of a square matrix over one box.

    c: coefficients, (k, k, coefficients of an entry)
    radius: (k, k)
    n: dimension of the box
    """

    c: np.ndarray
    radius: np.ndarray
    n: int

    @classmethod
    def of(cls, models: Models, size: int, n: int) -> ModelMatrix:
        """Return the matrix (size, size) whose entries are listed column by column."""
        c = models.c.reshape(size, size, -1).transpose(1, 0, 2)
        return cls(c, models.radius.reshape(size, size).T, n)

    def is_definite(self, left: Factor, right: Factor) -> bool:
        """Return whether left' H right + right' H' left is proved positive definite, for all H in
        the models.

        With the Cholesky factor L of this sum at the center and C = L⁻ᵀ, the sum is congruent to a
        matrix near the identity, which is enclosed.
        """
        at_centre = left.value.T @ self.c[:, :, 0] @ right.value
        try:
            C = np.linalg.inv(np.linalg.cholesky(at_centre + at_centre.T)).T
        except np.linalg.LinAlgError:
            return False
        near_one = self._products(left, right, C)
        if not np.all(np.isfinite(near_one)):
            return False
        enclosed = hull(*near_one)
        return bool(is_positive_definite(enclosed + enclosed.transpose()))

    def _products(self, left: Factor, right: Factor, C: np.ndarray) -> Ends:
        """Return bounds of the entries of C' left' H right C, (p, p), for all H in the models."""
        p = len(C)
        A, B = left.value @ C, right.value @ C
        c = np.einsum("ajk,jb->abk", np.einsum("ia,ijk->ajk", A, self.c), B)
        sizes_A = (np.abs(left.value) + left.error) @ np.abs(C)
        sizes_B = (np.abs(right.value) + right.error) @ np.abs(C)
        sizes = np.abs(self.c).sum(axis=2) + self.radius
        # A and B are sums of p terms, and either product with them of k terms
        rounded = 4.0 * (len(A) + p + 2) * 2.0**-53 * sizes
        radius = sizes_A.T @ (self.radius + rounded) @ sizes_B
        radius += (left.error @ np.abs(C)).T @ sizes @ sizes_B
        radius += sizes_A.T @ sizes @ (right.error @ np.abs(C))
        listed = radius.reshape(-1, 1) * (1.0 + ROUNDING)
        models = Models(c.reshape(p * p, -1, 1), listed, listed)
        return Ends(lowest(models, self.n).reshape(p, p), highest(models, self.n).reshape(p, p))
