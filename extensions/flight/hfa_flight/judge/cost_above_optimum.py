"""Cost of a policy at its equilibrium, relative to the optimum for the weights Q and R."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from controller.game.zero_sum import Game
from hfa_flight.judge.weights import weights_at
from hfa_flight.plan.hold import hold_of
from hfa_flight.policies.deployment.deployed import Deployed
from hfa_flight.policies.deployment.equilibrium import Equilibrium
from hfa_flight.policies.deployment.sampled_loop import Chain
from hfa_support.errors import NoSolutionError
from hfa_support.reporting.results import Result

#: A state whose eigenvalue of the optimal cost is smaller, relative to the largest, has no cost.
_COSTS_NOTHING = 1e-12


@dataclass(frozen=True)
class CostAboveOptimum(Result):
    """Cost of the sampled loop above the optimum for deviations from the equilibrium, percent.

    The cost of the loop with its delay is relative to the optimum with inputs that are held for a
    sample, without delay. Both are integrals over time. They are inf if the loop is unstable.

    worst: worst case.
    mean: mean over all initial conditions.
    """

    worst: float
    mean: float


def cost_above_optimum(
    deployed: Deployed, equilibrium: Equilibrium, chain: Chain
) -> CostAboveOptimum | str:
    """Return the cost above the optimum, or a sentence with the reason why no optimum exists.

    chain: sampled loop with its delay

    Raises BadInputError for the weight of an output that depends on the inputs.
    """
    game = lqr_at(deployed, equilibrium)
    try:
        _, optimum = hold_of(game.A, game.B, game.Q, game.R, chain.dt).forever()
    except NoSolutionError as error:
        return f"the cost has no optimum here: {error}"
    return _above(game, optimum, chain)


def lqr_at(deployed: Deployed, equilibrium: Equilibrium) -> Game:
    """Return the LQR problem of the linearization at the equilibrium.

    Q and R are those of the deployment.
    """
    Q, R = weights_at(deployed, equilibrium)
    E = np.eye(len(equilibrium.A))
    return Game(equilibrium.A, equilibrium.B, E=E, Q=Q, R=R, delta=math.inf)


def _above(game: Game, optimum: np.ndarray, chain: Chain) -> CostAboveOptimum:
    """Return the cost of a sampled loop above the optimum, 0 if no deviation has a cost."""
    # At the first sample, delayed commands have their equilibrium values, and earlier observations
    # equal the present ones.
    from scipy.linalg import solve_discrete_lyapunov

    if chain.radius >= 1.0:
        return CostAboveOptimum(math.inf, math.inf)
    x = np.eye(chain.states, len(chain.F))
    weights = np.zeros_like(chain.F)
    for seconds, acting in chain.acting:
        hold = hold_of(game.A, game.B, game.Q, game.R, seconds)
        both = np.vstack([x, acting])
        weights += both.T @ hold.W @ both
        x = hold.A @ x + hold.B @ acting
    X = chain.start.T @ solve_discrete_lyapunov(chain.closed.T, weights) @ chain.start
    values, vectors = np.linalg.eigh(optimum)
    paid = values > _COSTS_NOTHING * max(float(values[-1]), 0.0)
    if not paid.any():
        return CostAboveOptimum(0.0, 0.0)
    root = vectors[:, paid] / np.sqrt(values[paid])
    lost = np.linalg.eigvalsh(root.T @ (X - optimum) @ root)
    percent = [100.0 * max(float(each), 0.0) for each in (lost[-1], lost.mean())]
    return CostAboveOptimum(*percent)
