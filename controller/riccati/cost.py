"""Cost of a linear policy under its worst disturbance, compared with the optimum."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from controller.game.zero_sum import LARGEST_CRITIC_ENTRY, Game
from controller.riccati.axis_distance import distance_to_instability
from controller.riccati.balancing import stability
from controller.riccati.certificate import form_of
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

    def contents(self) -> dict[str, Any]:
        """Return the entries of the file, name -> value."""
        return {
            "cost_lost_worst_percent": self.worst,
            "cost_lost_mean_percent": self.mean,
            "l2_gain": self.gain,
            "l2_gain_exact": self.exact_gain,
            "distance_to_instability": self.distance,
            "distance_to_instability_exact": self.exact_distance,
        }


def flight_cost(game: Game, exact: Solution, K: np.ndarray) -> FlightCost:
    """Return the cost, L2 gain and distance to instability of u = -K z, compared with the optimum.

    If u = -K z does not stabilize, or |K_ij| <= `LARGEST_CRITIC_ENTRY` does not hold for every
    entry, the costs and the L2 gain of K are inf, and its distance is 0. With a discount, the costs
    are inf only if √α (A - B K) is not stable.

    game: the game
    exact: solution of the game
    K: (m, n)

    Raises NoSolutionError if rounding hides whether A - B K is stable.
    """
    infinite = math.inf, math.inf
    is_moderate = bool(np.all(np.abs(K) <= LARGEST_CRITIC_ENTRY))
    discounted = math.sqrt(game.discount) * (game.A - game.B @ K)
    is_bounded = is_moderate and stability(discounted, is_discrete=game.is_discrete).is_stable
    worst, mean = cost_above_optimum(game, exact, K) if is_bounded else infinite
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


def cost_above_optimum(game: Game, exact: Solution, K: np.ndarray) -> tuple[float, float]:
    """Return the largest and the mean relative excess of the cost of u = -K z above the optimum.

    The excesses are the eigenvalues of P*⁻¹ D on the states with a positive optimal cost. D is the
    `loss_matrix`.

    Both are inf if the cost has no bound.

    game: the game
    exact: solution of the game, with P*
    K: (m, n), stabilizing
    """
    D = loss_matrix(game, exact, K)
    if D is None:
        return math.inf, math.inf
    return excess_ratios(D, exact.P, form_of(game).units)


def excess_ratios(D: np.ndarray, P: np.ndarray, units: np.ndarray) -> tuple[float, float]:
    """Return the largest and the mean ratio z'D z / z'P z over the states with z'P z > 0.

    The mean is that over all directions with z'P z = 1. If no state has a positive optimal cost,
    both are 0 for D = 0, and otherwise inf.

    D: excess of the cost, (n, n)
    P: optimal cost, (n, n)
    units: units of the states in which P is balanced, (n,)
    """
    squared = np.outer(units, units)
    values, vectors = np.linalg.eigh(P * squared)
    positive = values > SIGNLESS * max(float(values[-1]), 0.0)
    if not positive.any():
        return (math.inf, math.inf) if D.any() else (0.0, 0.0)
    root = vectors[:, positive] / np.sqrt(values[positive])  # root' P root = I
    ratios = np.linalg.eigvalsh(root.T @ (D * squared) @ root)
    return max(float(ratios[-1]), 0.0), max(float(ratios.mean()), 0.0)


def loss_matrix(game: Game, exact: Solution, K: np.ndarray) -> np.ndarray | None:
    """Return the excess D >= 0, (n, n), of the cost of u = -K z, or None if the cost has no bound.

    Under the worst disturbance for u = -K z the cost is z'(P* + D) z. D solves the cost equation of
    K minus the cost equation of K*:

    F'D + D F + (K - K*)'R(K - K*) + δ⁻² D E E' D = 0,  F = A - B K + E L*.

    Small losses therefore keep their digits. Newton steps from D = 0 increase D, until F is
    unstable if there is no solution.

    In discrete time, the cost is that under w = L* z, the worst disturbance for the optimum:

    D = α F'D F + (K - K*)'(R + α B'P* B)(K - K*)

    game: the game
    exact: solution of the game, with P*, K* and L*
    K: (m, n), stabilizing
    """
    units = form_of(game).units
    D = _loss_in_units(game, exact, K, units)
    return None if D is None else D / np.outer(units, units)


def _loss_in_units(
    game: Game, exact: Solution, K: np.ndarray, units: np.ndarray
) -> np.ndarray | None:
    """Return the `loss_matrix` for states in balanced units, in which the equations are solved."""
    change = (K - exact.K) * units
    charge = change.T @ exact.price @ change
    worst = game.A - game.B @ K + game.E @ exact.disturbance_gain
    loop = math.sqrt(game.discount) * worst * units / units[:, None]
    if game.is_discrete:
        if not spectral_radius(loop) < 1.0:
            return None
        return Lyapunov.of_steps(loop).solve(-charge)[0]
    E = game.E / units[:, None] / game.delta
    spread = E @ E.T
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
