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
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from controller.game.zero_sum import Game
from controller.riccati.balls import (
    ATTEMPTS,
    ROUNDOFF,
    ball_matrix,
    cholesky,
    identity,
    is_positive_definite,
    midpoints,
    part,
    precision,
    symmetric,
    symmetric_part,
)
from controller.riccati.closed_loops import ClosedLoops
from controller.riccati.enclosure import Enclosure, enclosed_in_bits
from controller.riccati.l2_gain import DisturbedLoop
from controller.riccati.lyapunov import (
    FailedError,
    NotProvedError,
    discounted,
    loop_with,
    stability_of,
)

if TYPE_CHECKING:
    from flint import arb_mat


#: Relative width of an enclosure that shows three digits, in all but ties.
THREE_DIGITS = 1e-6
#: A cost that is higher by less than this fraction is the same double.
SAME_DOUBLE = ROUNDOFF
#: In place of a largest optimum of 0: far below any cost, and far above the radius of a cost of 0.
NO_COST = 2.0**-300
#: Steps in which an upper bound is sought above the estimate, as powers of ten.
_POWERS_ABOVE = range(-12, -5)


@dataclass(frozen=True, eq=False)
class Suboptimality:
    """Cost of u = -K z above the optimum, under the worst disturbance of the policy.

    low, high: bounds of the largest cost above the optimum from a state of the ellipsoid within the
        box, relative to the largest optimal cost, in magnitude, of such a state. Both are inf if it
        is proved that the cost has no bound; high alone is inf if no bound is proved.
    mean: mean cost above the optimum over the surface of this ellipsoid, relative to the same cost
    worst: initial state with the suboptimality `low`, at the edge of the box, (n,); nan without one
    of_each: upper bound of the largest cost above the optimum relative to the optimum of the same
        state, or None unless P is proved positive definite by more than the rounding of doubles
    matrix: D, (n, n), or None without a bounded cost
    disturbance_gain: (k, n), of the worst disturbance of the policy, minus that of the optimum
    is_stable: whether A - B K is proved stable
    is_summable: whether √α (A - B K), in continuous time A - B K, is proved stable
    """

    low: float
    high: float
    mean: float
    worst: np.ndarray
    matrix: np.ndarray | None
    disturbance_gain: np.ndarray
    is_stable: bool
    is_summable: bool
    of_each: float | None = None

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
        with precision(bits), suppress(FailedError, NotProvedError, ZeroDivisionError):
            loop = loop_with(game, gain)
            is_stable = is_summable = stability_of(loop, is_discrete=game.is_discrete)
            if game.discount != 1.0:
                is_summable = stability_of(discounted(loop, game), is_discrete=game.is_discrete)
            if is_summable is False:  # the cost is infinite
                return without_bound(game, is_stable=is_stable is True)
            suboptimality = replace(
                suboptimality, is_stable=is_stable is True, is_summable=is_summable is True
            )
            if is_summable:  # perhaps the bounds are wide, and more bits make them narrower
                closer = enclosed_in_bits(enclosure, bits)
                suboptimality = _bounded(suboptimality, closer, gain, box)
        is_enclosed = suboptimality.matrix is not None and suboptimality.of_each != math.inf
        if suboptimality.is_known and is_enclosed:
            break
    # Without an enclosed D, the cost is known to be infinite only if the L2 gain is at least δ.
    if suboptimality.is_summable and suboptimality.matrix is None:
        is_beyond = ClosedLoops(enclosure).l2_gain(K).low >= game.delta
        return replace(suboptimality, low=math.inf if is_beyond else 0.0)
    return suboptimality


def reference_cost(P: np.ndarray, box: np.ndarray) -> np.ndarray:
    """Return the cost z'M z to which costs above the optimum are relative, M diagonal, (n, n).

    It is the largest optimum |y'P y| of all states y that are as far from 0 as z in units of the
    box, Σ (y_i / b_i)² = Σ (z_i / b_i)²: not 0 for z != 0, unlike the optimum z'P z.

    P: (n, n), of the optimum
    box: half-widths b, (n,)
    """
    largest = float(np.abs(np.linalg.eigvalsh(P * np.outer(box, box))).max())
    return np.diag((largest or NO_COST) / box**2)


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

    Raises an error as `_solved` does.
    """
    (D, L), P = _solved(enclosure, K), enclosure.P
    reference = ball_matrix(reference_cost(midpoints(P), box))
    ratio = _largest_ratio(D, reference, box)
    is_positive = is_positive_definite(P - reference * ROUNDOFF)
    of_each = _largest_ratio(D, P, box).high if is_positive else None
    return replace(
        suboptimality,
        matrix=midpoints(D),
        disturbance_gain=midpoints(L),
        of_each=of_each,
        **ratio._asdict(),
    )


def _solved(optimum: Enclosure, K: arb_mat) -> tuple[arb_mat, arb_mat]:
    """Return the excess D and the gain of the worst disturbance, minus that of the optimum, for
    u = -K z.

    z'D z is what u costs more than the optimum z'P z under its worst disturbance. With Δ = K - K*,
    W W' = V = δ² - E'P E and W M = -E'P B Δ, write the disturbance as L* z + W'⁻¹(v + M z).
    Completing the square then gives a game of v alone: per step, z costs
    z'(Δ'(R + B'P B)Δ + M'M) z, and v costs -v'v. In continuous time, V = δ², M = 0, and R is in the
    place of R + B'P B.

    Raises FailedError, NotProvedError or ZeroDivisionError if they are not proved.
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
        W = cholesky(V)
        if W is None:
            raise NotProvedError("the disturbance may gain cost")
        W_inverse = W.inv()
        if game.is_discrete:
            M = -W_inverse * (E.transpose() * optimum.P * B * error)
        F = F + E * optimum.L
        E = E * W_inverse.transpose()
        F, cost = F + E * M, cost + M.transpose() * M
    found = DisturbedLoop(F, E, symmetric_part(cost), game.is_discrete).value(delta)
    return found.P, W_inverse.transpose() * (found.L + M)


class _Ratio(NamedTuple):
    """Bounds and mean of z'D z / z'P z, and a state (n,) with the ratio `low`, at the edge of the
    box; fields as in `Suboptimality`.
    """

    low: float
    high: float
    mean: float
    worst: np.ndarray


def _largest_ratio(D: arb_mat, P: arb_mat, box: np.ndarray) -> _Ratio:
    """Return bounds of sup z'D z / z'P z, of which high is inf if P may not be positive."""
    root = cholesky(P.mid())
    if root is None:
        return _Ratio(low=0.0, high=math.inf, mean=math.nan, worst=np.zeros(P.nrows()))
    inverse_root = root.inv().transpose().mid()
    relative_D = symmetric(inverse_root.transpose() * D * inverse_root)
    ratios, vectors = np.linalg.eigh(midpoints(relative_D))
    direction = inverse_root * ball_matrix(vectors[:, -1:])
    low, high = ratio_bounds(D, P, direction, float(ratios[-1]))
    worst = _at_edge(midpoints(direction)[:, 0], box)
    return _Ratio(low, high, max(float(ratios.mean()), 0.0), worst)


def price_of_delay(late: Enclosure, optimum: Enclosure) -> str:
    """Return what a delay costs as a sentence.

    late: game with the delay, whose first states are those of the game without, `optimum`
    """
    n = optimum.P.nrows()
    with precision(min(late.bits, optimum.bits)):
        no_command = part(late.P, slice(n), slice(n))  # under way
        ratio = _largest_ratio(no_command, optimum.P, np.ones(n))
    if not math.isfinite(ratio.high):
        return "What the delay costs is not known: without it, some states may cost nothing."
    return (
        "With the delay, the cost from states without a command under way is at most "
        f"{ratio.high:.4g} times the optimum without, and {ratio.mean:.4g} times in the mean."
    )


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


def _at_edge(direction: np.ndarray, box: np.ndarray) -> np.ndarray:
    """Return the multiple of a direction at the edge of the box, (n,): the largest entry, relative
    to the box, is that of the box, and positive.
    """
    relative = direction / box
    largest = relative[np.argmax(np.abs(relative))]
    return direction / largest if largest else direction
