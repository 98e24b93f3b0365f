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
from hfa_support.matrices import power_of_two
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


def cost_above_optimum(deployed: Deployed, at: Equilibrium, loop: Chain) -> CostAboveOptimum | str:
    """Return the cost above the optimum, or a sentence with the reason why no optimum exists.

    at: equilibrium of the sampled loop
    loop: sampled loop at the equilibrium, in nominal values

    Raises BadInputError for the weight of an output that depends on the inputs.
    """
    game = lqr_at(deployed, at)
    try:
        _, optimum = hold_of(game.A, game.B, game.Q, game.R, loop.dt).infinite_horizon()
    except NoSolutionError as error:
        return f"the cost has no optimum here: {error}"
    return _above(game, optimum, loop)


def lqr_at(deployed: Deployed, at: Equilibrium) -> Game:
    """Return the LQR problem of the linearization at an equilibrium, in nominal values.

    Q and R are those of the deployment, in a unit of the cost in which the largest is about 1.
    """
    model = deployed.model
    x = model.nominal(model.linear)
    u = model.nominal(deployed.commanded)
    of_states, of_inputs = weights_at(deployed, at)
    Q, R = of_states * np.outer(x, x), of_inputs * np.outer(u, u)
    largest = power_of_two(np.array(max(np.abs(Q).max(), np.abs(R).max())))
    A, B = at.nominal.A, at.nominal.B
    return Game(A, B, E=np.eye(len(A)), Q=Q / largest, R=R / largest, delta=math.inf)


def _above(game: Game, optimum: np.ndarray, loop: Chain) -> CostAboveOptimum:
    """Return the cost of a sampled loop above the optimum, 0 if no deviation has a cost.

    optimum: P of the least cost x'Px, (k, k)
    """
    if loop.radius >= 1.0:
        return CostAboveOptimum(math.inf, math.inf)
    values, vectors = np.linalg.eigh(optimum)
    paid = values > _COSTS_NOTHING * max(float(values[-1]), 0.0)
    if not paid.any():
        return CostAboveOptimum(0.0, 0.0)
    # Eigenvalues of P^(-1/2) (X - P) P^(-1/2), in the directions in which P is not 0.
    root = vectors[:, paid] / np.sqrt(values[paid])
    above = np.linalg.eigvalsh(root.T @ (_cost_of(loop, game) - optimum) @ root)
    worst, mean = (100.0 * max(float(each), 0.0) for each in (above[-1], above.mean()))
    return CostAboveOptimum(worst, mean)


def _cost_of(loop: Chain, game: Game) -> np.ndarray:
    """Return X of the cost x'Xx of a stable sampled loop from deviations x, (k, k).

    At the first sample, delayed commands have their equilibrium values, and earlier observations
    equal the present ones.
    """
    from scipy.linalg import solve_discrete_lyapunov

    of_states = np.eye(loop.states, len(loop.F))  # from s at the sample to x now
    weights = np.zeros_like(loop.F)
    for seconds, of_inputs in loop.acting:
        hold = hold_of(game.A, game.B, game.Q, game.R, seconds)
        of_both = np.vstack([of_states, of_inputs])
        weights += of_both.T @ hold.W @ of_both
        of_states = hold.A @ of_states + hold.B @ of_inputs
    return loop.start.T @ solve_discrete_lyapunov(loop.closed.T, weights) @ loop.start
