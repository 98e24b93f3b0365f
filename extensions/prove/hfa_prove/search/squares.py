"""Interior point method for semidefinite problems with large matrices and few equations.

    minimize c'f subject, in each group, to E f + Σ_k A_k(Q_k) = b, with Q_k positive semidefinite

A sum of squares of four states and degree 8 has 495 equations and 5,000 matrix entries. The
equations of different identities share only f. A general solver (Clarabel 0.11) factors a matrix
of the size of the entries. This solver factors a matrix of the size of the equations for each
group.

Sources: C. Helmberg, F. Rendl, R. Vanderbei, H. Wolkowicz, SIAM J. Optim. 6 (1996) 342 (direction);
S. Mehrotra, SIAM J. Optim. 2 (1992) 575 (predictor and corrector).
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import cache, cached_property, lru_cache
from typing import Any, NamedTuple

import numpy as np
import scipy.linalg
import scipy.sparse as sp

from hfa_prove.enclosure.polynomial import Polynomial, exponents_of, monomials
from hfa_prove.monomials import PolynomialFunction

#: Base of the exponents in one whole number.
BASE = 16
#: Largest number of entries of the matrices of a block; larger arrays do not fit in the cache.
_ENTRIES = 60_000


@cache
def packed(key: int) -> int:
    """Return the exponents α of a monomial's key packed into one number, Σ α_i 16^i."""
    return sum(power * BASE**i for i, power in enumerate(exponents_of(key)))


@lru_cache(maxsize=64)
def packed_monomials(variables: int, low: int, high: int) -> np.ndarray:
    """Return the monomials of `monomials` as packed numbers, in the same order.

    low, high: lowest and highest degree
    """
    return np.array([packed(key) for key in monomials(variables, low, high)], dtype=np.int64)


@dataclass(frozen=True, eq=False)
class _Block:
    """Consecutive products of one degree, with the n monomials of their matrices.

    The monomials are those that occur in products of this degree or a higher degree. k is the
    number of products.

    start: index of the first monomial
    first, last: range of the indices of the products
    stacked: matrices of the products, one below the other, (k n, n)
    sums: entries that each product from `first` on has in the matrix of monomials, (l, n²)
    """

    start: int
    first: int
    last: int
    stacked: sp.csr_matrix
    sums: sp.csr_matrix


@dataclass(frozen=True, eq=False)
class Products:
    """Different products of pairs of n monomials m.

    size: number of monomials n
    keys: packed keys of the products, by degree, (k,)
    sums: (k, n²), 1 where an entry of the matrix m m' equals the product
    blocks: products of one degree each, in blocks whose matrices fit in the processor's cache
    """

    size: int
    keys: np.ndarray
    sums: sp.csr_matrix
    blocks: Sequence[_Block]

    def schur(self, Q: np.ndarray, inverse: np.ndarray) -> np.ndarray:
        """Return the matrix (k, k) with entries tr(H_i Z⁻¹ H_j Q).

        H_i is the matrix (n, n) of product i, with entries 1 where m m' equals the product.

        Q: symmetric matrix, (n, n)
        inverse: Z⁻¹, symmetric, (n, n)
        """
        M = np.zeros((len(self.keys), len(self.keys)))
        for block in self.blocks:
            n = self.size - block.start
            kept = slice(block.start, None)
            right = (block.stacked @ Q[kept, kept]).reshape(-1, n, n)
            scaled = np.matmul(inverse[kept, kept], right).reshape(-1, n * n)
            own = slice(block.first, block.last)
            M[block.first :, own] = block.sums @ scaled.T
            M[own, block.last :] = M[block.last :, own].T
        return M


@lru_cache(maxsize=64)
def products_of(variables: int, low: int, high: int) -> Products:
    """Return the products of pairs of monomials of the degrees low to high.

    variables: number of variables
    """
    own = packed_monomials(variables, low, high)
    counts = [len(monomials(variables, degree, degree)) for degree in range(low, high + 1)]
    degrees = np.repeat(np.arange(low, high + 1), counts)
    pairs = (own[:, None] + own).ravel()
    degrees_of_pairs = (degrees[:, None] + degrees).ravel()
    _, firsts = np.unique(pairs, return_index=True)
    firsts = firsts[np.lexsort((pairs[firsts], degrees_of_pairs[firsts]))]
    keys = pairs[firsts]
    by_degree = degrees_of_pairs[firsts]
    entries = np.arange(len(pairs))
    order = np.argsort(keys)
    places = order[np.searchsorted(keys, pairs, sorter=order)]
    shape = (len(keys), len(pairs))
    sums = sp.csr_matrix((np.ones(len(pairs)), (places, entries)), shape=shape)
    blocks = []
    for degree in np.unique(by_degree).tolist():
        start = int(np.searchsorted(degrees, degree - high))
        begin, end = np.searchsorted(by_degree, [degree, degree + 1]).tolist()
        taken = np.arange(len(own)) >= start
        inner = sums[:, np.outer(taken, taken).ravel()]
        count = max(1, _ENTRIES // (len(own) - start) ** 2)
        for first in range(begin, end, count):
            last = min(first + count, end)
            stacked = inner[first:last].reshape((-1, len(own) - start)).tocsr()
            blocks.append(_Block(start, first, last, stacked, inner[first:]))
    return Products(len(own), keys, sums, blocks)


#: Largest margin of a Gram matrix, for a target whose largest coefficient is 1.
_MOST_MARGIN = 1e-3
#: Tolerance of the equations of evidence.
_EXACT = 1e-9
#: Tolerance of the equations of a step, whose result is proved anew.
_ABOUT = 1e-6
#: Relative distance of a cost from its least value at which a step ends.
_NEAR = 1e-4


@dataclass(frozen=True, eq=False)
class Terms:
    """Polynomial Σ value y^exponents in double precision.

    keys: exponents of each term packed into one number, Σ α_i 16^i
    values: coefficients
    """

    keys: np.ndarray
    values: np.ndarray

    @classmethod
    def of(cls, polynomial: Polynomial) -> Terms:
        """Return the polynomial whose coefficients are the midpoints of a polynomial's balls."""
        keys = []
        values = []
        for key, _, coefficient in polynomial.terms():
            keys.append(packed(key))
            values.append(float(coefficient.mid()))
        return cls(np.array(keys, dtype=np.int64), np.array(values, dtype=float))

    @classmethod
    def packed(cls, V: PolynomialFunction) -> Terms:
        """Return a polynomial with its exponents packed into keys."""
        base = BASE ** np.arange(V.exponents.shape[1], dtype=np.int64)
        return cls(V.exponents.astype(np.int64) @ base, V.coefficients)

    def __add__(self, other: Terms) -> Terms:
        keys = np.concatenate([self.keys, other.keys])
        return Terms(keys, np.concatenate([self.values, other.values]))

    def scaled(self, factor: float) -> Terms:
        """Return the polynomial multiplied by a number."""
        return Terms(self.keys, self.values * factor)

    @property
    def size(self) -> float:
        """Largest absolute value of a coefficient."""
        return float(np.max(np.abs(self.values), initial=0.0))


#: The polynomial 1.
ONE = Terms(np.zeros(1, dtype=np.int64), np.ones(1))


@dataclass(frozen=True, eq=False)
class Gram:
    """A Gram matrix Q of a problem, for which Q - margin I must be positive semidefinite.

    low, high: lowest and highest degree of the monomials of Q
    size: number of monomials
    identity: index of the identity that contains Q
    place: index of Q among the matrices of this identity
    """

    low: int
    high: int
    size: int
    identity: int
    place: int


@dataclass(eq=False)
class Identity:
    """A polynomial that must be 0: constants + Σ value x_column y^key - Σ m'Q m factor.

    number: index of the identity in its problem
    keys, columns, values: terms with free unknowns x, as parallel lists
    constants: polynomials without unknowns
    grams: Gram matrices Q, each with its factor
    """

    number: int
    keys: list[np.ndarray] = field(default_factory=list)
    columns: list[np.ndarray] = field(default_factory=list)
    values: list[np.ndarray] = field(default_factory=list)
    constants: list[Terms] = field(default_factory=list)
    grams: list[tuple[Gram, Terms]] = field(default_factory=list)


class Squares:
    """A sum-of-squares problem with Gram matrices and free unknowns. Unknown 0 is the margin.

    variables: number of variables of the polynomials
    """

    def __init__(self, variables: int) -> None:
        self.variables = variables
        self._count = 1
        self._identities: list[Identity] = []
        self._costs: dict[int, float] = {}

    def free(self, count: int) -> np.ndarray:
        """Add free unknowns of any sign and return their column indices."""
        start = self._count
        self._count += count
        return np.arange(start, self._count)

    def identity(self, target: Terms) -> Identity:
        """Add the identity target + terms = 0 to the problem and return the identity.

        The identity has no terms at first. Terms are added by `add` and `subtract`.

        target: the polynomial
        """
        identity = Identity(len(self._identities), constants=[target])
        self._identities.append(identity)
        return identity

    def subtract(self, identity: Identity, low: int, high: int, factor: Terms = ONE) -> Gram:
        """Add the term -m'Q m factor to an identity and return the new Gram matrix Q.

        low, high: lowest and highest degree of the monomials m
        """
        size = len(monomials(self.variables, low, high))
        gram = Gram(low, high, size, identity.number, len(identity.grams))
        identity.grams.append((gram, factor))
        return gram

    def add(
        self, identity: Identity, keys: np.ndarray, columns: np.ndarray, values: np.ndarray
    ) -> None:
        """Add the terms value x_column y^key to an identity.

        keys: packed exponents of each term
        columns: column index of the free unknown of each term
        values: coefficient of each term
        """
        identity.keys.append(keys)
        identity.columns.append(columns)
        identity.values.append(values)

    def cost(self, columns: np.ndarray, values: np.ndarray) -> None:
        """Add Σ value x_column to the cost, which is minimized."""
        for column, value in zip(columns.tolist(), values.tolist(), strict=True):
            self._costs[column] = self._costs.get(column, 0.0) + value

    def solve(
        self, margin: float | None = None, seconds: float = np.inf, enough: float | None = None
    ) -> Solution | None:
        """Return the solution of the problem, or None if the solver finds no solution.

        margin: fixed margin of the Gram matrices, or None to maximize the margin. With a fixed
            margin, the cost is minimized to the relative tolerance `_NEAR`.
        seconds: limit of the processor time, s
        enough: a sufficient margin, or None. The search ends when this margin is reached or proved
            unreachable.
        """
        groups = [self._group(identity) for identity in self._identities]
        cost = np.zeros(self._count)
        for column, value in self._costs.items():
            cost[column] = value
        if margin is None:
            cost[0] = -1.0
            limit = Matrix(products_of(self.variables, 0, 0), sp.csr_matrix(np.ones((1, 1))))
            groups.append(Group(np.eye(1, self._count), np.array([_MOST_MARGIN]), [limit]))
        else:
            groups = [_with_margin(group, margin) for group in groups]
            cost = cost[1:]

        def suffices(now: float, bound: float) -> bool:
            if margin is not None:
                return now - bound < _NEAR * abs(now)
            return enough is not None and (-now >= enough or -bound < enough)

        tolerance = _EXACT if margin is None else _ABOUT
        point = minimized(groups, cost, enough=suffices, tolerance=tolerance, seconds=seconds)
        if point is None:
            return None
        x = point.f if margin is None else np.concatenate([[margin], point.f])
        return Solution(x, point.matrices)

    def _group(self, identity: Identity) -> Group:
        """Return the equations of an identity, one for each monomial."""
        constant = identity.constants[0]
        for more in identity.constants[1:]:
            constant = constant + more
        products = [products_of(self.variables, gram.low, gram.high) for gram, _ in identity.grams]
        terms = [
            (made.keys[:, None] + factor.keys).ravel()
            for made, (_, factor) in zip(products, identity.grams, strict=True)
        ]
        known = np.unique(np.concatenate([*identity.keys, *terms, constant.keys]))
        E = np.zeros((len(known), self._count))
        for keys, columns, values in zip(
            identity.keys, identity.columns, identity.values, strict=True
        ):
            np.add.at(E, (np.searchsorted(known, keys), columns), values)
        matrices = []
        for made, keys, (_, factor) in zip(products, terms, identity.grams, strict=True):
            count = len(made.keys)
            places = (np.searchsorted(known, keys), np.repeat(np.arange(count), len(factor.keys)))
            values = np.tile(-factor.values, count)
            shares = sp.csr_matrix((values, places), shape=(len(known), count))
            matrix = Matrix(made, shares)
            matrices.append(matrix)
            diagonal = np.arange(matrix.size) * (matrix.size + 1)
            E[:, 0] += np.asarray(matrix.equations[:, diagonal].sum(axis=1)).ravel()
        b = np.zeros(len(known))
        np.subtract.at(b, np.searchsorted(known, constant.keys), constant.values)
        return Group(E, b, matrices)


def _with_margin(group: Group, margin: float) -> Group:
    """Return a group of equations with the margin, unknown 0, fixed at a value."""
    return Group(group.E[:, 1:], group.b - margin * group.E[:, 0], group.matrices)


@dataclass(frozen=True, eq=False)
class Solution:
    """Solution of a sum-of-squares problem.

    x: the free unknowns, with the margin x[0]
    matrices: Gram matrices of each identity, without the margin on their diagonals
    """

    x: np.ndarray
    matrices: list[list[np.ndarray]]

    @property
    def margin(self) -> float:
        """Margin of all Gram matrices."""
        return float(self.x[0])

    def matrix(self, gram: Gram) -> np.ndarray:
        """Return a Gram matrix, with the margin added to its diagonal."""
        without = self.matrices[gram.identity][gram.place]
        return without + self.margin * np.eye(gram.size)


class Degrees(NamedTuple):
    """Lowest and highest degree of the monomials of a Gram matrix."""

    low: int
    high: int


class Constraint(NamedTuple):
    """Constraint polynomial >= 0.

    degrees: degrees of the monomials of its multiplier
    """

    name: str
    polynomial: Terms
    degrees: Degrees


def positive(
    target: Terms,
    constraints: Sequence[Constraint],
    degrees: Degrees,
    variables: int,
    enough: float | None = None,
    seconds: float = np.inf,
) -> tuple[float, dict[str, Any]] | None:
    """Return the margin of a sum-of-squares proof that a target is positive, and its Gram matrices.

    If the margin is positive, the target is positive where all constraints are >= 0. The margin is
    relative to the largest coefficient of the target. Return None if the solver fails.

    target: the polynomial
    degrees: degrees of the monomials of the target's Gram matrix
    variables: number of variables
    enough: a margin at which the solver may stop, or None to maximize the margin
    seconds: limit of the processor time, s
    """
    size = target.size
    problem = Squares(variables)
    identity = problem.identity(target.scaled(1.0 / size))
    main = problem.subtract(identity, *degrees)
    multipliers = {}
    for name, constraint, multiplied in constraints:
        multipliers[name] = problem.subtract(identity, *multiplied, constraint)
    solution = problem.solve(seconds=seconds, enough=enough)
    if solution is None:
        return None

    def content(gram: Gram) -> dict[str, Any]:
        values = solution.matrix(gram) * size
        return {"degrees": [gram.low, gram.high], "gram": values.tolist()}

    evidence = content(main)
    evidence["multipliers"] = {name: content(gram) for name, gram in multipliers.items()}
    return solution.margin, evidence


#: Largest number of iterations.
_ITERATIONS = 80
#: Gap between the cost and its bound at which the iteration ends.
_TOLERANCE = 1e-9
#: Largest residual of the equations in the result, over their tolerance.
_WORSE = 100.0
#: Length of a step, over that to the boundary of the cone.
_SHARE = 0.95
#: Shorter steps end the iteration.
_SHORTEST_STEP = 1e-4


@dataclass(frozen=True, eq=False)
class Matrix:
    """A matrix Q_k of a group of equations.

    Q_k is the Gram matrix of monomials, and the sum of squares is multiplied by a polynomial.

    products: products of the monomials
    factor: coefficient of each product in each equation, (m, k)
    """

    products: Products
    factor: sp.csr_matrix

    @property
    def size(self) -> int:
        """Number of rows n of the matrix."""
        return self.products.size

    @cached_property
    def equations(self) -> sp.csr_matrix:
        """Linear map A_k from the entries of Q_k to the equations, (m, n²).

        The map is symmetric in the two indices of an entry.
        """
        return (self.factor @ self.products.sums).tocsr()

    @cached_property
    def transposed(self) -> sp.csr_matrix:
        """Transpose of `equations`, (n², m)."""
        return self.equations.T.tocsr()


@dataclass(frozen=True, eq=False)
class Group:
    """Equations E f + Σ_k A_k(Q_k) = b that have matrices in common.

    E: coefficients of the free unknowns f, (m, k)
    b: (m,)
    matrices: each Q_k with its map A_k
    """

    E: np.ndarray
    b: np.ndarray
    matrices: Sequence[Matrix]


@dataclass(frozen=True, eq=False)
class Point:
    """Solution of the semidefinite problem.

    f: free unknowns, (k,)
    matrices: the Q_k of each group, in the order of the groups
    """

    f: np.ndarray
    matrices: list[list[np.ndarray]]


#: Function (cost, bound) -> whether the iteration may end; the cost is inf while the equations
#: are not solved, the bound -inf without a bound.
Enough = Callable[[float, float], bool]


def minimized(
    groups: Sequence[Group],
    cost: np.ndarray,
    *,
    enough: Enough = lambda cost, bound: False,
    tolerance: float = _TOLERANCE,
    seconds: float = np.inf,
) -> Point | None:
    """Return the solution of a semidefinite problem with the least cost, or with a sufficient cost.

    If the time limit or a failed factorization ends the iteration, the cost may be higher. Return
    None if the residual of an equation remains above `_WORSE` times the tolerance.

    groups: groups of equations
    cost: weights c of the free unknowns in the cost c'f, (k,)
    enough: (cost, lower bound of the cost) -> whether the iteration may stop early
    tolerance: largest residual of an equation
    seconds: limit of the processor time, s
    """
    search = _Search(groups, cost, tolerance)
    end = time.process_time() + seconds
    with np.errstate(all="ignore"):  # multipliers grow without bound if there is no solution
        for _ in range(_ITERATIONS):
            if search.done(enough) or time.process_time() > end:
                break
            try:
                moved = search.step()
            except np.linalg.LinAlgError:  # a matrix at the edge of its cone
                break
            if not moved:
                break
    if not search.missing < _WORSE * tolerance:
        return None
    matrices = [[cone.Q for cone in part.cones] for part in search.parts]
    return Point(search.f, matrices)


class _Cone:
    """A matrix Q, its dual matrix Z, and the steps of both in the iteration.

    matrix: Q with its map to the equations
    Q, Z: initial values of Q and Z, as multiples of the identity
    """

    def __init__(self, matrix: Matrix, Q: float, Z: float) -> None:
        self.matrix = matrix
        self.Q = np.eye(matrix.size) * Q
        self.Z = np.eye(matrix.size) * Z
        self.dQ = np.zeros_like(self.Q)
        self.dZ = np.zeros_like(self.Q)
        self.slack = np.zeros_like(self.Q)
        self.target = np.zeros_like(self.Q)

    def adjoint(self, y: np.ndarray) -> np.ndarray:
        """Return Σ_i y_i A_i (n, n) for multipliers y (m,) of the equations."""
        n = self.matrix.size
        return np.asarray((self.matrix.transposed @ y).reshape(n, n))

    def factor(self) -> None:
        """Compute the Cholesky factors of Q and Z, and the inverse of Z."""
        self.root_Q = np.linalg.cholesky(self.Q)
        self.root_Z = np.linalg.cholesky(self.Z)
        inverse = _solved(self.root_Z, np.eye(self.matrix.size))
        self.inverse = inverse.T @ inverse

    def schur(self) -> np.ndarray:
        """Return the matrix (m, m) with entries tr(A_i Z⁻¹ A_j Q)."""
        of_products = self.matrix.products.schur(self.Q, self.inverse)
        factor = self.matrix.factor
        return np.asarray(factor @ (factor @ of_products).T)

    def changed(self, dZ: np.ndarray) -> np.ndarray:
        """Return the change of Q that a change dZ causes, the symmetric part of -Q dZ Z⁻¹."""
        product = self.Q @ dZ @ self.inverse
        return np.asarray(-(product + product.T) / 2)

    def longest_steps(self) -> tuple[float, float]:
        """Return the longest steps that keep Q and Z positive semidefinite."""
        return _longest(self.root_Q, self.dQ), _longest(self.root_Z, self.dZ)


class _Part:
    """State of a group of equations in the iteration.

    The state consists of the matrices Q and Z, the multipliers y and the residuals.

    group: the equations
    Q, Z: initial values of the matrices, as multiples of the identity
    """

    def __init__(self, group: Group, Q: float, Z: float) -> None:
        self.group = group
        self.cones = [_Cone(matrix, Q, Z) for matrix in group.matrices]
        self.y = np.zeros(len(group.b))
        self.dy = np.zeros(len(group.b))

    def measure(self, f: np.ndarray) -> None:
        """Compute the residuals of the equations and of the dual equations Z = -Σ y_i A_i.

        f: free unknowns, (k,)
        """
        self.missing = self.group.b - self.group.E @ f
        for cone in self.cones:
            self.missing = self.missing - cone.matrix.equations @ cone.Q.ravel()
            cone.slack = -cone.adjoint(self.y) - cone.Z

    def factor(self) -> np.ndarray:
        """Factor the sum M of the Schur matrices and return E'M⁻¹E (k, k)."""
        M = np.zeros((len(self.y), len(self.y)))
        for cone in self.cones:
            cone.factor()
            M += cone.schur()
        self._factors = scipy.linalg.cho_factor((M + M.T) / 2, lower=True, check_finite=False)
        self._solved_E = self.solved(self.group.E)
        return np.asarray(self.group.E.T @ self._solved_E)

    def solved(self, sides: np.ndarray) -> np.ndarray:
        """Return M⁻¹ sides, with M the factored Schur matrix."""
        return np.asarray(scipy.linalg.cho_solve(self._factors, sides, check_finite=False))

    def aim(self, product: float, *, corrected: bool) -> np.ndarray:
        """Return E'M⁻¹ r, with r the right side of the equations for a step toward Q Z = product I.

        corrected: whether to include the second-order term of the last step
        """
        self._side = self.missing.copy()
        for cone in self.cones:
            cone.target = product * cone.inverse - cone.Q
            if corrected:
                second = cone.dQ @ cone.dZ @ cone.inverse
                cone.target -= (second + second.T) / 2
            known = cone.target + cone.changed(cone.slack)
            self._side -= cone.matrix.equations @ known.ravel()
        return np.asarray(self._solved_E.T @ self._side)

    def direct(self, df: np.ndarray) -> None:
        """Compute the steps of y, Q and Z for a step df of f."""
        self.dy = self.solved(self._side - self.group.E @ df)
        for cone in self.cones:
            cone.dZ = cone.slack - cone.adjoint(self.dy)
            cone.dQ = cone.target + cone.changed(cone.dZ)


class _Search:
    """State of the iteration: the free unknowns f and all groups of equations."""

    def __init__(self, groups: Sequence[Group], cost: np.ndarray, tolerance: float) -> None:
        self._cost = cost
        self._tolerance = tolerance
        largest = max(float(np.max(np.abs(group.b), initial=1.0)) for group in groups)
        costliest = float(np.max(np.abs(cost), initial=1.0))
        self.parts = [_Part(group, largest, costliest) for group in groups]
        self.f = np.zeros(len(cost))
        self._measure()

    @property
    def _cones(self) -> list[_Cone]:
        return [cone for part in self.parts for cone in part.cones]

    def _measure(self) -> None:
        for part in self.parts:
            part.measure(self.f)
        self._slope = self._cost - sum(part.group.E.T @ part.y for part in self.parts)
        self.missing = max(float(np.abs(part.missing).max()) for part in self.parts)
        slacks = max(float(np.abs(cone.slack).max()) for cone in self._cones)
        self._unbounded = max(slacks, float(np.max(np.abs(self._slope), initial=0.0)))
        self._gap = sum(float(np.sum(cone.Q * cone.Z)) for cone in self._cones)

    def done(self, enough: Enough) -> bool:
        """Return whether the least cost, or a sufficient cost, is reached.

        enough: (cost, lower bound of the cost) -> whether the cost is sufficient
        """
        solved = self.missing < self._tolerance
        bounded = self._unbounded < 10.0 * _TOLERANCE
        if solved and bounded and self._gap < _TOLERANCE:
            return True
        cost = float(self._cost @ self.f) if solved else np.inf
        bound = float(sum(part.group.b @ part.y for part in self.parts)) if bounded else -np.inf
        return enough(cost, bound)

    def step(self) -> bool:
        """Take one step and return whether the step is long enough to continue.

        The step is predicted for Q Z = 0 and corrected for Q Z = σ μ I (Mehrotra). μ is the mean
        eigenvalue of Q Z, and σ follows from the duality gap after the predicted step.
        """
        reduced = np.zeros((len(self.f), len(self.f)))
        for part in self.parts:
            reduced += part.factor()
        factors = scipy.linalg.cho_factor(reduced, lower=True, check_finite=False)
        mean_product = self._gap / sum(cone.matrix.size for cone in self._cones)
        self._direct(factors, 0.0, corrected=False)
        length_Q, length_Z = self._lengths(1.0)
        predicted_gap = sum(
            float(np.sum((cone.Q + length_Q * cone.dQ) * (cone.Z + length_Z * cone.dZ)))
            for cone in self._cones
        )
        centering = float(np.clip((predicted_gap / self._gap) ** 3, 1e-6, 1.0))
        df = self._direct(factors, centering * mean_product, corrected=True)
        length_Q, length_Z = self._lengths(_SHARE)
        self.f = self.f + length_Q * df
        for part in self.parts:
            part.y = part.y + length_Z * part.dy
        for cone in self._cones:
            cone.Q = cone.Q + length_Q * cone.dQ
            cone.Z = cone.Z + length_Z * cone.dZ
        self._measure()
        return max(length_Q, length_Z) > _SHORTEST_STEP

    def _direct(self, factors: object, product: float, *, corrected: bool) -> np.ndarray:
        """Compute the steps of all unknowns toward Q Z = product I, and return the step of f.

        factors: Cholesky factors of the reduced matrix for the step of f
        corrected: whether to include the second-order term of the last step
        """
        side = -self._slope
        for part in self.parts:
            side = side + part.aim(product, corrected=corrected)
        df = scipy.linalg.cho_solve(factors, side, check_finite=False)
        for part in self.parts:
            part.direct(df)
        return np.asarray(df)

    def _lengths(self, share: float) -> tuple[float, float]:
        """Return the step length of all Q and the step length of all Z, at most 1 each.

        share: factor on the longest steps that keep the matrices positive semidefinite
        """
        rooms = np.array([cone.longest_steps() for cone in self._cones])
        to_edge = share * rooms.min(axis=0)
        return min(1.0, float(to_edge[0])), min(1.0, float(to_edge[1]))


def _longest(root: np.ndarray, step: np.ndarray) -> float:
    """Return the largest s with root root' + s step positive semidefinite, inf if there is none."""
    scaled = _solved(root, _solved(root, step).T)
    least = float(np.linalg.eigvalsh((scaled + scaled.T) / 2)[0])
    return np.inf if least >= 0.0 else -1.0 / least


def _solved(root: np.ndarray, sides: np.ndarray) -> np.ndarray:
    """Return root⁻¹ sides for a lower triangular root.

    LAPACK is called directly, because SciPy's `solve_triangular` is ten times slower for small
    matrices.
    """
    return np.asarray(scipy.linalg.lapack.dtrtrs(root.T, sides, lower=0, trans=1)[0])
