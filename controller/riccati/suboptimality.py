"""Cost of a linear policy above the optimum, enclosed in balls.

The suboptimality z'D z of u = -K z is no difference of two costs. With the error Δ = K - K* of the
gain, the loop F = A - B K + E L* and the slack V of the disturbance, D is the stabilizing solution
of

  F'D + D F + Δ'R Δ + D E V⁻¹ E'D = 0,  V = δ² I,

and in discrete time, with √α A, √α B and √α E in place of A, B and E, of

  F'D F - D + Δ'(R + B'P B) Δ + M'(V - E'D E)⁻¹ M = 0,  M = E'D F - E'P B Δ,  V = δ² I - E'P E.

z'D z is the value of a loop (`DisturbedLoop`): it exists if the L2 gain of the policy is below δ.
The policy costs up to sup z'D z / z'P z above the optimum.

Sources: Kleinman, IEEE Transactions on Automatic Control 13 (1968), 114-115; Basar and Bernhard,
H-infinity Optimal Control, Theorem 4.11.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from controller.game.zero_sum import Game
from controller.riccati.balls import (
    ATTEMPTS,
    ROUNDOFF,
    ball_matrix,
    identity,
    is_positive_definite,
    midpoints,
    precision,
    symmetric,
    symmetric_part,
)
from controller.riccati.closed_loops import ClosedLoops
from controller.riccati.enclosure import Enclosure, enclosed_in_bits, has_indefinite_weights
from controller.riccati.l2_gain import LoopValue
from controller.riccati.lyapunov import (
    FailedError,
    NotProvedError,
    discounted,
    loop_with,
    stability_of,
)
from controller.riccati.rationals import FreeStates, free_states

if TYPE_CHECKING:
    from flint import arb_mat


#: Relative width of an enclosure that shows three digits, in all but ties.
THREE_DIGITS = 1e-6
#: A cost that is higher by less than this fraction is the same double.
SAME_DOUBLE = ROUNDOFF
#: Steps in which an upper bound is sought above the estimate, as powers of ten.
_POWERS_ABOVE = range(-12, -5)


@dataclass(frozen=True, eq=False)
class Suboptimality:
    """Cost of u = -K z above the optimum, under the worst disturbance of the policy.

    low, high: bounds of the largest suboptimality of a state, relative to its optimal cost.
        Both are inf if it is proved that the cost has no bound, or is positive where the optimum
        is 0; high alone is inf if no bound is proved.
    mean: mean suboptimality over initial states with the same optimal cost, relative to it
    worst: initial state with the suboptimality `low`, at the edge of the box, (n,); nan without one
    matrix: D, (n, n), or None without a bounded cost
    disturbance_gain: (k, n), of the worst disturbance of the policy, minus that of the optimum
    is_stable: whether A - B K is proved stable
    is_summable: whether √α (A - B K), in continuous time A - B K, is proved stable
    from_free: cost from a state of the box where the optimum is 0, the largest of those tried; it
        counts unless the cost of the box is the same double without it
    free_state: this state, (n,), or None without such a cost
    is_relative: False if the weights are indefinite: in place of the optimal cost of each state is
        then the largest one, in magnitude, of the ellipsoid within the box
    """

    low: float
    high: float
    mean: float
    worst: np.ndarray
    matrix: np.ndarray | None
    disturbance_gain: np.ndarray
    is_stable: bool
    is_summable: bool
    from_free: float = 0.0
    free_state: np.ndarray | None = None
    is_relative: bool = True

    @property
    def is_known(self) -> bool:
        """True if the bounds show three digits, or show that the policy is optimal."""
        if math.isinf(self.low):
            return True
        return self.is_optimal or self.high <= self.low * (1.0 + THREE_DIGITS)

    @property
    def is_optimal(self) -> bool:
        """True if no initial state has a cost that differs from the optimum as a double."""
        return self.high <= SAME_DOUBLE


def suboptimality_of(enclosure: Enclosure, K: np.ndarray, box: np.ndarray) -> Suboptimality:
    """Return the cost of u = -K z above the optimum of a game.

    enclosure: of the solution of the game
    K: (m, n)
    box: half-widths of the box of states, (n,)
    """
    game, gain = enclosure.game, ball_matrix(K)
    suboptimality = without_bound(game, low=0.0)
    for bits in ATTEMPTS:
        with precision(bits):
            loop = loop_with(game, gain)
            is_stable = is_summable = stability_of(loop, is_discrete=game.is_discrete)
            if game.discount != 1.0:
                is_summable = stability_of(discounted(loop, game), is_discrete=game.is_discrete)
            if is_summable is False:  # the cost is infinite
                return without_bound(game, is_stable=is_stable is True)
            found = replace(
                suboptimality, is_stable=is_stable is True, is_summable=is_summable is True
            )
            if is_summable:
                try:
                    found = _bounded(found, enclosed_in_bits(enclosure, bits), gain, box)
                except (FailedError, NotProvedError):
                    continue
        suboptimality = found  # perhaps with wide bounds, which more bits make narrower
        if suboptimality.is_known and suboptimality.matrix is not None:
            break
    # Without an enclosed D, the cost is known to be infinite only if the L2 gain is at least δ.
    if suboptimality.is_summable and suboptimality.matrix is None:
        is_beyond = ClosedLoops(enclosure).l2_gain(K).low >= game.delta
        return replace(suboptimality, low=math.inf if is_beyond else 0.0)
    return suboptimality


def without_bound(game: Game, *, low: float = math.inf, is_stable: bool = False) -> Suboptimality:
    """Return the suboptimality where no bound of the cost is known; low is inf if there is none."""
    n, k = game.E.shape
    return Suboptimality(
        low=low,
        high=math.inf,
        mean=math.inf,
        worst=np.full(n, math.nan),
        matrix=None,
        disturbance_gain=np.zeros((k, n)),
        is_stable=is_stable,
        is_summable=False,
    )


def _bounded(
    suboptimality: Suboptimality, enclosure: Enclosure, K: arb_mat, box: np.ndarray
) -> Suboptimality:
    """Return the suboptimality of a policy with a stable loop over the box of states.

    The given one is returned if no bound is proved with the bits of `precision`.
    """
    game = enclosure.game
    solved = _solved(enclosure, K)
    if solved is None:
        return suboptimality
    suboptimality = replace(
        suboptimality, matrix=midpoints(solved.D), disturbance_gain=midpoints(solved.L)
    )
    if has_indefinite_weights(game):  # relative to the largest optimum of the box
        sizes = midpoints(enclosure.P) * np.outer(box, box)
        largest = float(np.abs(np.linalg.eigvalsh(sizes)).max())
        # z' reference z is `largest` on the ellipsoid within the box.
        reference = ball_matrix(np.diag(largest / box**2))
        ratio = _largest_ratio(solved.D, reference, [], box)
        return replace(suboptimality, is_relative=False, **ratio._asdict())
    free = None if is_positive_definite(enclosure.proved.P) else free_states(game)
    if free is None:
        return replace(suboptimality, **_largest_ratio(solved.D, enclosure.P, [], box)._asdict())
    # The optimum is 0 on a subspace: what the policy costs there is infinite relative to it, unless
    # that is rounding beside the costs of the box.
    error = free.error_of(K)
    if error.is_wrong:
        costs = _costs_at(solved.D, free, box)
        suboptimality = replace(suboptimality, from_free=costs.largest, free_state=costs.state)
        if not costs.most <= SAME_DOUBLE * float(np.diag(midpoints(enclosure.P)) @ box**2):
            return replace(suboptimality, low=math.inf, worst=costs.state)
    # The other states are judged with the gain without its error on that subspace.
    without_error = _solved(enclosure, error.without_error)
    if without_error is None:
        return suboptimality
    ratio = _largest_ratio(without_error.D, enclosure.P, free.pivots, box)
    return replace(suboptimality, **ratio._asdict())


def _solved(optimum: Enclosure, K: arb_mat) -> LoopValue | None:
    """Return the excess D and the gain of the worst disturbance, minus that of the optimum, for
    u = -K z, or None if they are not proved.

    z'D z is what u costs more than the optimum z'P z under its worst disturbance. With Δ = K - K*,
    W W' = V = δ² - E'P E and W M = -E'P B Δ, write the disturbance as L* z + W'⁻¹(v + M z).
    Completing the square then gives a game of v alone: per step, z costs
    z'(Δ'(R + B'P B)Δ + M'M) z, and v costs -v'v. In continuous time, V = δ², M = 0, and R is in the
    place of R + B'P B.
    """
    from flint import arb

    game = optimum.game
    A, B, E = (discounted(ball_matrix(matrix), game) for matrix in (game.A, game.B, game.E))
    error = K - optimum.K
    weight, F = symmetric_part(ball_matrix(game.R)), A - B * K
    if game.is_discrete:
        weight = weight + B.transpose() * optimum.P * B
    cost, delta = error.transpose() * weight * error, math.inf
    M, W_inverse = 0 * optimum.L, identity(E.ncols())
    if math.isfinite(game.delta):
        V, delta = W_inverse * arb(game.delta) ** 2, 1.0  # v has the weight 1
        if game.is_discrete:
            V = V - E.transpose() * optimum.P * E
        W = _cholesky(V)
        if W is None:
            return None
        W_inverse = W.inv()
        if game.is_discrete:
            M = -W_inverse * (E.transpose() * optimum.P * B * error)
        F = F + E * optimum.L
        E = E * W_inverse.transpose()
        F, cost = F + E * M, cost + M.transpose() * M
    loop = ClosedLoops(optimum).in_new_states(F, E, cost)
    try:
        D, L = loop.value(delta)
    except (FailedError, NotProvedError, ZeroDivisionError):
        return None
    units = optimum.units
    L = units.gain_of_user(L, 0 * units.disturbances)
    return LoopValue(units.value_of_user(D), W_inverse.transpose() * (L + M))


def _cholesky(matrix: arb_mat) -> arb_mat | None:
    """Return W, lower triangular, with W W' = M, (k, k), or None unless M is proved positive."""
    k = matrix.nrows()
    W = (0 * matrix).tolist()
    for j in range(k):
        pivot = matrix[j, j] - sum(W[j][i] * W[j][i] for i in range(j))
        if not pivot > 0:
            return None
        W[j][j] = pivot.sqrt()
        for row in range(j + 1, k):
            inner = sum(W[row][i] * W[j][i] for i in range(j))
            W[row][j] = (matrix[row, j] - inner) / W[j][j]
    return ball_matrix(W)


class _Costs(NamedTuple):
    """Costs from states of the box without optimal cost.

    largest: cost from one of them, at the edge of the box
    state: this state, (n,)
    most: bound of the cost from every such state in the box
    """

    largest: float
    state: np.ndarray
    most: float


def _costs_at(D: arb_mat, free: FreeStates, box: np.ndarray) -> _Costs:
    """Return the costs z'D z from the directions of a basis of the states without optimal cost."""
    matrix, directions = midpoints(D), midpoints(free.basis).T
    states = [_at_edge(direction, box) for direction in directions]
    values = [float(state @ matrix @ state) for state in states]
    worst = int(np.argmax(values))
    # A state of the box without optimal cost is a sum of multiples of all directions, of at most
    # box[pivot] each, since the basis is the identity in the rows of the pivots.
    roots = [
        box[pivot] * math.sqrt(max(float(direction @ matrix @ direction), 0.0))
        for pivot, direction in zip(free.pivots, directions, strict=True)
    ]
    return _Costs(largest=values[worst], state=states[worst], most=sum(roots) ** 2)


class _Ratio(NamedTuple):
    """Bounds and mean of z'D z / z'P z, and a state (n,) with the ratio `low`, at the edge of the
    box; fields as in `Suboptimality`.
    """

    low: float
    high: float
    mean: float
    worst: np.ndarray


def _largest_ratio(D: arb_mat, P: arb_mat, without: list[int], box: np.ndarray) -> _Ratio:
    """Return bounds of sup z'D z / z'P z.

    without: numbers of d states that are left out, the pivots of `FreeStates`. P and D vanish on
        its basis: each z costs what a state costs that is 0 at the pivots.
    """
    n = P.nrows()
    kept = [state for state in range(n) if state not in without]
    if not kept:
        return _Ratio(0.0, 0.0, 0.0, np.zeros(n))
    D, P = _principal(D, kept), _principal(P, kept)
    inverse_root = _inverse_root(P)
    if inverse_root is None:
        # no proof: P may not be positive definite
        return _Ratio(low=0.0, high=math.inf, mean=math.nan, worst=np.zeros(n))
    relative_D = symmetric(inverse_root.transpose() * D * inverse_root)
    ratios, vectors = np.linalg.eigh(midpoints(relative_D))
    direction = inverse_root * ball_matrix(vectors[:, -1:])
    low, high = ratio_bounds(D, P, direction, float(ratios[-1]))
    state = np.zeros(n)
    state[kept] = midpoints(direction)[:, 0]
    return _Ratio(low, high, max(float(ratios.mean()), 0.0), _at_edge(state, box))


def ratio_bounds(
    D: arb_mat, P: arb_mat, direction: arb_mat, estimate: float
) -> tuple[float, float]:
    """Return proved bounds of sup z'D z / z'P z, inf if no upper one is found near an estimate.

    A vector proves the lower bound, and r P - D > 0 the upper bound r.

    direction: the vector, (n, 1)
    estimate: of the largest ratio
    """
    from flint import arb

    low = (direction.transpose() * D * direction)[0, 0] / (
        (direction.transpose() * P * direction)[0, 0]
    )
    least = math.nextafter(float(low.lower()), 0.0) if low.is_finite() else 0.0
    # A ratio below SAME_DOUBLE counts as 0: half of it is near enough.
    at_least = arb(max(estimate, SAME_DOUBLE / 2.0))
    for exponent in _POWERS_ABOVE:
        bound = (at_least * (1 + arb(10) ** exponent)).mid()
        if is_positive_definite(P * bound - D):
            return max(least, 0.0), math.nextafter(float(bound), math.inf)
    return max(least, 0.0), math.inf


def _principal(matrix: arb_mat, kept: list[int]) -> arb_mat:
    """Return the rows and columns of a matrix with these numbers."""
    return ball_matrix([[matrix[i, j] for j in kept] for i in kept])


def _inverse_root(P: arb_mat) -> arb_mat | None:
    """Return an approximate W, upper triangular, with W'P W = 1, or None unless P may be positive.

    With P = L D L', W' = D^(-1/2) L⁻¹, and None if a pivot in D is not positive.
    """
    n = P.nrows()
    rows = P.mid().tolist()
    L_inverse = identity(n).tolist()
    pivots = []
    for k in range(n):
        pivot = rows[k][k]
        if not pivot > 0:
            return None
        pivots.append(pivot)
        for i in range(k + 1, n):
            factor = (rows[i][k] / pivot).mid()
            for j in range(k + 1, i + 1):
                rows[i][j] = (rows[i][j] - factor * rows[j][k]).mid()
            for j in range(k + 1):
                L_inverse[i][j] = (L_inverse[i][j] - factor * L_inverse[k][j]).mid()
    W_transposed = [
        [entry / pivot.sqrt() for entry in row]
        for row, pivot in zip(L_inverse, pivots, strict=True)
    ]
    return ball_matrix(W_transposed).transpose().mid()


def _at_edge(direction: np.ndarray, box: np.ndarray) -> np.ndarray:
    """Return the multiple of a direction at the edge of the box, (n,): the largest entry, relative
    to the box, is that of the box, and positive.
    """
    relative = direction / box
    largest = relative[np.argmax(np.abs(relative))]
    return direction / largest if largest else direction
