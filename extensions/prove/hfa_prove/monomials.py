"""V as a polynomial in the state deviations, in double precision.

The module computes values, gradients and boundary points.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations_with_replacement

import numpy as np

from hfa_prove.statements.piece import Polynomial

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


#: Bisections for the edge of a set.
_HALVINGS = 40
#: Directions in which a set is measured.
_DIRECTIONS = 3000
#: Largest number of iterations for the ellipsoid.
_ITERATIONS = 2000
#: Relative distance from the smallest ellipsoid at which the iteration ends.
_NEAR = 1e-3
Term = tuple[float, tuple[int, ...]]


@dataclass(frozen=True, eq=False)
class PolynomialFunction:
    """Polynomial V(z) = Σ coefficient z^exponents in the state deviations z.

    coefficients: (k,)
    exponents: exponents of the states in each term, (k, n)
    """

    coefficients: np.ndarray
    exponents: np.ndarray

    @classmethod
    def quadratic(cls, P: np.ndarray) -> PolynomialFunction:
        """Return the quadratic polynomial V = z'P z, with P (n, n)."""
        n = len(P)
        rows, columns = np.triu_indices(n)
        exponents = np.eye(n, dtype=int)[rows] + np.eye(n, dtype=int)[columns]
        weights = np.where(rows == columns, 1.0, 2.0)
        return cls(P[rows, columns] * weights, exponents)

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
    def degree(self) -> int:
        """Degree of the highest term."""
        return int(self.exponents.sum(axis=1).max())

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

    def coordinates(self) -> np.ndarray:
        """Return T (n, n) of coordinates z = T y in which the unit ball is {z'P z <= 1.5²}.

        P is the matrix of the quadratic part of V. The set {V <= 1} usually lies in this ball.
        """
        return np.asarray(1.5 * np.linalg.inv(np.linalg.cholesky(self.matrix())).T)

    def scaled(self, factor: float) -> PolynomialFunction:
        """Return V multiplied by a number."""
        return PolynomialFunction(self.coefficients * factor, self.exponents)

    def __call__(self, z: np.ndarray) -> np.ndarray:
        """Return V (N,) at state deviations z (N, n)."""
        return np.asarray(_powers(z, self.exponents) @ self.coefficients)

    def slope(self, z: np.ndarray) -> np.ndarray:
        """Return ∂V/∂z (N, n) at state deviations z (N, n)."""
        slopes = np.empty_like(z)
        for i in range(z.shape[1]):
            powers = self.exponents[:, i]
            kept = powers > 0
            lowered = self.exponents[kept].copy()
            lowered[:, i] -= 1
            slopes[:, i] = _powers(z, lowered) @ (self.coefficients[kept] * powers[kept])
        return slopes

    def substituted(self, M: np.ndarray) -> PolynomialFunction:
        """Return V(M y) as a polynomial in y."""
        known: dict[tuple[int, ...], dict[tuple[int, ...], float]] = {}
        total: dict[tuple[int, ...], float] = {}
        for coefficient, powers in self.terms:
            for key, value in _monomial(powers, M, known).items():
                total[key] = total.get(key, 0.0) + coefficient * value
        return PolynomialFunction(np.array(list(total.values())), np.array(list(total)))

    def edge(self, rays: np.ndarray, level: float) -> np.ndarray:
        """Return for each ray z (N, n) the lowest factor at which V reaches a level, (N,).

        The factor is inf if V does not reach the level at factors up to 2.
        """
        degrees = self.exponents.sum(axis=1)
        values = _powers(rays, self.exponents) * self.coefficients
        shares = np.linspace(0.0, 2.0, 201)[1:]
        along = np.zeros((len(rays), len(shares)))
        by_degree = {}
        for degree in np.unique(degrees).tolist():
            by_degree[degree] = values[:, degrees == degree].sum(axis=1)
            along += by_degree[degree][:, None] * shares**degree
        is_beyond = along >= level
        high = shares[is_beyond.argmax(axis=1)]
        low = high - shares[0]
        for _ in range(_HALVINGS):
            middle = (low + high) / 2
            values_there = sum(part * middle**degree for degree, part in by_degree.items())
            high = np.where(values_there >= level, middle, high)
            low = np.where(values_there >= level, low, middle)
        return np.asarray(np.where(is_beyond.any(axis=1), high, np.inf))


def edge_points(V: PolynomialFunction, T: np.ndarray, level: float, seed: int = 0) -> np.ndarray:
    """Return points y (k, n) with V = level, in coordinates z = T y.

    On each random ray from the origin, the first point with V = level is returned. Rays that do not
    reach the level are omitted.

    seed: seed of the random rays
    """
    generator = np.random.default_rng(seed)
    directions = generator.normal(size=(_DIRECTIONS, len(T)))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    shares = V.edge(directions @ T.T, level)
    found = np.isfinite(shares)
    return np.asarray(directions[found] * shares[found, None])


def ellipsoid(points: np.ndarray) -> np.ndarray:
    """Return P (n, n) of nearly the smallest ellipsoid {y'P y <= 1} that contains given points.

    P is a multiple of the inverse of the weighted second moment of the points. The weights maximize
    the determinant of the moment (Khachiyan, Mathematics of Operations Research 21 (1996) 307).

    points: (N, n)
    """
    count, n = points.shape
    weights = np.full(count, 1.0 / count)
    for _ in range(_ITERATIONS):
        inverse = np.linalg.inv(points.T @ (weights[:, None] * points))
        sizes = np.einsum("ki,ij,kj->k", points, inverse, points)
        farthest = int(sizes.argmax())
        excess = sizes[farthest]
        if excess < n * (1.0 + _NEAR):
            break
        step = (excess - n) / (n * (excess - 1.0))
        weights *= 1.0 - step
        weights[farthest] += step
    inverse = np.linalg.inv(points.T @ (weights[:, None] * points))
    sizes = np.einsum("ki,ij,kj->k", points, inverse, points)
    return np.asarray(inverse / sizes.max())


def _powers(z: np.ndarray, exponents: np.ndarray) -> np.ndarray:
    """Return the monomials (N, k) at points z (N, n).

    exponents: (k, n)
    """
    result = np.ones((len(z), len(exponents)))
    for i in range(z.shape[1]):
        highest = int(exponents[:, i].max(initial=0))
        table = np.ones((highest + 1, len(z)))
        for power in range(highest):
            table[power + 1] = table[power] * z[:, i]
        result *= table[exponents[:, i]].T
    return result


def _monomial(
    powers: tuple[int, ...],
    M: np.ndarray,
    known: dict[tuple[int, ...], dict[tuple[int, ...], float]],
) -> dict[tuple[int, ...], float]:
    """Return the polynomial (M y)^powers, exponents of y -> coefficient.

    known: results for other powers, to which the result is added
    """
    if not any(powers):
        return {tuple([0] * M.shape[1]): 1.0}
    if powers not in known:
        i = next(index for index, power in enumerate(powers) if power)
        lowered = tuple(power - (index == i) for index, power in enumerate(powers))
        product: dict[tuple[int, ...], float] = {}
        for key, value in _monomial(lowered, M, known).items():
            for j, slope in enumerate(M[i].tolist()):
                raised = (*key[:j], key[j] + 1, *key[j + 1 :])
                product[raised] = product.get(raised, 0.0) + value * slope
        known[powers] = product
    return known[powers]
