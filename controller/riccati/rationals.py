"""Facts about games that only exact arithmetic decides, in rationals of FLINT.

The entries of a game are doubles, which are rationals (`fmpq`, matrices `fmpq_mat`, polynomials
`fmpq_poly`, or `fmpz_poly` with integers). Whether weights are positive semidefinite, whether a
mode is not reached at all, or has no cost at all, are facts on a boundary, which no ball decides.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import lru_cache
from itertools import chain
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from controller.game.zero_sum import Game
from controller.riccati.balls import ball_matrix, block_entries
from controller.riccati.lyapunov import discounted, stability_of

if TYPE_CHECKING:
    from flint import acb, fmpq, fmpq_mat, fmpz_poly


#: A prime: a matrix that has a rank modulo it has at least this rank in rationals.
PRIME = 2**61 - 1
#: Largest number of states that are decided in rationals, which takes seconds.
MOST_STATES = 50


def rational(matrix: np.ndarray) -> fmpq_mat:
    """Return the exact matrix of doubles."""
    from flint import fmpq, fmpq_mat

    return fmpq_mat([[fmpq(*entry.as_integer_ratio()) for entry in row] for row in matrix.tolist()])


class RationalGame(NamedTuple):
    """Exact matrices of a game, with the symmetric parts of Q and R."""

    A: fmpq_mat
    B: fmpq_mat
    E: fmpq_mat
    Q: fmpq_mat
    R: fmpq_mat
    N: fmpq_mat

    @classmethod
    def of(cls, game: Game) -> RationalGame:
        """Return the exact matrices of a game."""
        A, B, E, Q, R, N = map(rational, (game.A, game.B, game.E, game.Q, game.R, game.N))
        return cls(A, B, E, (Q + Q.transpose()) / 2, (R + R.transpose()) / 2, N)

    @property
    def without_cross_weights(self) -> RationalGame:
        """The same game with the input v = u + R⁻¹N' z; R must not be singular."""
        over_R = self.R.solve(self.N.transpose())
        return self._replace(A=self.A - self.B * over_R, Q=self.Q - self.N * over_R, N=0 * self.N)


def unreachable_modes(A: fmpq_mat, B: fmpq_mat) -> fmpz_poly | None:
    """Return the characteristic polynomial of the modes of A that B does not reach, None for none.

    A: (n, n)
    B: (n, m)
    """
    from flint import fmpq_mat

    n = A.nrows()
    if _reaches_all_modulo_prime(A, B):
        return None
    reached, A_power_B = B, B
    rank = reached.rank()
    for _ in range(n):
        A_power_B = A * A_power_B
        with_next_power = fmpq_mat(block_entries([[reached, A_power_B]]))
        _, pivots = echelon(with_next_power)
        if len(pivots) == rank:
            break
        reached, rank = columns_of(with_next_power, pivots), len(pivots)
    if rank == n:
        return None
    # The rows L with L B = L A B = ... = 0 span an invariant subspace: L A = F L, with the
    # modes of F. In some columns, L is square and not singular.
    L = null_space(reached.transpose()).transpose()
    _, pivots = echelon(L)
    F = columns_of(L * A, pivots) * columns_of(L, pivots).inv()
    return F.charpoly().numer()


def _reaches_all_modulo_prime(A: fmpq_mat, B: fmpq_mat) -> bool:
    """Return whether [B AB A²B ...] has the rank n modulo a prime: True proves it in rationals."""
    from flint import nmod_mat

    def modulo(matrix: fmpq_mat) -> nmod_mat:
        entries = [int(e.p) * pow(int(e.q), -1, PRIME) % PRIME for e in matrix.entries()]
        return nmod_mat(matrix.nrows(), matrix.ncols(), entries, PRIME)

    try:
        step, block = modulo(A), modulo(B)
    except ValueError:  # the prime divides a denominator
        return False
    n = A.nrows()
    reached: list[Any] = []
    for _ in range(n):
        reached += chain.from_iterable(block.transpose().tolist())  # columns as rows
        if nmod_mat(len(reached) // n, n, reached, PRIME).rank() == n:
            return True
        block = step * block
    return False


def echelon(matrix: fmpq_mat) -> tuple[fmpq_mat, list[int]]:
    """Return the reduced row echelon form, and the numbers of its pivot columns, (rank,)."""
    reduced, rank = matrix.rref()
    rows = reduced.tolist()[: int(rank)]
    return reduced, [next(j for j, entry in enumerate(row) if entry != 0) for row in rows]


def columns_of(matrix: fmpq_mat, places: Sequence[int]) -> fmpq_mat:
    """Return the columns of a matrix with these numbers."""
    from flint import fmpq_mat

    rows = matrix.tolist()
    return fmpq_mat(len(rows), len(places), [row[j] for row in rows for j in places])


def null_space(matrix: fmpq_mat) -> fmpq_mat:
    """Return a basis of the vectors v with M v = 0, in columns, (n, n - rank)."""
    from flint import fmpq_mat

    reduced, pivots = echelon(matrix)
    free = [j for j in range(matrix.ncols()) if j not in pivots]
    basis = fmpq_mat(matrix.ncols(), len(free))
    for place, j in enumerate(free):
        basis[j, place] = 1
        for i, pivot in enumerate(pivots):
            basis[pivot, place] = -reduced[i, j]
    return basis


def unstable_root(polynomial: fmpz_poly, discount: float, *, is_discrete: bool) -> complex | None:
    """Return a root that is proved not to be stable, the one with the largest growth, or None.

    discount: its root is a factor of the roots in discrete time, before they are compared with 1.
        Roots on the boundary are found only with the discount 1: they are decided exactly.
    """
    from flint import arb

    growth, beyond_boundary = arb(discount).sqrt(), {}
    for root in _roots(polynomial):
        distance = abs(root) * growth - 1 if is_discrete else root.real
        if distance > 0:
            beyond_boundary[complex(root)] = float(distance.mid())
    if beyond_boundary:
        return max(beyond_boundary, key=beyond_boundary.__getitem__)
    return boundary_root(polynomial, is_discrete=is_discrete) if discount == 1.0 else None


def _roots(polynomial: fmpz_poly) -> list[acb]:
    """Return the distinct roots, isolated in balls."""
    with_multiplicities: Any = polynomial.complex_roots()
    return [root for root, _ in with_multiplicities]


def boundary_root(polynomial: fmpz_poly, *, is_discrete: bool) -> complex | None:
    """Return a root that is proved to be on the boundary of stability, or None.

    Such a root r is its own mirror image -r̄, in discrete time 1 / r̄. The roots that p(s) has in
    common with p(-s), or p(z) with z^n p(1/z), are the mirror images of one another: one in whose
    image is no other one is its own.
    """
    from flint import fmpz_poly

    coefficients = polynomial.coeffs()
    mirrored = coefficients[::-1]
    if not is_discrete:
        mirrored = [entry * (-1) ** power for power, entry in enumerate(coefficients)]
    roots = _roots(polynomial.gcd(fmpz_poly(mirrored)))
    for root in roots:
        image = 1 / root.conjugate() if is_discrete else -root.conjugate()
        if [other is root for other in roots if image.overlaps(other)] == [True]:
            return complex(root) if is_discrete else complex(0.0, complex(root).imag)
    return None


def rational_root(value: float) -> fmpq | None:
    """Return the root of a double if it is rational, or None."""
    from flint import fmpq

    numerator, denominator = value.as_integer_ratio()
    # Of a fraction in lowest terms, both roots must be integers.
    of_numerator, of_denominator = math.isqrt(numerator), math.isqrt(denominator)
    is_exact = of_numerator**2 == numerator and of_denominator**2 == denominator
    return fmpq(of_numerator, of_denominator) if is_exact else None


def states_without_cost(game: Game) -> np.ndarray:
    """Return which states, (n,), lead to no state with a cost and to no unstable block of A.

    P and K vanish on these states. Zeros of the entries decide what is reached, and balls whether a
    block of states that reach one another is stable.
    """
    has_cost: np.ndarray = np.asarray(game.Q.any(0) | game.Q.any(1) | game.N.any(1))
    return np.asarray(~has_cost) if has_cost.all() else _without_cost(game)


@lru_cache(maxsize=4)
def _without_cost(game: Game) -> np.ndarray:
    """Return `states_without_cost` where some states have no cost of their own, (n,)."""
    has_cost = np.asarray(game.Q.any(0) | game.Q.any(1) | game.N.any(1))
    reaches = _connected(game.A.T)  # [j, i]: state j moves state i
    has_cost = np.asarray(reaches[:, has_cost].any(1))
    for block in np.unique(reaches & reaches.T, axis=0):
        if not has_cost[block].any():
            alone = discounted(ball_matrix(game.A[np.ix_(block, block)]), game)
            if stability_of(alone, is_discrete=game.is_discrete) is not True:
                has_cost = np.asarray(has_cost | reaches[:, block].any(1))
    return np.asarray(~has_cost)


def _connected(graph: np.ndarray) -> np.ndarray:
    """Return whether a path leads from node i to node j of a graph, (n, n)."""
    paths = (graph != 0.0) | np.eye(len(graph), dtype=bool)
    for _ in range(len(graph).bit_length()):  # each step doubles the length of the paths
        paths = paths @ paths
    return np.asarray(paths)


class Zeros(NamedTuple):
    """Which numbers are proved to be 0: whole rows of P, (n,), and entries of K, (m, n)."""

    states: np.ndarray
    gains: np.ndarray


@lru_cache(maxsize=4)
def zeros_of(game: Game) -> Zeros:
    """Return which numbers of P and K are 0 because entries of the game are 0.

    False proves nothing.
    """
    states = states_without_cost(game)
    gains = np.zeros(game.N.T.shape, dtype=bool)
    gains[:, states] = True
    # Inputs that move only states without cost, have no cross weights, and that R does not couple
    # to other inputs, are 0.
    unused = ~game.B[~states].any(0) & ~game.N.any(0)
    if not (game.R[np.ix_(unused, ~unused)].any() or game.R[np.ix_(~unused, unused)].any()):
        gains[unused] = True
    return Zeros(states, gains)


def disturbance_costs_nothing(game: Game, K: np.ndarray | None = None) -> bool:
    """Return whether the disturbance moves only states that entries of 0 show to be without cost,
    for u = -K z or the optimum.

    K: (m, n), which stabilizes; None for the optimal gain, which is 0 on these states
    """
    free = states_without_cost(game)
    return not (game.E[~free].any() or (K is not None and K[:, free].any()))
