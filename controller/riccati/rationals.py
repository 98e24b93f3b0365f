"""Facts about games that only exact arithmetic decides, in rationals of FLINT.

The entries of a game are doubles, which are rationals (`fmpq`, matrices `fmpq_mat`, polynomials
`fmpq_poly`, or `fmpz_poly` with integers). Whether weights are positive semidefinite, whether a
mode is not reached at all, or has no cost at all, are facts on a boundary, which no ball decides.
"""

from __future__ import annotations

from functools import lru_cache
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from controller.game.zero_sum import Game
from controller.riccati.balls import ball_matrix, block_entries
from controller.riccati.lyapunov import discounted, stability_of

if TYPE_CHECKING:
    from flint import acb, fmpq_mat, fmpz_poly


#: Bound of the integer gains by which modes are moved.
MOST_OF_GAIN = 1000
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


def unreachable_modes(A: fmpq_mat, B: fmpq_mat) -> fmpz_poly:
    """Return the characteristic polynomial of the modes of A that B does not reach.

    No gain K moves these modes: their polynomial divides that of A - B K for each K, and is the
    common divisor if its degree is what the rank of [B AB A²B ...] leaves.

    A: (n, n)
    B: (n, m)
    """
    from flint import fmpq_mat

    n, m = A.nrows(), B.ncols()
    modes, numbers = A.charpoly().numer(), np.random.default_rng(0)
    while True:
        K = fmpq_mat(m, n, numbers.integers(-MOST_OF_GAIN, MOST_OF_GAIN, m * n).tolist())
        modes = modes.gcd((A - B * K).charpoly().numer())
        if modes.degree() == 0 or modes.degree() == n - _number_of_reached(A, B):
            return modes


def _number_of_reached(A: fmpq_mat, B: fmpq_mat) -> int:
    """Return the rank of [B AB A²B ...]."""
    from flint import fmpq_mat

    reached, power, before = B, B, 0
    while (rank := reached.rank()) > before:
        before, power = rank, A * power
        reached = fmpq_mat(block_entries([[reached, power]]))
    return rank


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
    n = len(graph)
    return np.linalg.matrix_power((graph != 0.0) | np.eye(n, dtype=bool), n)


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
