"""Deployment files as critics: policies without their sample time and delay, for `hfa verify`."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from pathlib import Path
from shlex import quote

import casadi as ca
import numpy as np

from controller.critic.critic import Critic, from_functions
from controller.critic.features import symbols_for
from controller.critic.reading import CriticFile, Reading
from controller.game.zero_sum import Game
from hfa_flight.policies.deployment.deployed import Deployed
from hfa_flight.policies.deployment.deployment import Deployment
from hfa_support.errors import BadInputError
from trim.linear.linear_model import LinearModel


def read_deployment(path: str | Path) -> CriticFile:
    """Return a deployment file as a critic file, with its inputs and its cost."""
    deployment = Deployment.load(path)
    return CriticFile(
        partial(_critic, path, deployment),
        is_network=True,  # `_critic` itself refuses the settings of networks
        inputs=tuple(deployment.action),
        cost=deployment.cost or {},
    )


def _critic(path: str | Path, deployment: Deployment, game: Game, reading: Reading) -> Critic:
    """Return the policy of a deployment file in continuous time, u(z) in deviations from the trim.

    The policy has its observations, normalizer, box and maps of actions, but neither sample time
    nor delay, and no limits of the inputs.

    game: game on the linear model, whose inputs are those that the policy moves
    reading: its `linear` is the linear model of the aircraft

    Raises BadInputError if the aircraft is missing, the game has other inputs, or the policy is not
    a function of the states.
    """
    linear = reading.linear
    if linear is None:
        raise BadInputError(
            "a deployment file requires an aircraft; give --policy FILE (fly, optimize, prove), "
            "--aircraft or --dihedral (verify), or linear=LINEAR (hfa.read_critic)"
        )
    if reading.basis or reading.network or reading.activation or reading.scale is not None:
        raise BadInputError(
            "a deployment file states how its policy is read; remove --basis, --network and --set"
        )
    deployed = Deployed(deployment, linear.point.model)
    _refuse_other_inputs(deployed, game)
    command = f"hfa assess {quote(str(path))}"
    by_flights = f"type {command}, with the same aircraft and trim, to judge it as deployed"
    if deployed.observe.jac_sparsity(0, 1).nnz():  # of the observations by U, its second argument
        raise BadInputError(f"an observation depends on the inputs; {by_flights}")
    deployed.refuse_undefined_at([linear.point])
    z = symbols_for([deployed.act], len(game.A))
    u = _inputs_at(z, deployed, linear, game.names.inputs)
    actor, normalizer = deployment.actor, deployment.normalizer
    parts = [f"policy {Path(path).name}: {actor.chain}"]
    if normalizer is not None:
        parts.append(f"normalizer {normalizer.origin}")
    parts.append(
        f"with its action boxes, without sample time ({deployment.dt:g} s), delay and input limits"
    )
    critic = from_functions(game, z, {"policy": u}, ", ".join(parts))
    return replace(critic, declared=actor.declared)


def _refuse_other_inputs(deployed: Deployed, game: Game) -> None:
    """Raise BadInputError unless the policy moves all inputs of the game and no others."""
    if set(deployed.commanded) != set(game.names.inputs):
        names = ",".join(deployed.commanded)
        raise BadInputError(
            f"the policy moves {names.replace(',', ', ')}, and the game "
            f"{', '.join(game.names.inputs)}; add --inputs {names}",
            ("--inputs", names),  # the option that mends it
        )


def _inputs_at(z: ca.SX, deployed: Deployed, linear: LinearModel, names: tuple[str, ...]) -> ca.SX:
    """Return the policy's inputs at the deviations z of the linear states, from the trim, (m',).

    names: names of the returned inputs
    """
    point = linear.point
    model = point.model
    # Matrices from the linear states to all states, and from all inputs to those with the names.
    from_linear = np.eye(len(model.states))[:, model.state_places(linear.states)]
    named = np.eye(len(model.inputs))[model.input_places(names)]
    X = ca.DM(point.x) + ca.DM(from_linear) @ z
    U = ca.DM(point.u)
    trim = ca.DM(deployed.trim_vector(point))
    commanded = deployed.unlimited_inputs(deployed.act(deployed.observe(X, U, trim)), X, U, trim)
    return ca.DM(named) @ (commanded - U)
