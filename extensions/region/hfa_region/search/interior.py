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
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy.linalg
import scipy.sparse as sp

from hfa_region.search.products import Products

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
