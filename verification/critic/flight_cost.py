"""What a critic costs in flight: how much its gain loses against the optimum, and how far it is from instability."""

from __future__ import annotations

import math
import warnings
from typing import NamedTuple

import numpy as np

from controller.game.zero_sum import Game
from hfa_model.support.jsonable import finite_or_none
from verification.critic.candidate import is_moderate
from verification.riccati.gare import GameSolution
from verification.riccati.l2_gain import bounded_real_gain
from verification.riccati.spectrum import spectrum
from verification.riccati.units import balanced_units

#: An eigenvalue of P* below this part of the largest is that of a state that costs nothing.
SIGNLESS = 1e-12
#: Newton steps to the loss double their digits; from 0 they grow to it from below.
MAX_STEPS = 100


class FlightCost(NamedTuple):
    """Cost lost by u = -K z against the optimum, percent of z'P*z, each under its own worst disturbance.

    worst, mean: over starts; the mean over starts of equal optimal cost. inf: no bound, the gain is not below delta or
    the loop is not stable. gain, exact_gain: L2 gains, to be below delta. distance, exact_distance: the smallest change
    that takes A - B K to an undamped mode, as a part of its norm in balanced units; 0 for an unstable loop.
    """

    worst: float
    mean: float
    gain: float
    exact_gain: float
    distance: float
    exact_distance: float

    def within(self, percent: float) -> bool:
        """Whether the cost lost from every start is at most that."""
        return self.worst <= percent

    def to_dict(self) -> dict[str, float | None]:
        """Ready for JSON, with the unit in the name."""
        return {
            "cost_lost_worst_percent": finite_or_none(self.worst),
            "cost_lost_mean_percent": finite_or_none(self.mean),
            "l2_gain": finite_or_none(self.gain),
            "l2_gain_exact": finite_or_none(self.exact_gain),
            "distance_to_instability": self.distance,
            "distance_to_instability_exact": self.exact_distance,
        }


def flight_cost(game: Game, exact: GameSolution, K: np.ndarray) -> FlightCost:
    """Compare the gain K (m, n) with that of the exact solution, in flight."""
    best = bounded_real_gain(game, exact.K), spectrum(game.A - game.B @ exact.K).axis_distance()
    loop = spectrum(game.A - game.B @ K) if is_moderate(K) else None
    if loop is None or loop.abscissa >= 0.0:
        return FlightCost(math.inf, math.inf, math.inf, best[0], 0.0, best[1])
    worst, mean = _lost(game, exact, K)
    return FlightCost(100.0 * worst, 100.0 * mean, bounded_real_gain(game, K), best[0], loop.axis_distance(), best[1])


def _lost(game: Game, exact: GameSolution, K: np.ndarray) -> tuple[float, float]:
    """Largest and mean eigenvalue of P*^-1 D, D of `loss_matrix`, on the states that cost something."""
    D = loss_matrix(game, exact, K)
    if D is None:
        return math.inf, math.inf
    units = balanced_units(game)
    squared = np.outer(units, units)
    values, vectors = np.linalg.eigh(exact.P * squared)
    paid = values > SIGNLESS * max(float(values[-1]), 0.0)
    if not paid.any():
        return (0.0, 0.0) if not D.any() else (math.inf, math.inf)
    root = vectors[:, paid] / np.sqrt(values[paid])
    lost = np.linalg.eigvalsh(root.T @ (D * squared) @ root)
    return max(float(lost[-1]), 0.0), max(float(lost.mean()), 0.0)


def loss_matrix(game: Game, exact: GameSolution, K: np.ndarray) -> np.ndarray | None:
    """D >= 0, (n, n): with u = -K z, which stabilizes, the worst disturbance costs z'(P* + D) z; None without bound.

    F'D + D F + (K - K*)'R(K - K*) + δ⁻² D E E' D = 0,  F = A - B K + E L*: the cost equation of K less that of K*,
    so that small losses keep their digits. Newton steps from D = 0.
    """
    from scipy.linalg import solve_continuous_lyapunov

    change = K - exact.K
    charge = change.T @ game.R @ change
    spread = game.S_disturbance / game.delta**2
    start = game.A - game.B @ K + game.E @ exact.disturbance_gain
    D = np.zeros_like(game.A)
    for _ in range(MAX_STEPS):
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("error", RuntimeWarning)  # SciPy's word for a singular Lyapunov equation
                F = start + spread @ D
                if spectrum(F).abscissa >= 0.0:
                    return None
                found = solve_continuous_lyapunov(F.T, D @ spread @ D - charge)
        except (ValueError, RuntimeWarning):  # it overflows, or has no solution
            return None
        found = (found + found.T) / 2.0
        if np.abs(found - D).max() <= 1e-10 * np.abs(found).max():
            return found
        D = found
    return None
