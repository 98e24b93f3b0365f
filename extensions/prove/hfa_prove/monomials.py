"""Polynomials V and W in double precision: values and gradients."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import combinations_with_replacement

import numpy as np

from hfa_prove.statements.piece import Polynomial, lowered

#: Bits of a coefficient, so that its products with powers are doubles.
_BITS = 45
#: Bisections for the edge of a set.
_HALVINGS = 34
#: Difference of two factors at which a polynomial is evaluated along a ray.
_STEP = 0.02
Term = tuple[float, tuple[int, ...]]


@dataclass(frozen=True, eq=False)
class PolynomialFunction:
    """Polynomial V(z) = Σ coefficient z^exponents.

    coefficients: (k,)
    exponents: exponents of the states in each term, (k, n)
    """

    coefficients: np.ndarray
    exponents: np.ndarray

    @classmethod
    def quadratic(cls, P: np.ndarray, degree: int = 2) -> PolynomialFunction:
        """Return the quadratic polynomial V = z'P z, with P (n, n).

        degree: highest degree of the monomials, of which those above 2 have the coefficient 0
        """
        n = len(P)
        exponents = []
        for total in range(2, degree + 1):
            for chosen in combinations_with_replacement(range(n), total):
                exponents.append(tuple(chosen.count(i) for i in range(n)))
        rows, columns = np.triu_indices(n)
        coefficients = np.zeros(len(exponents))
        both = P[rows, columns] + P[columns, rows]
        coefficients[: len(rows)] = np.where(rows == columns, 0.5 * both, both)
        return cls(coefficients, np.array(exponents))

    @classmethod
    def of_terms(cls, terms: Sequence[Term]) -> PolynomialFunction:
        """Return the polynomial with the terms of a statement."""
        return cls(
            np.array([coefficient for coefficient, _ in terms]),
            np.array([exponents for _, exponents in terms]),
        )

    @property
    def terms(self) -> tuple[Term, ...]:
        """Terms of V in the form of a statement, pairs of a coefficient and exponents."""
        pairs = zip(self.coefficients.tolist(), self.exponents.tolist(), strict=True)
        return tuple((coefficient, tuple(powers)) for coefficient, powers in pairs)

    @property
    def degrees(self) -> np.ndarray:
        """Degree of each monomial, (k,)."""
        return np.asarray(self.exponents.sum(axis=1))

    @property
    def degree(self) -> int:
        """Degree of the highest monomial."""
        return int(self.degrees.max())

    def with_coefficients(self, coefficients: np.ndarray) -> PolynomialFunction:
        """Return the polynomial with the same monomials and other coefficients (k,)."""
        return PolynomialFunction(coefficients, self.exponents)

    def rounded(self) -> Polynomial:
        """Return the polynomial of a statement, each coefficient rounded to `_BITS` bits."""
        mantissa, exponent = np.frexp(self.coefficients)
        rounded = np.ldexp(np.round(np.ldexp(mantissa, _BITS)), exponent - _BITS)
        terms = self.with_coefficients(rounded).terms
        n = self.exponents.shape[1]
        return Polynomial(n, tuple((value, powers) for value, powers in terms if value))

    def matrix(self) -> np.ndarray:
        """Return the matrix P (n, n) of the quadratic part z'P z of V."""
        n = self.exponents.shape[1]
        P = np.zeros((n, n))
        for coefficient, powers in zip(self.coefficients, self.exponents, strict=True):
            if powers.sum() == 2:
                i, j = np.repeat(np.arange(n), powers)
                P[i, j] += coefficient / 2
                P[j, i] += coefficient / 2
        return P

    def scaled(self, factor: float) -> PolynomialFunction:
        """Return V multiplied by a number."""
        return self.with_coefficients(self.coefficients * factor)

    def monomials(self, z: np.ndarray) -> np.ndarray:
        """Return the monomials (N, k) at points z (N, n)."""
        return _products(z, self.exponents)

    def monomial_slopes(self, z: np.ndarray) -> np.ndarray:
        """Return the gradients (N, k, n) of the monomials at points z (N, n)."""
        unique, places = self._lowered
        return self.exponents * _products(z, unique)[:, places]

    @cached_property
    def _lowered(self) -> tuple[np.ndarray, np.ndarray]:
        """Exponents (l, n) of the monomials in the gradients, and the index (k, n) of each one."""
        n = self.exponents.shape[1]
        each = np.maximum(self.exponents[:, None, :] - np.eye(n, dtype=int), 0)
        unique, places = np.unique(each.reshape(-1, n), axis=0, return_inverse=True)
        return unique, places.reshape(-1, n)

    def __call__(self, z: np.ndarray) -> np.ndarray:
        """Return V (N,) at points z (N, n)."""
        return np.asarray(self.monomials(z) @ self.coefficients)

    def slope(self, z: np.ndarray) -> np.ndarray:
        """Return the gradient ∂V/∂z (N, n) at points z (N, n)."""
        unique, places = self._lowered
        weights = np.zeros((len(unique), z.shape[1]))
        np.add.at(
            weights, (places, np.arange(z.shape[1])), self.exponents * self.coefficients[:, None]
        )
        return np.asarray(_products(z, unique) @ weights)

    def substituted(self, M: np.ndarray) -> PolynomialFunction:
        """Return V(M y) as a polynomial in y."""
        known: dict[tuple[int, ...], dict[tuple[int, ...], float]] = {}
        total: dict[tuple[int, ...], float] = {}
        for coefficient, powers in self.terms:
            for key, value in _monomial(powers, M, known).items():
                total[key] = total.get(key, 0.0) + coefficient * value
        return PolynomialFunction(np.array(list(total.values())), np.array(list(total)))

    def edge(self, rays: np.ndarray, level: float, farthest: float = 2.0) -> np.ndarray:
        """Return for each ray z (N, n) the lowest factor at which V reaches a level, (N,).

        The factor is inf if V does not reach the level at factors up to `farthest`.
        """
        values = self.monomials(rays) * self.coefficients
        if self.degree == 2:
            value = values.sum(axis=1)
            factors = np.sqrt(level / np.where(value > 0.0, value, np.inf))
            return np.where((value > 0.0) & (factors <= farthest), factors, np.inf)
        shares = _STEP * np.arange(1, round(farthest / _STEP) + 1)
        along = np.zeros((len(rays), len(shares)))
        by_degree = {}
        for degree in np.unique(self.degrees).tolist():
            by_degree[degree] = values[:, self.degrees == degree].sum(axis=1)
            along += by_degree[degree][:, None] * shares**degree
        is_beyond = along >= level
        high = shares[is_beyond.argmax(axis=1)]
        low = high - _STEP
        for _ in range(_HALVINGS):
            middle = (low + high) / 2
            values_there = sum(part * middle**degree for degree, part in by_degree.items())
            high = np.where(values_there >= level, middle, high)
            low = np.where(values_there >= level, low, middle)
        return np.asarray(np.where(is_beyond.any(axis=1), high, np.inf))


def _products(z: np.ndarray, exponents: np.ndarray) -> np.ndarray:
    """Return the monomials (N, k) with given exponents (k, n) at points z (N, n)."""
    result = np.ones((len(exponents), len(z)))
    for state, powers in zip(np.ascontiguousarray(z.T), exponents.T, strict=True):
        power = np.ones(len(z))
        for exponent in range(1, int(powers.max(initial=0)) + 1):
            power = power * state
            result[powers == exponent] *= power
    return result.T


def _monomial(
    powers: tuple[int, ...],
    M: np.ndarray,
    known: dict[tuple[int, ...], dict[tuple[int, ...], float]],
) -> dict[tuple[int, ...], float]:
    """Return the polynomial (M y)^powers, exponents of y -> coefficient, and add it to `known`."""
    if not any(powers):
        return {tuple([0] * M.shape[1]): 1.0}
    if powers not in known:
        i = next(index for index, power in enumerate(powers) if power)
        product: dict[tuple[int, ...], float] = {}
        for key, value in _monomial(lowered(powers, i), M, known).items():
            for j, slope in enumerate(M[i].tolist()):
                raised = (*key[:j], key[j] + 1, *key[j + 1 :])
                product[raised] = product.get(raised, 0.0) + value * slope
        known[powers] = product
    return known[powers]
