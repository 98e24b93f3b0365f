"""Monomials of several variables, evaluated at many points."""

from __future__ import annotations

from itertools import combinations_with_replacement

import numpy as np

from hfa_boxes.check.piece import Polynomial

#: Bits of a coefficient, so that its products with powers are doubles.
_BITS = 45


class Monomials:
    """All monomials of n variables with degrees from 2 to a highest degree.

    n: number of variables
    degree: highest degree
    """

    def __init__(self, n: int, degree: int) -> None:
        self.n = n
        self.degree = degree
        powers = []
        for total in range(2, degree + 1):
            for chosen in combinations_with_replacement(range(n), total):
                powers.append(tuple(chosen.count(i) for i in range(n)))
        self.powers = np.array(powers)

    @property
    def degrees(self) -> np.ndarray:
        """Degree of each monomial, (K,)."""
        return np.asarray(self.powers.sum(axis=1))

    def quadratic(self, S: np.ndarray) -> np.ndarray:
        """Return the coefficients (K,) of the quadratic form y'S y, with S (n, n)."""
        coefficients = np.zeros(len(self.powers))
        for index in np.flatnonzero(self.degrees == 2):
            i, j = np.repeat(np.arange(self.n), self.powers[index])
            coefficients[index] = S[i, i] if i == j else S[i, j] + S[j, i]
        return coefficients

    def at(self, y: np.ndarray) -> np.ndarray:
        """Return the monomials (N, K) at points (N, n)."""
        table = self._table(y)
        values = np.ones((len(y), len(self.powers)))
        for i in range(self.n):
            values *= table[self.powers[:, i], :, i].T
        return values

    def slopes(self, y: np.ndarray) -> np.ndarray:
        """Return the gradients (N, K, n) of the monomials at points (N, n)."""
        table = self._table(y)
        slopes = np.empty((len(y), len(self.powers), self.n))
        for j in range(self.n):
            powers = self.powers.copy()
            powers[:, j] = np.maximum(powers[:, j] - 1, 0)
            values = np.broadcast_to(self.powers[:, j].astype(float), slopes.shape[:2]).copy()
            for i in range(self.n):
                values *= table[powers[:, i], :, i].T
            slopes[:, :, j] = values
        return slopes

    def polynomial(self, coefficients: np.ndarray) -> Polynomial:
        """Return the polynomial with the given coefficients (K,), each rounded to `_BITS` bits."""
        mantissa, exponent = np.frexp(coefficients)
        rounded = np.ldexp(np.round(np.ldexp(mantissa, _BITS)), exponent - _BITS)
        pairs = zip(rounded.tolist(), self.powers.tolist(), strict=True)
        return Polynomial(self.n, tuple((value, tuple(powers)) for value, powers in pairs if value))

    def _table(self, y: np.ndarray) -> np.ndarray:
        """Return all powers of y (N, n) from 0 to the highest degree, (degree + 1, N, n)."""
        table = np.ones((self.degree + 1, *y.shape))
        for power in range(1, self.degree + 1):
            table[power] = table[power - 1] * y
        return table
