"""Settings for reading critics from files."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import casadi as ca
import numpy as np

from controller.critic.critic import Critic
from controller.critic.features import basis_of
from controller.game.basis import Basis
from controller.game.zero_sum import Game

if TYPE_CHECKING:
    from trim.linear.linear_model import LinearModel

#: Array of a critic -> number of its dimensions.
DIMENSIONS = {"W": 1, "P": 2, "K": 2}


@dataclass(frozen=True)
class Reading:
    """Options for reading a critic file.

    basis: basis of the weights: a name, or a list of functions (`listed_functions`). None selects
        the basis named in the file, else "quadratic".
    network: outputs of a network file, as for `from_network`
    activation: activation between the layers of a state dict; after a comma, the activation of the
        output. None if not given.
    scale: (n,), factors on the states at the network's inputs, or None for no scaling
    linear: linear model of the game at a trim of an aircraft, or None for another plant
    """

    basis: str | None = None
    network: str = ""
    activation: str | None = None
    scale: np.ndarray | None = None
    linear: LinearModel | None = None

    def psi(self, game: Game) -> Basis | ca.Function:
        """Return the basis ψ of the weights for the states of a game (`basis_of`)."""
        return basis_of(self.basis or "quadratic", len(game.A), game.names.states)


class CriticFile(NamedTuple):
    """A critic file that was read, and what it states of its game.

    critic: function (game, settings) -> the critic, as a function of the game's states. Raises
        BadInputError if the file contains no critic of this game.
    is_network: whether the settings of networks apply
    plant: name of the plant, "" if the file has none
    inputs: the inputs that the policy moves, () if the file has none
    cost: "Q" and "R" -> name -> weight, empty if the file has none
    """

    critic: Callable[[Game, Reading], Critic]
    is_network: bool = False
    plant: str = ""
    inputs: tuple[str, ...] = ()
    cost: Mapping[str, Mapping[str, float]] = {}


def in_plant_units(
    parts: dict[str, np.ndarray], scales: np.ndarray, basis: Basis | ca.Function | None
) -> dict[str, np.ndarray]:
    """Return a critic's arrays, converted from the file's units to the units of the plant.

    x is a state in the units of the plant and diag(s) x this state in the units of the file.
    P becomes diag(s) P diag(s), K becomes K diag(s), and W becomes `basis.scaling(s)` W.
    An array whose shape does not fit the plant is returned unchanged. W is also returned unchanged
    if `basis` is not a `Basis`.

    parts: W (M,), P (n, n), K (m, n)
    scales: s, (n,)
    basis: ψ of W, or None without W
    """
    factors = {"K": scales, "P": np.outer(scales, scales)}
    if isinstance(basis, Basis) and len(scales) == basis.states:
        factors["W"] = basis.scaling(scales)
    converted = dict(parts)
    for name, factor in factors.items():
        if name in parts and parts[name].shape[-factor.ndim :] == factor.shape:
            converted[name] = parts[name] * factor
    return converted
