"""Sums of squares in floating point: problems for Clarabel, in Gram matrices and free numbers."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cache, lru_cache
from typing import Any

import numpy as np
import scipy.sparse as sp

from hfa_region.check.polynomial import Polynomial, exponents_of, monomials
from hfa_region.search.function import PolynomialFunction

#: Base of the exponents in one whole number.
_BASE = 16
#: Largest margin that is asked of a Gram matrix, of a target whose largest coefficient is 1.
_MOST_MARGIN = 1e-3
#: Of a root of the solver.
_TOLERANCE = 1e-9


@dataclass(frozen=True, eq=False)
class Terms:
    """Σ coefficient y^exponents in doubles.

    keys: exponents in one number, Σ α_i 16^i
    values: coefficients
    """

    keys: np.ndarray
    values: np.ndarray

    @classmethod
    def of(cls, polynomial: Polynomial) -> Terms:
        """The midpoints of a polynomial of balls."""
        keys = []
        values = []
        for key, _, coefficient in polynomial.terms():
            keys.append(_packed(key))
            values.append(float(coefficient.mid()))
        return cls(np.array(keys, dtype=np.int64), np.array(values, dtype=float))

    @classmethod
    def packed(cls, V: PolynomialFunction) -> Terms:
        """A polynomial of exponents in rows."""
        base = _BASE ** np.arange(V.exponents.shape[1], dtype=np.int64)
        return cls(V.exponents.astype(np.int64) @ base, V.coefficients)

    def __add__(self, other: Terms) -> Terms:
        keys = np.concatenate([self.keys, other.keys])
        return Terms(keys, np.concatenate([self.values, other.values]))

    def scaled(self, factor: float) -> Terms:
        """The polynomial times a number."""
        return Terms(self.keys, self.values * factor)

    @property
    def size(self) -> float:
        """The largest absolute value of a coefficient."""
        return float(np.max(np.abs(self.values), initial=0.0))


@cache
def _packed(key: int) -> int:
    return sum(power * _BASE**i for i, power in enumerate(exponents_of(key)))


@lru_cache(maxsize=64)
def packed_monomials(variables: int, low: int, high: int) -> np.ndarray:
    """The keys of `monomials`, in their order."""
    return np.array([_packed(key) for key in monomials(variables, low, high)], dtype=np.int64)


@dataclass(eq=False)
class Gram:
    """One matrix of a problem.

    low, high: degrees of its monomials
    size: number of them
    start: first of its entries among the unknowns: the lower triangle, row by row
    margin: whether it shall be positive definite with the margin
    """

    low: int
    high: int
    size: int
    start: int
    margin: bool


@dataclass(eq=False)
class Identity:
    """Coefficients of a polynomial that must be 0: Σ value x_column + constant.

    keys, columns, values: parallel, of the unknowns
    constants: what is without unknowns
    """

    keys: list[np.ndarray] = field(default_factory=list)
    columns: list[np.ndarray] = field(default_factory=list)
    values: list[np.ndarray] = field(default_factory=list)
    constants: list[Terms] = field(default_factory=list)


class Squares:
    """A problem in Gram matrices and free numbers; the margin is unknown 0.

    variables: of the polynomials
    """

    def __init__(self, variables: int) -> None:
        self.variables = variables
        self._count = 1
        self._grams: list[Gram] = []
        self._identities: list[Identity] = []
        self._costs: dict[int, float] = {}

    def free(self, count: int) -> np.ndarray:
        """Columns of new unknowns of any sign."""
        start = self._count
        self._count += count
        return np.arange(start, self._count)

    def gram(self, low: int, high: int, *, margin: bool = True) -> Gram:
        """A new positive semidefinite matrix."""
        size = len(monomials(self.variables, low, high))
        gram = Gram(low, high, size, self._count, margin)
        self._count += size * (size + 1) // 2
        self._grams.append(gram)
        return gram

    def identity(self, target: Terms) -> Identity:
        """target + .. = 0, to which others are added."""
        identity = Identity(constants=[target])
        self._identities.append(identity)
        return identity

    def subtract(self, identity: Identity, gram: Gram, factor: Terms | None = None) -> None:
        """Add -m'Q m factor to an identity."""
        keys = packed_monomials(self.variables, gram.low, gram.high)
        rows, columns = np.tril_indices(gram.size)
        pairs = keys[rows] + keys[columns]
        weights = np.where(rows == columns, 1.0, 2.0)
        unknowns = gram.start + np.arange(len(rows))
        if factor is None:
            factor = Terms(np.zeros(1, dtype=np.int64), np.ones(1))
        for key, value in zip(factor.keys, factor.values, strict=True):
            self.add(identity, pairs + key, unknowns, -weights * value)
            if gram.margin:
                diagonal = pairs[rows == columns] + key
                margin = np.zeros(len(diagonal), dtype=np.int64)
                self.add(identity, diagonal, margin, np.full(len(diagonal), -value))

    def add(
        self, identity: Identity, keys: np.ndarray, columns: np.ndarray, values: np.ndarray
    ) -> None:
        """Add value x_column y^key to an identity."""
        identity.keys.append(keys)
        identity.columns.append(columns)
        identity.values.append(values)

    def cost(self, columns: np.ndarray, values: np.ndarray) -> None:
        """Add Σ value x_column to what is made as small as can be; by default the margin is made
        large."""
        for column, value in zip(columns.tolist(), values.tolist(), strict=True):
            self._costs[column] = self._costs.get(column, 0.0) + value

    def solve(self, margin: float | None = None, seconds: float = 600.0) -> Solution | None:
        """The best unknowns; None where the solver finds none.

        margin: that of the Gram matrices, instead of the largest
        seconds: longest time
        """
        import clarabel

        A, b = self._equalities()
        equalities = A.shape[0]
        ends = [(0, _MOST_MARGIN, 1.0)]
        if margin is not None:
            ends = [(0, margin, 1.0), (0, -margin, -1.0)]
        rows = sp.coo_matrix(
            ([sign for *_, sign in ends], (range(len(ends)), [0] * len(ends))),
            shape=(len(ends), self._count),
        )
        blocks = [A, rows]
        bounds = [b, np.array([end for _, end, _ in ends])]
        cones: list[Any] = [
            clarabel.ZeroConeT(equalities),
            clarabel.NonnegativeConeT(len(ends)),
        ]
        for gram in self._grams:
            blocks.append(_cone_rows(gram, self._count))
            bounds.append(np.zeros(blocks[-1].shape[0]))
            cones.append(clarabel.PSDTriangleConeT(gram.size))
        q = np.zeros(self._count)
        if self._costs:
            q[list(self._costs)] = list(self._costs.values())
        else:
            q[0] = -1.0
        settings = clarabel.DefaultSettings()
        settings.verbose = False
        settings.time_limit = seconds
        settings.max_threads = 1
        settings.tol_gap_abs = settings.tol_gap_rel = settings.tol_feas = _TOLERANCE
        zero = sp.csc_matrix((self._count, self._count))
        whole = sp.csc_matrix(sp.vstack(blocks))
        result = clarabel.DefaultSolver(
            zero, q, whole, np.concatenate(bounds), cones, settings
        ).solve()
        if str(result.status) not in ("Solved", "AlmostSolved", "InsufficientProgress"):
            return None
        return Solution(np.array(result.x), str(result.status))

    def _equalities(self) -> tuple[sp.coo_matrix, np.ndarray]:
        """A x = b, a row for each coefficient of each identity."""
        matrices = []
        sides = []
        for identity in self._identities:
            constant = identity.constants[0]
            for more in identity.constants[1:]:
                constant = constant + more
            keys = np.concatenate([*identity.keys, constant.keys])
            known, place = np.unique(keys, return_inverse=True)
            count = len(keys) - len(constant.keys)
            columns = np.concatenate(identity.columns)
            values = np.concatenate(identity.values)
            shape = (len(known), self._count)
            matrices.append(sp.coo_matrix((values, (place[:count], columns)), shape=shape))
            side = np.zeros(len(known))
            np.subtract.at(side, place[count:], constant.values)
            sides.append(side)
        return sp.vstack(matrices), np.concatenate(sides)


@dataclass(frozen=True, eq=False)
class Solution:
    """Unknowns of a problem.

    x: their values
    status: of the solver
    """

    x: np.ndarray
    status: str

    @property
    def margin(self) -> float:
        """Of all Gram matrices."""
        return float(self.x[0])

    def matrix(self, gram: Gram) -> np.ndarray:
        """A Gram matrix, its margin in it."""
        rows, columns = np.tril_indices(gram.size)
        values = np.zeros((gram.size, gram.size))
        values[rows, columns] = self.x[gram.start : gram.start + len(rows)]
        values[columns, rows] = values[rows, columns]
        if gram.margin:
            values += self.margin * np.eye(gram.size)
        return values


@lru_cache(maxsize=64)
def _cone_entries(size: int) -> tuple[np.ndarray, np.ndarray]:
    """The lower triangle row by row is the upper triangle column by column: weights of each."""
    rows, columns = np.tril_indices(size)
    return np.arange(len(rows)), np.where(rows == columns, 1.0, np.sqrt(2.0))


def _cone_rows(gram: Gram, count: int) -> sp.coo_matrix:
    """-svec(Q), so that 0 - A x is in the cone."""
    places, weights = _cone_entries(gram.size)
    return sp.coo_matrix((-weights, (places, gram.start + places)), shape=(len(places), count))


def positive(
    target: Terms,
    constraints: Sequence[tuple[str, Terms, tuple[int, int]]],
    degrees: tuple[int, int],
    variables: int,
) -> tuple[float, dict[str, Any]] | None:
    """The margin with which a target is a sum of squares where the constraints are not negative,
    and the Gram matrices; None where the solver fails.

    target: polynomial
    constraints: name, polynomial and the degrees of the monomials of its multiplier
    degrees: of the monomials of the target's Gram matrix
    variables: of the polynomials

    The margin is relative to the largest coefficient of the target.
    """
    size = target.size
    problem = Squares(variables)
    main = problem.gram(*degrees)
    identity = problem.identity(target.scaled(1.0 / size))
    problem.subtract(identity, main)
    multipliers = {}
    for name, constraint, (low, high) in constraints:
        gram = problem.gram(low, high)
        problem.subtract(identity, gram, constraint)
        multipliers[name] = gram
    solution = problem.solve()
    if solution is None:
        return None
    content = square_content(main, solution.matrix(main) * size)
    content["multipliers"] = {
        name: square_content(gram, solution.matrix(gram) * size)
        for name, gram in multipliers.items()
    }
    return solution.margin, content


def square_content(gram: Gram, values: np.ndarray) -> dict[str, Any]:
    """A Gram matrix as a witness has it."""
    return {"degrees": [gram.low, gram.high], "gram": values.tolist()}
