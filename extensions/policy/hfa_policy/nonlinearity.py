"""Largest deviation of a policy from its linearization over the initial-condition box."""

from __future__ import annotations

from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from controller.critic.critic import from_functions
from controller.critic.symbols import symbols_for
from controller.game.zero_sum import Game
from hfa_flight.policies.deployment.deployed import Deployed
from hfa_flight.policies.deployment.equilibrium import Equilibrium
from trim.point.operating_point import OperatingPoint
from verification.network.search import Comparison, search


class Nonlinearity(NamedTuple):
    """Largest |u - u_e + K z| found for any commanded input over the box of deviations z.

    u_e is the input at the equilibrium.

    part: largest deviation found, relative to the largest |K z| in the box. It is a lower bound on
        the true maximum.
    state: linear state -> z at the largest deviation.
    """

    part: float
    state: dict[str, float]


class _Slope(NamedTuple):
    """Linear policy u = -K z with which the deployed policy is compared."""

    K: np.ndarray  # (m', k)
    P: np.ndarray  # zeros, (k, k). The search requires P but does not use it for policies


def nonlinearity(
    deployed: Deployed, point: OperatingPoint, equilibrium: Equilibrium, box: np.ndarray
) -> Nonlinearity:
    """Return the largest deviation of a policy from its linearization at an equilibrium.

    The inputs before the sample have their equilibrium values.

    box: half-widths of the deviations z of the linear states, (k,)
    """
    model = deployed.model
    k = len(model.linear)
    rows = model.state_places(model.linear)
    columns = model.input_places(deployed.commanded)
    z = symbols_for([deployed.command], k)
    selection = np.zeros((len(model.states), k))
    selection[rows, np.arange(k)] = 1.0
    X = ca.DM(equilibrium.states) + ca.DM(selection) @ z
    trim = ca.DM(deployed.trim_vector(point))
    commanded = deployed.command(X, ca.DM(equilibrium.inputs), trim)
    u = commanded[columns] - ca.DM(equilibrium.inputs[columns])
    prices = np.array([model.inputs[name].nominal ** -2.0 for name in deployed.commanded])
    game = Game(equilibrium.A, equilibrium.B, np.eye(k), np.eye(k), np.diag(prices), np.inf)
    policy = from_functions(game, z, {"policy": u}, "the deployed policy")
    slope: Any = _Slope(equilibrium.K, np.zeros((k, k)))
    _, (found,) = search(Comparison(policy, slope, np.sqrt(prices), box))
    return Nonlinearity(found.error, dict(zip(model.linear, found.at.tolist(), strict=True)))
