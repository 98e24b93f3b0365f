"""`hfa prove region` of a network or a deployment file, which boxes prove."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import casadi as ca

from controller.critic.critic import symbols_for
from hfa_boxes.commands.region import ProvedPolicy, check, prove
from hfa_policy.deployed import Deployed
from hfa_policy.deployment import Deployment
from hfa_support.errors import BadInputError, said_of
from trim.linear.linear_model import LinearModel

if TYPE_CHECKING:
    from controller.game.zero_sum import Game
    from hfa_region.commands.region import RegionRequest

#: Options of the other prover.
_OF_SQUARES = ("degree", "disturbance", "resume", "picture")
_OF_NETWORKS = ("weights", "basis", "network", "set")


def prove_on_boxes(request: RegionRequest) -> int:
    """Prove the region of a network or a deployment file; the exit code."""
    from controller.riccati.gare import solve_game

    request.refuse(_OF_SQUARES, "does not go with a network or --policy; leave it out")
    linear, policy, game = _policy_of(request)
    known = [("P of the game", solve_game(game).P), *policy.known]
    tried = ProvedPolicy(policy.function, policy.words, known, policy.not_covered)
    return prove(request, linear, tried, request.seconds)


def checked_on_boxes(request: RegionRequest, certificate: Path) -> int:
    """Verify the certificate of a region that is proved on boxes; the exit code."""
    linear, policy, _ = _policy_of(request)
    return check(request, certificate, linear, policy, request.model if request.own else None)


def _policy_of(request: RegionRequest) -> tuple[LinearModel, ProvedPolicy, Game]:
    """The linear model at the trim, the policy of --weights or --policy, and the game."""
    from controller.critic.critic_file import critic_in

    if request.policy is not None:
        request.refuse(_OF_NETWORKS, "does not go with --policy; leave it out")
    named = request.game()
    assert named.linear is not None
    if request.policy is not None:
        return named.linear, card_policy(request.policy, named.linear), named.game
    assert request.weights is not None
    with said_of(request.weights):
        critic = critic_in(request.weights, named.game, request.reading())
    known = [] if critic.P is None else [("P of the critic", critic.P)]
    return named.linear, ProvedPolicy(critic.policy, critic.origin, known), named.game


def card_policy(path: Path, linear: LinearModel) -> ProvedPolicy:
    """A deployment file whose action is computed and applied at every instant."""
    deployment = Deployment.load(path)
    timing = f"sample time {deployment.dt:g} s, delay {deployment.delay:g} s"
    return ProvedPolicy(
        continuous(deployment.on(linear.point.model)),
        f"{path}, applied continuously; actuators, disturbances not covered",
        not_covered=f"{timing} not covered",
    )


def continuous(deployed: Deployed) -> ca.Function:
    """(z, trim) -> deviations of all inputs from the trim, before the limits of the aircraft.

    z: deviations of the moving states; trim: all states, the inputs and the parameters

    BadInputError where an observation or a map takes an input, which the policy itself moves.
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
    """BadInputError naming the first observation or map that depends on an input, and for a policy
    that takes several samples."""
    if deployed.past:
        raise BadInputError("timing.history: a proof needs a policy of one sample; leave it out")
    entries = {
        "observation": (deployed.observe, 1, tuple(deployed.deployment.observation)),
        "action": (deployed.unlimited_inputs, 2, tuple(deployed.model.inputs)),
    }
    for table, (function, argument, names) in entries.items():
        taken = function.jac_sparsity(0, argument).get_triplet()[0]
        for row in sorted(taken):
            raise BadInputError(
                f"{deployed.deployment.origin}: {table}.{names[row]} depends on an input, which "
                "has no continuous meaning here; `hfa assess` flies such a policy"
            )
