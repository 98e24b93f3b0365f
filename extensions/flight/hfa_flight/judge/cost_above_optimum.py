"""Cost of a policy at its equilibrium, relative to the optimum for the weights Q and R."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from controller.game.zero_sum import Game
from hfa_flight.judge.weights import weights_at
from hfa_flight.plan.hold import hold_of
from hfa_flight.policies.deployment.deployed import Deployed
from hfa_flight.policies.deployment.equilibrium import Equilibrium
from hfa_flight.policies.deployment.sampled_loop import Chain, chain_of
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


def cost_above_optimum(deployed: Deployed, equilibrium: Equilibrium) -> CostAboveOptimum | str:
    """Return the cost above the optimum, or a sentence with the reason why no optimum exists.

    Raises BadInputError for the weight of an output that depends on the inputs.
    """
    game, nominal = _in_nominal_units(deployed, equilibrium)
    timing = deployed.deployment
    chain = chain_of(nominal, timing.dt, timing.delay)
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


def _in_nominal_units(deployed: Deployed, equilibrium: Equilibrium) -> tuple[Game, Equilibrium]:
    """Return the LQR problem and the linearization, each signal in nominal values, and costs in
    units in which the largest weight is about 1.
    """
    model = deployed.model
    z = np.array([model.states[name].nominal for name in model.linear])
    u = np.array([model.inputs[name].nominal for name in deployed.commanded])
    nominal = replace(
        equilibrium,
        A=equilibrium.A * z / z[:, None],
        B=equilibrium.B * u / z[:, None],
        K=equilibrium.K * z / u[:, None],
        K_inputs=equilibrium.K_inputs * u / u[:, None],
    )
    Q, R = (
        weight * np.outer(sizes, sizes)
        for weight, sizes in zip(weights_at(deployed, equilibrium), (z, u), strict=True)
    )
    cost = power_of_two(np.array(max(np.abs(Q).max(), np.abs(R).max())))
    E = np.eye(len(z))
    return Game(nominal.A, nominal.B, E=E, Q=Q / cost, R=R / cost, delta=math.inf), nominal


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
