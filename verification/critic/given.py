"""Conversion of a user's critic (file, solution, training run, network or gain) to a `Critic`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from controller.critic.critic import Critic, from_parts
from controller.critic.critic_file import critic_in
from controller.riccati.gare import Solution
from hfa_support.entry_points import CRITICS, part
from hfa_support.errors import BadInputError

if TYPE_CHECKING:
    from controller.game.training_run import TrainingRun
    from controller.game.zero_sum import Game


def critic_given(
    game: Game, given: Any, parts: dict[str, Any], run: TrainingRun | None
) -> tuple[Critic, TrainingRun | None]:
    """Return the critic that a user gives, and the training run that ends with it, or None.

    game: the game
    given: file, solution, training run, network or gain K; None if parts define the critic
    parts: "K", "P", "W" -> array or None
    run: the training run of a file or a gain, or None if unknown

    Raises BadInputError if no critic is given, or if the given object is not a critic of the game.
    """
    if isinstance(given, (str, Path)):
        return critic_in(given, game), run
    if hasattr(given, "state_dict"):
        return part(CRITICS, "module", "a network")(game, given), run
    if hasattr(given, "critic"):
        return given.critic(game), given
    if isinstance(given, Solution):
        parts = {"P": given.P, "K": given.K}
    elif callable(given):
        raise BadInputError(
            "the critic is a function; give a gain K, a solution, a training run, a torch "
            "network, a file, or a critic such as from_network(game, CASADI_FUNCTION)"
        )
    elif given is not None:
        parts = {"K": given}
    named = {name: array for name, array in parts.items() if array is not None}
    return from_parts(game, named), run
