"""Effects of the actions beside the exact gain's: a reversed action has the opposite sign."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from controller.riccati.gare import unconfirmed_solution
from hfa_flight.judge.cost_above_optimum import lqr_at
from hfa_flight.judge.outcomes import Place
from hfa_flight.judge.reach import reach_of
from hfa_flight.policies.deployment.deployed import Deployed
from hfa_flight.policies.deployment.equilibrium import EquilibriumSearch
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


def action_effects(
    deployed: Deployed, place: Place, search: EquilibriumSearch
) -> list[ActionEffect]:
    """Return the effect of each action at an equilibrium, or at the trim if it is saturated.

    The exact gain is that of the linear problem with the weights of `weights_at`. The result is []
    if this problem has no solution.

    search: search for the equilibrium at this trim
    """
    loop = place.equilibrium
    if loop is None or loop.clips:
        loop = search.at_trim()
    inside = reach_of(deployed, loop, place.box).loop
    try:
        exact = unconfirmed_solution(lqr_at(deployed, inside)).K
    except NoSolutionError:
        return []
    gain = inside.K if inside.gain is None else inside.gain
    damping = np.diag(gain @ inside.B)
    exact_damping = np.diag(exact @ inside.B)
    columns = (deployed.commanded, damping.tolist(), exact_damping.tolist())
    return [ActionEffect(*row) for row in zip(*columns, strict=True)]
