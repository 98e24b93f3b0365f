"""The policy of a closed loop, as given by the options of `hfa prove region`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import casadi as ca
import numpy as np

from controller.critic.critic_file import critic_in, is_network
from controller.riccati.gare import unconfirmed_solution
from hfa.options.advice import trimmed
from hfa.options.critic_files import reading_of
from hfa.options.games import given_weights, weighted_game
from hfa.options.option import refuse
from hfa_prove.problem import loop_at
from hfa_prove.statements.loop import Gain
from hfa_support.errors import BadInputError, NoSolutionError, prefix_errors
from trim.linear.linear_model import LinearModel
from trim.linear.linearize import linearize

if TYPE_CHECKING:
    from hfa.options.trims import GivenTrim
    from hfa_prove.commands.request import LoopOptions
    from hfa_prove.search.region_search import RegionProblem

#: Options of a network or critic.
_OF_NETWORKS = ("weights", "basis", "network", "set")


@dataclass(frozen=True, eq=False)
class GivenPolicy:
    """A policy and the linear model at whose trim it is applied.

    linear: linear model at the trim
    policy: gain, or a function from state deviations to input deviations
    words: description of the policy
    known: pairs of a description and a matrix P, each of which gives a candidate V = z'P z
    """

    linear: LinearModel
    policy: Gain | ca.Function
    words: str
    known: Sequence[tuple[str, np.ndarray]]

    def problem(self, limits: Mapping[str, tuple[float, float]]) -> RegionProblem:
        """Return the closed loop whose region is to be proved.

        limits: limits of the trim condition, which replace those of the model (`loop_at`)
        """
        from hfa_prove.search.region_search import RegionProblem

        policy = self.policy if isinstance(self.policy, Gain) else scalars(self.policy)
        return RegionProblem(loop_at(self.linear, policy, limits), self.known)


def given_policy(request: LoopOptions, given: GivenTrim) -> GivenPolicy:
    """Return the policy that the options define, at a trim.

    Raises NoSolutionError if no trim is found or the game has no solution. Raises BadInputError if
    an option does not apply to the policy.
    """
    if request.weights is None:
        refuse(request, ("basis",), "applies only to W in --weights; add --weights, or remove it")
    if request.weights is None or not is_network(request.weights):
        refuse(
            request,
            ("network", "set"),
            "applies only to a network in --weights; add --weights, or remove this option",
        )
    linear = linearize(given.model, trimmed(given))
    if not given.model.inputs:
        return GivenPolicy(linear, Gain(np.zeros((0, len(linear.states)))), "no inputs", [])
    game = weighted_game(given_weights(request), linear).game
    if request.weights is None:
        try:
            solution = unconfirmed_solution(game)
        except NoSolutionError as error:
            raise NoSolutionError(
                f"the game of the linear model has no solution ({error}), so there is no policy; "
                "give a stabilizing policy with --weights"
            ) from error
        gain = Gain(np.array(solution.K, dtype=float))
        return GivenPolicy(linear, gain, "gain of the game", [("P of the game", solution.P)])
    with prefix_errors(request.weights):
        critic = critic_in(request.weights, game, reading_of(request))
    if critic.has_linear_policy:
        known = [] if critic.P is None else [("P of the game", critic.P)]
        gain = Gain(np.array(critic.K, dtype=float))
        return GivenPolicy(linear, gain, str(request.weights), known)
    known = [("P of the game", unconfirmed_solution(game).P)]
    known += [] if critic.P is None else [("P of the critic", critic.P)]
    return GivenPolicy(linear, critic.policy, critic.origin, known)


def scalars(policy: ca.Function) -> ca.Function:
    """Return an equal policy that is a CasADi function of scalar operations.

    Raises BadInputError if the policy is computed iteratively.
    """
    if not policy.is_a("MXFunction"):
        return policy
    try:
        return policy.expand()
    except RuntimeError as error:
        raise BadInputError(
            "the policy is computed iteratively from a network, which is not supported; give a "
            "network whose output is the policy"
        ) from error
