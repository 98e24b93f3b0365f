"""Bases of critics: monomials ψ(z), their gradients, and conversion between weights W and P."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from itertools import combinations_with_replacement

import numpy as np

from controller.game.zero_sum import Game
from hfa_support.cached import cached_property
from hfa_support.errors import BadInputError, refuse_unknown
from hfa_support.matrices import LARGEST, checked_matrix, shape_text
from hfa_support.reporting.report import Reported

#: Indices (from 0) of the states whose fourth powers complete the paper's M = 25: the three tracked
#: states and the pitch rate, which has the strongest coupling in Section 5.1. This is an
#: assumption, because the paper prints M but not its basis.
PAPER_QUARTIC_CHANNELS = (0, 1, 3, 4)
#: Number of states of the paper's linear model.
PAPER_STATES = 6


@dataclass(frozen=True, eq=False, repr=False)
class Basis(Reported):
    """Basis ψ_m(z) = Π_i z_i^exponents[m, i] of V(z) = W'ψ(z) (paper Section 3.2).

    name: name of the basis, as in `BASES`
    exponents: (M, n), nonnegative integers; the first n(n+1)/2 rows belong to z_i z_j for i <= j,
        with j varying fastest
    """

    name: str
    exponents: np.ndarray

    @property
    def size(self) -> int:
        """Number M of weights."""
        return int(self.exponents.shape[0])

    @property
    def states(self) -> int:
        """Number n of states."""
        return int(self.exponents.shape[1])

    @property
    def quadratic_size(self) -> int:
        """Number of quadratic monomials, n(n+1)/2, with which the basis begins."""
        return self.states * (self.states + 1) // 2

    @cached_property
    def _upper_triangle(self) -> tuple[np.ndarray, np.ndarray]:
        """Rows and columns of the entries ij, i <= j, of a matrix P, in the order of z_i z_j."""
        return np.triu_indices(self.states)

    @cached_property
    def _factors(self) -> tuple[np.ndarray, np.ndarray]:
        """Numbers of the states in each monomial, and their powers, (M, k) each.

        k is the most states in one monomial; a monomial of fewer has others with the power 0.
        """
        most = int(np.count_nonzero(self.exponents, axis=1).max())
        factors = np.argsort(self.exponents == 0, axis=1, kind="stable")[:, :most]
        return factors, np.take_along_axis(self.exponents, factors, axis=1)

    def psi(self, z: np.ndarray) -> np.ndarray:
        """Return ψ(z), (..., M), for z (..., n)."""
        factors, powers = self._factors  # of each monomial: numbers of its states, and their powers
        return np.asarray(np.prod(z[..., factors] ** powers, axis=-1))

    def gradient(self, z: np.ndarray) -> np.ndarray:
        """Return ∂ψ/∂z, (..., M, n), for z (..., n)."""
        factors, powers = self._factors
        slopes = np.zeros((*z.shape[:-1], self.size, self.states))
        rows = np.arange(self.size)
        for column in range(factors.shape[1]):
            # d/dz_i of z_i^p z_j^q is p z_i^(p - 1) z_j^q, for the states i of one column.
            lowered = powers.copy()
            lowered[:, column] = np.maximum(powers[:, column] - 1, 0)
            slope = powers[:, column] * np.prod(z[..., factors] ** lowered, axis=-1)
            slopes[..., rows, factors[:, column]] += slope
        return slopes

    def matrix(self, weights: np.ndarray) -> np.ndarray:
        """Return the symmetric P (n, n) of the quadratic part z'Pz of W'ψ(z).

        P_ii is the weight of z_i². P_ij is half the weight of z_i z_j.
        """
        P = np.zeros((self.states, self.states))
        P[self._upper_triangle] = 0.5 * np.asarray(weights)[: self.quadratic_size]
        return P + P.T  # the diagonal is added twice

    def weights(self, P: np.ndarray) -> np.ndarray:
        """Return the weights W (M,) with W'ψ(z) = z'Pz.

        P: (n, n), symmetric
        """
        weights = np.zeros(self.size)  # z_i z_j with i < j is there twice in z'P z
        weights[: self.quadratic_size] = (2.0 * P - np.diag(np.diag(P)))[self._upper_triangle]
        return weights

    def scaling(self, scales: np.ndarray) -> np.ndarray:
        """Return the factors s (M,) with ψ(diag(scales) y) = s * ψ(y).

        If W are the weights in z, the weights in the coordinates y = z / scales are s * W.

        scales: (n,)
        """
        return np.prod(np.asarray(scales, dtype=float) ** self.exponents, axis=-1)


def basis(name: str, states: int) -> Basis:
    """Return a basis for the given number of states.

    - "quadratic": z_i z_j for i <= j, M = n(n+1)/2
    - "cubic", "quartic", "quintic": also all monomials of degree 3, of 3 and 4, of 3, 4 and 5
    - "quadratic+linear": also z_i
    - "quadratic+quartic": also z_i⁴
    - "paper": for six states, also z_i⁴ of the four states `PAPER_QUARTIC_CHANNELS`

    The paper does not state which four states its basis uses. `PAPER_QUARTIC_CHANNELS` is an
    assumption.

    name: one of these names
    states: number of states n

    Raises BadInputError for an unknown name, for no state, and for "paper" without six states.

    >>> from controller import basis
    >>> basis("quadratic", 6).size
    21
    """
    refuse_unknown("unknown basis", name, BASES)
    if states < 1:
        raise BadInputError(f"a basis of {states} states does not exist; give at least 1 state")
    unit = np.eye(states, dtype=int)
    row, column = np.triu_indices(states)
    exponents = np.vstack([unit[row] + unit[column], BASES[name](states)])
    exponents.setflags(write=False)
    return Basis(name, exponents)


def _paper(states: int) -> np.ndarray:
    """Return the exponents (4, 6) of the fourth powers in the basis "paper"."""
    if states != PAPER_STATES:
        raise BadInputError(
            f"basis 'paper' requires {PAPER_STATES} states, not {states}; choose 'quadratic'"
        )
    return 4 * np.eye(states, dtype=int)[list(PAPER_QUARTIC_CHANNELS)]


def monomials(states: int, degree: int) -> np.ndarray:
    """Return the exponents (M, n) of all monomials of a degree, with the last index fastest."""
    combinations = combinations_with_replacement(range(states), degree)
    return np.array([np.bincount(indices, minlength=states) for indices in combinations])


def _beyond_quadratic(states: int, *, degree: int) -> np.ndarray:
    """Return the exponents (M, n) of all monomials of degree 3 up to a degree."""
    return np.vstack([monomials(states, d) for d in range(3, degree + 1)])


#: Degree -> name of the basis with all monomials from degree 2.
TO_DEGREE = {2: "quadratic", 3: "cubic", 4: "quartic", 5: "quintic"}
#: Name of a basis -> exponents of the monomials that it adds to the quadratic ones.
BASES: dict[str, Callable[[int], np.ndarray]] = {
    "quadratic": lambda states: np.zeros((0, states), dtype=int),
    **{TO_DEGREE[d]: partial(_beyond_quadratic, degree=d) for d in (3, 4, 5)},
    "quadratic+linear": lambda states: np.eye(states, dtype=int),
    "quadratic+quartic": lambda states: 4 * np.eye(states, dtype=int),
    "paper": _paper,
}


def bases_of_size(size: int, states: int) -> list[str]:
    """Return the names of the bases with this number of functions of the given number of states."""
    names = [name for name in BASES if name != "paper" or states == PAPER_STATES]
    return [name for name in names if basis(name, states).size == size]


#: Asymmetry of H relative to its largest entry that rounding to six printed digits explains.
_ROUNDED = 1e-6


def q_extremum(game: Game, H: np.ndarray) -> dict[str, np.ndarray]:
    """Return P, K and L, name -> matrix, at the extremum of a Q-function over u and w.

      [K; -L] = H_aa⁻¹ H_ax,  P = H_xx - H_xa H_aa⁻¹ H_ax,  a = (u, w)

    L is omitted if H is over (x, u).

    H: symmetric matrix of the Q-function, over (x, u, w) or (x, u). With δ = inf, only over (x,
        u).

    Raises BadInputError if H has a wrong shape or is not symmetric, or if H_aa is singular.
    """
    n, m = game.B.shape
    shapes = {"(x, u)": (n + m,) * 2}
    if math.isfinite(game.delta):
        shapes["(x, u, w)"] = (n + m + game.E.shape[1],) * 2
    H = checked_matrix("H", H, LARGEST)
    if H.shape not in shapes.values():
        rules = [f"{shape_text(shape)} over {vectors}" for vectors, shape in shapes.items()]
        raise BadInputError(f"H is {shape_text(H.shape)}; give {' or '.join(rules)}")
    if np.abs(H - H.T).max() > _ROUNDED * np.abs(H).max():
        raise BadInputError("H is not symmetric; give (H + H')/2")
    try:
        gains = np.linalg.solve(H[n:, n:], H[n:, :n])
    except np.linalg.LinAlgError as error:
        raise BadInputError(
            "the block of H over the inputs is singular, so no optimal input exists; correct H"
        ) from error
    parts = {"P": H[:n, :n] - H[:n, n:] @ gains, "K": gains[:m]}
    if len(H) > n + m:
        parts["L"] = -gains[m:]
    return parts
