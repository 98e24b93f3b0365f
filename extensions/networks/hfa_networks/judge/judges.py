"""Findings on critics that are nonlinear functions of the state."""

from __future__ import annotations

from typing import TYPE_CHECKING

from hfa_networks.judge.network_flights import InSteps, InTime
from hfa_networks.judge.network_search import Findings, findings

if TYPE_CHECKING:
    import numpy as np

    from controller.critic.critic import Critic
    from controller.discrete.solution import DiscreteSolution
    from controller.game.zero_sum import Game
    from controller.riccati.gare import Solution
    from verification.critic.scope import Scope


def in_time(
    game: Game, exact: Solution, critic: Critic, b: np.ndarray, limit: float, scope: Scope
) -> Findings:
    """Return the findings on a critic in continuous time, over the box |z_i| <= b_i.

    exact: exact solution of the game
    b: half-widths of the box, (n,)
    limit: largest relative error that passes
    scope: duration of the proof, number of simulations and further settings
    """
    return findings(InTime(game, exact), critic, exact, b, limit, scope)


def in_steps(
    exact: DiscreteSolution, critic: Critic, b: np.ndarray, limit: float, scope: Scope
) -> Findings:
    """Return the findings on a critic in discrete time, over the box |z_i| <= b_i.

    exact: exact solution of the game
    b: half-widths of the box, (n,)
    limit: largest relative error that passes
    scope: duration of the proof, number of simulations and further settings
    """
    return findings(InSteps(exact), critic, exact, b, limit, scope)
