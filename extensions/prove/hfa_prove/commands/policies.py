"""The policy of a closed loop, as given by the options of `hfa prove region`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import casadi as ca
import numpy as np

from controller.critic.critic_file import critic_in, is_network
from controller.critic.symbols import symbols_for
from controller.riccati.gare import unconfirmed_solution
from hfa.options.advice import trimmed
from hfa.options.critic_files import reading_of
from hfa.options.games import given_weights, weighted_game
from hfa.options.option import refuse
from hfa_flight.policies.deployment.deployed import Deployed
from hfa_flight.policies.deployment.deployment import Deployment
from hfa_prove.commands.polynomials import policy_terms
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
    function: the policy, as in `Loop.policy`
    gain: coefficients of the policy if it is a polynomial, otherwise None
    words: description of the policy
    known: pairs of a description and a matrix P, each of which gives a candidate V = z'P z
    """

    linear: LinearModel
    function: ca.Function
    gain: Gain | None
    words: str
    known: Sequence[tuple[str, np.ndarray]]

    @classmethod
    def of_gain(
        cls, linear: LinearModel, gain: Gain, words: str, P: np.ndarray | None
    ) -> GivenPolicy:
        """Return the policy with given coefficients.

        words: description of the policy
        P: matrix of the value function of the game or critic, (n, n), or None
        """
        known = [] if P is None else [("P of the game", P)]
        return cls(linear, gain.function(linear.inputs), gain, words, known)

    def problem(self, limits: Mapping[str, tuple[float, float]]) -> RegionProblem:
        """Return the closed loop whose region is to be proved.

        limits: limits of the trim condition, which replace those of the model (`loop_at`)
        """
        from hfa_prove.search.region_search import RegionProblem

        policy = self.gain or scalars(self.function)
        return RegionProblem(loop_at(self.linear, policy, limits), self.known)


def is_function(request: LoopOptions) -> bool:
    """Return whether the options give a network or a deployment file."""
    if request.policy is not None:
        return True
    return request.weights is not None and is_network(request.weights)


def given_policy(request: LoopOptions, given: GivenTrim) -> GivenPolicy:
    """Return the policy that the options define, at a trim.

    Raises NoSolutionError if no trim is found or the game has no solution. Raises BadInputError if
    an option does not apply to the policy.
    """
    if request.policy is not None:
        refuse(request, _OF_NETWORKS, "cannot be combined with --policy; remove one of the two")
    if request.basis is not None and request.weights is None:
        raise BadInputError(
            "--basis applies only to W in --weights; add --weights, or remove --basis"
        )
    if not is_function(request):
        refuse(
            request,
            ("network", "set"),
            "applies only to a network in --weights; add --weights, or remove this option",
        )
    linear = linearize(given.model, trimmed(given))
    if not given.model.inputs:
        none = Gain(np.zeros((0, len(linear.states))), {})
        return GivenPolicy.of_gain(linear, none, "no inputs", None)
    game = weighted_game(given_weights(request), linear).game
    if request.policy is not None:
        known = [("P of the game", unconfirmed_solution(game).P)]
        return _deployment(request.policy, linear, known)
    if request.weights is None:
        try:
            solution = unconfirmed_solution(game)
        except NoSolutionError as error:
            raise NoSolutionError(
                f"the game of the linear model has no solution ({error}), so there is no policy; "
                "give a stabilizing policy with --weights"
            ) from error
        gain = Gain(np.array(solution.K, dtype=float), {})
        return GivenPolicy.of_gain(linear, gain, "gain of the game", solution.P)
    with prefix_errors(request.weights):
        critic = critic_in(request.weights, game, reading_of(request))
        if not is_network(request.weights):
            gain = Gain(np.array(critic.K, dtype=float), policy_terms(critic, linear.inputs))
            return GivenPolicy.of_gain(linear, gain, str(request.weights), critic.P)
    known = [("P of the game", unconfirmed_solution(game).P)]
    known += [] if critic.P is None else [("P of the critic", critic.P)]
    return GivenPolicy(linear, critic.policy, None, critic.origin, known)


def _deployment(
    path: Path, linear: LinearModel, known: Sequence[tuple[str, np.ndarray]]
) -> GivenPolicy:
    """Return the policy of a deployment file, applied in continuous time."""
    deployment = Deployment.load(path)
    function = continuous(Deployed(deployment, linear.point.model))
    words = (
        f"{path}, applied continuously, without its sampling ({deployment.dt:g} s) and delay "
        f"({deployment.delay:g} s)"
    )
    return GivenPolicy(linear, function, None, words, known)


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


def continuous(deployed: Deployed) -> ca.Function:
    """Return a deployed policy as a function (z, trim) -> deviations of all inputs from the trim.

    z are the deviations of the moving states. trim contains the values of all states, inputs and
    parameters. The inputs are not saturated.

    Raises BadInputError if the policy uses several samples, or if an observation or an action
    depends on an input.
    """
    model = deployed.model
    n, m = len(model.states), len(model.inputs)
    _refuse_inputs_taken(deployed)
    kind = type(symbols_for([deployed.stages], 1))
    z = kind.sym("z", len(model.linear))
    trim = kind.sym("trim", n + m + len(model.parameters))
    names = tuple(model.states)
    moving = ca.DM(n, len(model.linear))
    for column, name in enumerate(model.linear):
        moving[names.index(name), column] = 1.0
    X = trim[:n] + ca.sparsify(moving) @ z
    U = trim[n : n + m]
    a = deployed.stages(deployed.observe(X, U, trim))[2]
    commanded = deployed.unlimited_inputs(a, X, U, trim)
    return ca.Function("continuous", [z, trim], [ca.densify(commanded - U)])


def _refuse_inputs_taken(deployed: Deployed) -> None:
    """Raise BadInputError if a policy uses several samples, or depends on an input that it sets."""
    if deployed.past:
        raise BadInputError(
            "timing.history: a proof does not support a policy of several samples; give a policy "
            "of the present sample only"
        )
    entries = {
        "observation": (deployed.observe, 1, tuple(deployed.deployment.observation)),
        "action": (deployed.unlimited_inputs, 2, tuple(deployed.model.inputs)),
    }
    for table, (function, argument, names) in entries.items():
        taken = function.jac_sparsity(0, argument).get_triplet()[0]
        for row in sorted(taken):
            raise BadInputError(
                f"{deployed.deployment.origin}: {table}.{names[row]} depends on an input that "
                "the policy sets, which a proof does not support; use `hfa assess` instead"
            )
