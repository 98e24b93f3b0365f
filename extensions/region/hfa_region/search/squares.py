"""Sum-of-squares problems in double precision, with Gram matrices and free unknowns."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import scipy.sparse as sp

from hfa_region.search.function import PolynomialFunction
from hfa_region.search.interior import Group, Matrix, minimized
from hfa_region.search.products import BASE, packed, products_of
from verification.enclosure.polynomial import Polynomial, monomials

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


def positive(
    target: Terms,
    constraints: Sequence[tuple[str, Terms, tuple[int, int]]],
    degrees: tuple[int, int],
    variables: int,
    enough: float | None = None,
) -> tuple[float, dict[str, Any]] | None:
    """Return the margin of a sum-of-squares proof that a target is positive, and its Gram matrices.

    If the margin is positive, the target is positive where all constraints are >= 0. The margin is
    relative to the largest coefficient of the target. Return None if the solver fails.

    target: the polynomial
    constraints: (name, polynomial, lowest and highest degree of its multiplier's monomials)
    degrees: lowest and highest degree of the monomials of the target's Gram matrix
    variables: number of variables
    enough: a margin at which the solver may stop, or None to maximize the margin
    """
    size = target.size
    problem = Squares(variables)
    identity = problem.identity(target.scaled(1.0 / size))
    main = problem.subtract(identity, *degrees)
    multipliers = {}
    for name, constraint, multiplied in constraints:
        multipliers[name] = problem.subtract(identity, *multiplied, constraint)
    solution = problem.solve(enough=enough)
    if solution is None:
        return None

    def content(gram: Gram) -> dict[str, Any]:
        values = solution.matrix(gram) * size
        return {"degrees": [gram.low, gram.high], "gram": values.tolist()}

    evidence = content(main)
    evidence["multipliers"] = {name: content(gram) for name, gram in multipliers.items()}
    return solution.margin, evidence
