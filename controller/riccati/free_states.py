"""States from which the optimal cost of a game is 0, in rational arithmetic.

The entries of a game are doubles, and therefore rational. The states z for which an input u exists
such that z and u cost nothing, and that lead to such states again, are a subspace: the largest
output-nulling one of the cost. If the price of the input is not singular, u is a function of z.
Where the loop of u is stable, the optimal cost is 0, with or without disturbance: what moves inside
the subspace adds no cost to that of the disturbance.

Source: Trentelman, Stoorvogel and Hautus, Control Theory for Linear Systems, Sections 7.3 and 10.4.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from controller.game.zero_sum import Game
from controller.riccati.balls import ball_matrix, identity, midpoints
from controller.riccati.lyapunov import discounted, stability_of
from controller.riccati.rationals import (
    MOST_STATES,
    columns_of,
    disturbance_never_costs,
    echelon,
    null_space,
    rational,
    stacked_rationals,
)

if TYPE_CHECKING:
    from flint import arb_mat, fmpq_mat


class ErrorOnFree(NamedTuple):
    """Error of a gain on states without optimal cost.

    is_wrong: whether K differs there from the optimal gain, in any digit
    without_error: K with the columns of the pivots changed so that it does not, balls
    """

    is_wrong: bool
    without_error: arb_mat


@dataclass(frozen=True, eq=False)
class FreeStates:
    """Subspace of the states without optimal cost, in balls.

    basis: (n, d), with the identity in the rows `pivots`
    gains: optimal gain K times the basis, (m, d)
    pivots: (d,)
    states: the same subspace in rationals, if it is rational
    """

    basis: arb_mat
    gains: arb_mat
    pivots: list[int]
    states: fmpq_mat | None

    def error_of(self, K: arb_mat) -> ErrorOnFree:
        """Return the error of a gain on the states without optimal cost.

        K: (m, n)
        """
        error = K * self.basis - self.gains
        changed = K.tolist()
        for row, errors in zip(changed, error.tolist(), strict=True):
            for pivot, change in zip(self.pivots, errors, strict=True):
                row[pivot] = row[pivot] - change
        is_wrong = not all(entry.contains(0) for entry in error.entries())
        return ErrorOnFree(is_wrong, ball_matrix(changed))


@lru_cache(maxsize=4)
def states_without_cost(game: Game) -> np.ndarray:
    """Return which states reach, in the graph of A, no state with a cost and no unstable block.

    P and K vanish there. Zeros decide it, exactly, and balls whether a block is stable. (n,)
    """
    has_cost = game.Q.any(0) | game.Q.any(1) | game.N.any(1)
    if has_cost.all():
        return np.asarray(~has_cost)
    reaches = (game.A.T != 0.0) | np.eye(len(game.A), dtype=bool)  # [j, i]: state j moves state i
    for _ in range(len(game.A).bit_length()):
        reaches = reaches @ reaches
    has_cost = reaches[:, has_cost].any(1)
    for block in np.unique(reaches & reaches.T, axis=0):
        if not has_cost[block].any():
            alone = discounted(ball_matrix(game.A[np.ix_(block, block)]), game)
            if stability_of(alone, is_discrete=game.is_discrete) is not True:
                has_cost = has_cost | reaches[:, block].any(1)
    return np.asarray(~has_cost)


def disturbance_costs_nothing(game: Game, K: np.ndarray | None = None) -> bool:
    """Return whether all that the disturbance moves is without cost, for u = -K z or the optimum.

    False if the states without optimal cost are not known.

    K: (m, n), which stabilizes; None for the optimal gain
    """
    if not game.E.any():
        return True
    if K is not None:
        return disturbance_never_costs(game, K)
    E = rational(game.E)
    if not game.N.any() and any(entry != 0 for entry in (rational(game.Q) * E).entries()):
        return False
    free = free_states(game)
    if free is None or free.states is None:
        return False
    return bool(stacked_rationals([[free.states, E]]).rank() == free.states.rank())


def free_states(game: Game) -> FreeStates | None:
    """Return the states without optimal cost, or None if there are none or they are not known.

    They are not known for many states, or if an eigenvalue of the loop on the largest
    output-nulling subspace may be on the boundary of stability.
    """
    from flint import fmpq_mat

    n, m = game.B.shape
    if n > MOST_STATES:
        return None
    weights = game.weights
    cost = rational(weights + weights.T)
    A, B = rational(game.A), rational(game.B)
    basis = rational(np.eye(n))
    while True:  # until all states of the basis lead to states of the basis, without cost
        # [z; u; c] with weights [z; u] = 0 and A z + B u = basis c
        zeros = fmpq_mat(n + m, basis.ncols())
        equations = stacked_rationals([[A, B, -1 * basis], [cost, zeros]])
        solutions = null_space(equations)
        states, pivots = _column_echelon(_rows(solutions, range(n)))
        if states.ncols() == basis.ncols() or not states.ncols():
            break
        basis = states
    if not states.ncols() or solutions.ncols() != states.ncols():
        return None
    # z = states c, with the inputs u = inputs c
    to_coordinates = _rows(solutions, pivots).inv()
    inputs = _rows(solutions, range(n, n + m)) * to_coordinates
    loop = _balls(_rows(A * states + B * inputs, pivots))
    stable = _stable_subspace(loop, game)
    if stable is None:
        return None
    free, gains = _balls(states) * stable, -_balls(inputs) * stable
    pivots = _far_from_dependent(midpoints(free))
    to_identity = ball_matrix([free.tolist()[row] for row in pivots]).inv()
    is_rational = stable.ncols() == states.ncols()
    return FreeStates(
        free * to_identity, gains * to_identity, pivots, states if is_rational else None
    )


def _stable_subspace(loop: arb_mat, game: Game) -> arb_mat | None:
    """Return a basis of the states on which √α times a loop is stable, (d, s).

    None if there are none, or if the stability of an eigenvalue is not proved.
    """
    from flint import acb_mat, arb

    one = identity(loop.nrows())
    root = arb(game.discount).sqrt()
    if stability_of(loop * root, is_discrete=game.is_discrete):
        return one
    try:
        values, vectors = acb_mat(loop).eig(right=True)
    except ValueError:  # a multiple eigenvalue
        return None
    margins = [1 - abs(value) * root if game.is_discrete else -value.real for value in values]
    if any(margin.contains(0) for margin in margins):
        return None
    stable = [place for place, margin in enumerate(margins) if margin > 0]
    if not stable:
        return None
    complex_basis = acb_mat([[row[place] for place in stable] for row in vectors.tolist()])
    middle = np.array([[complex(entry) for entry in row] for row in complex_basis.tolist()])
    rows = _far_from_dependent(middle)
    inverse = acb_mat([complex_basis.tolist()[row] for row in rows]).inv()
    # The basis is closed under conjugation; the one with the identity in `rows` is unique: real.
    real = complex_basis * inverse
    return ball_matrix([[entry.real for entry in row] for row in real.tolist()])


def _far_from_dependent(basis: np.ndarray) -> list[int]:
    """Return the numbers of d rows of a basis (n, d) that are far from dependent, (d,)."""
    from scipy.linalg import qr

    order = qr(basis.T, pivoting=True, mode="r")[1]
    return sorted(order[: basis.shape[1]].tolist())


def _balls(matrix: fmpq_mat) -> arb_mat:
    """Return balls that contain the rational entries."""
    from flint import arb

    return ball_matrix([[arb(entry) for entry in row] for row in matrix.tolist()])


def _rows(matrix: fmpq_mat, places: Sequence[int]) -> fmpq_mat:
    """Return the rows of a matrix with these numbers."""
    return columns_of(matrix.transpose(), places).transpose()


def _column_echelon(matrix: fmpq_mat) -> tuple[fmpq_mat, list[int]]:
    """Return a basis of the columns with the identity in some rows, and the places of these."""
    reduced, pivots = echelon(matrix.transpose())
    return _rows(reduced, range(len(pivots))).transpose(), pivots
