"""Effects of the actions beside the exact gain's: a reversed action has the opposite sign."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from controller.riccati.gare import solve
from hfa_flight.judge.cost_above_optimum import lqr_at
from hfa_flight.policies.deployment.deployed import Deployed
from hfa_flight.policies.deployment.equilibrium import Equilibrium
from hfa_support.errors import NoSolutionError


class ActionEffect(NamedTuple):
    """Effect of an action in the linear loop, beside that of the exact gain.

    The effect K_i b_i is the amount by which the action lowers the sum of the eigenvalues of the
    loop, 1/s, with K_i the action's row of the gain and b_i its column of B. For the exact gain
    K = R⁻¹ B'P it is b_i'P b_i / R_ii for a diagonal R, and thus never negative.

    action: name of the input.
    effect: of the policy, negative for a reversed action.
    exact_effect: of the exact gain.
    """

    action: str
    effect: float
    exact_effect: float


def action_effects(deployed: Deployed, linearized: Equilibrium) -> list[ActionEffect]:
    """Return the effect of each action in the linearization at an equilibrium or at a trim.

    The exact gain is that of the linear problem with the weights of `weights_at`. The result is []
    if this problem has no solution.
    """
    try:
        exact = solve(lqr_at(deployed, linearized)).K
    except NoSolutionError:
        return []
    loop = linearized.nominal
    damping = np.diag(loop.settled_gain @ loop.B)
    exact_damping = np.diag(exact @ loop.B)
    columns = (deployed.commanded, damping.tolist(), exact_damping.tolist())
    return [ActionEffect(*row) for row in zip(*columns, strict=True)]
