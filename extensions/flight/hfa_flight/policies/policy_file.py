"""Policies in files: gains, tables of gains, critics, networks and deployments."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np

from controller.critic.critic import Critic
from controller.critic.critic_file import Reading, critic_in, entries_in, is_network
from controller.critic.network.declared import NOTHING
from controller.game.linear_game import names_of_linear
from controller.game.zero_sum import Game
from hfa_flight.air.signals import CommandSteps
from hfa_flight.policies.filtered_policy import behind_own_filter
from hfa_flight.policies.laws import DEPLOYMENT, GAIN, NETWORK, TABLE
from hfa_flight.policies.policy import GainPolicy, Policy, function_policy
from hfa_flight.policies.scheduled_gains import scheduled_gains
from hfa_flight.schedule.gain_schedule import load_gain_schedule
from hfa_support.errors import BadInputError
from trim.linear.linear_model import LinearModel
from trim.point.condition import TrimCondition, usual_condition
from trim.point.operating_point import OperatingPoint


def kind_of_file(path: Path) -> str:
    """Return the kind of the policy in a file."""
    if path.suffix.lower() == ".toml":
        return DEPLOYMENT
    if is_network(path):
        return NETWORK
    return TABLE if np.ndim(entries_in(path).get("K", 0.0)) == 3 else GAIN


def policy_of_file(
    path: Path,
    point: OperatingPoint,
    game: Game | None = None,
    reading: Reading | None = None,
    condition: Callable[[float], TrimCondition] | None = None,
    commands: CommandSteps | None = None,
) -> Policy:
    """Return the policy in a file, about a trim.

    A policy that is not linear, such as a network, is saturated at the control limits of the model.

    game: the game whose cost gives the policy of a value; None if the file contains a policy
    reading: how a critic or network is read, None for the defaults
    condition: function from the scheduling variable to the trim condition of a gain table, None for
        the usual one
    commands: steps of the scheduling variable that a gain table follows

    Raises BadInputError if the file contains no policy of this aircraft.
    """
    kind = kind_of_file(path)
    if kind == DEPLOYMENT:
        return behind_own_filter(path, point)
    if kind == TABLE:
        schedule = load_gain_schedule(path, point.model)
        at = condition or usual_condition(point.model).at
        return scheduled_gains(f"gains of {path}", schedule, point, at, commands)
    critic = critic_in(path, game or _without_cost(point.linearize()), reading)
    if game is None:
        _refuse_value(path, critic)
    if not critic.has_linear_policy:
        # notes on a game without a cost say nothing
        stated = critic.stated if game or kind == NETWORK else NOTHING
        return function_policy(f"critic of {path}", critic.policy, point, stated)
    kind = "gain" if critic.slope_gain is None else "weights"
    return GainPolicy(f"{kind} of {path}", critic.K)


def _without_cost(linear: LinearModel) -> Game:
    """Return a game with the states and inputs of a linear model, whose cost means nothing."""
    n, m = np.shape(linear.B)
    return Game(linear.A, linear.B, Q=np.ones(n), R=np.ones(m), names=names_of_linear(linear))


def _refuse_value(path: Path, critic: Critic) -> None:
    """Raise BadInputError if the policy of a critic follows from its value, and thus from R."""
    if critic.slope_gain is not None:
        raise BadInputError(
            f"{path}: the policy of this value depends on the cost; give hfa.read_critic(FILE, "
            "game) in place of the file"
        )
