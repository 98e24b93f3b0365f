"""Cost of a linear policy under its worst disturbance, compared with the optimum."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from controller.game.zero_sum import LARGEST_CRITIC_ENTRY, Game
from controller.riccati.axis_distance import distance_to_instability
from controller.riccati.balancing import stability
from controller.riccati.gare import Solution
from controller.riccati.lyapunov import Lyapunov
from controller.riccati.meaning import bounded_real_gain
from hfa_support.matrices import spectral_radius
from hfa_support.reporting.results import Result

#: An eigenvalue of P* below this fraction of the largest belongs to a state without cost.
SIGNLESS = 1e-12
#: Largest number of Newton steps for the loss. They converge quadratically, from below.
MAX_STEPS = 100
#: Relative change of the loss below which the Newton steps end, unless rounding changes it more.
LOSS_TOLERANCE = 1e-10


@dataclass(frozen=True)
class FlightCost(Result):
    """Cost of u = -K z above the optimum, in percent of the optimal cost z'P*z.

    The cost is that under the worst disturbance for the policy, in discrete time under the worst
    disturbance for the optimum (`loss_matrix`). The excess is inf if the cost has no bound. This is
    the case if the L2 gain is not below delta, or if the loop, with a discount √α (A - B K), is
    unstable.

    worst: largest excess over all initial conditions, percent
    mean: mean excess over initial conditions with the same optimal cost, percent
    gain: L2 gain of u = -K z, which must be below delta
    exact_gain: L2 gain of the optimum
    distance: smallest change of A - B K that gives an undamped mode, relative to the norm of A - B
        K in balanced units; 0 for an unstable loop
    exact_distance: the same distance for the optimum
    """

    worst: float
    mean: float
    gain: float
    exact_gain: float
    distance: float
    exact_distance: float

    def _entries(self) -> dict[str, Any]:
        """Return the entries of the file, name -> value."""
        return {
            "cost_lost_worst_percent": self.worst,
            "cost_lost_mean_percent": self.mean,
            "l2_gain": self.gain,
            "l2_gain_exact": self.exact_gain,
            "distance_to_instability": self.distance,
            "distance_to_instability_exact": self.exact_distance,
        }


def flight_cost(exact: Solution, K: np.ndarray) -> FlightCost:
    """Return the cost, L2 gain and distance to instability of u = -K z, compared with the optimum.

    If u = -K z does not stabilize, or |K_ij| <= `LARGEST_CRITIC_ENTRY` does not hold for every
    entry, the costs and the L2 gain of K are inf, and its distance is 0. With a discount, the costs
    are inf only if √α (A - B K) is not stable.

    exact: solution of the game
    K: (m, n)

    Raises NoSolutionError if rounding hides whether A - B K is stable.
    """
    game = exact.game
    infinite = math.inf, math.inf
    is_moderate = bool(np.all(np.abs(K) <= LARGEST_CRITIC_ENTRY))
    discounted = math.sqrt(game.discount) * (game.A - game.B @ K)
    is_bounded = is_moderate and stability(discounted, is_discrete=game.is_discrete).is_stable
    worst, mean = cost_above_optimum(exact, K) if is_bounded else infinite
    return FlightCost(
        worst=100.0 * worst,
        mean=100.0 * mean,
        gain=bounded_real_gain(game, K) if is_moderate else math.inf,
        exact_gain=bounded_real_gain(game, exact.K),
        distance=_distance(game, K) if is_moderate else 0.0,
        exact_distance=_distance(game, exact.K),
    )


def _distance(game: Game, K: np.ndarray) -> float:
    """Return the distance to instability of A - B K, 0 if it is unstable already."""
    loop = game.A - game.B @ K
    if not stability(loop, is_discrete=game.is_discrete).is_stable:
        return 0.0
    return distance_to_instability(loop, is_discrete=game.is_discrete).distance


def cost_above_optimum(exact: Solution, K: np.ndarray) -> tuple[float, float]:
    """Return the largest and the mean relative excess of the cost of u = -K z above the optimum.

    The excesses are the eigenvalues of P*⁻¹ D on the states with a positive optimal cost, the mean
    that over all directions with z'P* z = 1. D is the `loss_matrix`. Of the initial conditions that
    differ by a state without optimal cost, the one with the least excess counts. If no state has a
    positive optimal cost, both are 0 for D = 0.

    Both are inf if the cost has no bound.

    exact: solution of the game, with P*
    K: (m, n), stabilizing
    """
    D = _loss(exact, K)
    if D is None:
        return math.inf, math.inf
    values, vectors = np.linalg.eigh(exact.certified.X)
    positive = values > SIGNLESS * max(float(values[-1]), 0.0)
    if not positive.any():
        return (math.inf, math.inf) if D.any() else (0.0, 0.0)
    root = vectors[:, positive] / np.sqrt(values[positive])  # root' X root = I
    free = vectors[:, ~positive]
    crossed = free.T @ D @ root
    saved = crossed.T @ np.linalg.pinv(free.T @ D @ free, SIGNLESS, hermitian=True) @ crossed
    ratios = np.linalg.eigvalsh(root.T @ D @ root - saved)
    return max(float(ratios[-1]), 0.0), max(float(ratios.mean()), 0.0)


def loss_matrix(exact: Solution, K: np.ndarray) -> np.ndarray | None:
    """Return the excess D >= 0, (n, n), of the cost of u = -K z, or None if the cost has no bound.

    Under the worst disturbance for u = -K z the cost is z'(P* + D) z. D solves the cost equation of
    K minus the cost equation of K*:

    F'D + D F + (K - K*)'R(K - K*) + δ⁻² D E E' D = 0,  F = A - B K + E L*.

    Small losses therefore keep their digits. Newton steps from D = 0 increase D, until F is
    unstable if there is no solution.

    In discrete time, the cost is that under w = L* z, the worst disturbance for the optimum:

    D = α F'D F + (K - K*)'(R + α B'P* B)(K - K*)

    exact: solution of the game, with P*, K* and L*
    K: (m, n), stabilizing
    """
    D = _loss(exact, K)
    return None if D is None else exact.certified.form.value(D)


def _loss(exact: Solution, K: np.ndarray) -> np.ndarray | None:
    """Return the `loss_matrix` in the states in which the game was solved.

    The value of the game is moderate there, so that rounding of a large cost hides no small one.
    """
    X, form = exact.certified.X, exact.certified.form
    change = np.linalg.solve(form.T.T, (K - exact.K).T).T
    charge = change.T @ exact.price @ change
    loop = form.loops(X)[0] - form.inputs @ np.linalg.solve(form.V, change)
    if form.is_discrete:
        if not spectral_radius(loop) < 1.0:
            return None
        return Lyapunov.of_steps(loop).solve(-charge)[0]
    spread = form.E @ form.E.T
    D = np.zeros_like(loop)
    for _ in range(MAX_STEPS):
        F = loop + spread @ D
        if not stability(F, is_discrete=False).is_stable:
            return None
        with np.errstate(over="ignore", invalid="ignore"):  # the next F is then not finite
            following, _ = Lyapunov(F).solve(D @ spread @ D - charge)
        if np.abs(following - D).max() <= LOSS_TOLERANCE * np.abs(following).max():
            return following
        D = following
    return D
