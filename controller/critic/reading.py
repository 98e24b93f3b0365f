"""How a file of a critic is read by packages of others."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple

import casadi as ca
import numpy as np

from controller.critic.critic import Critic
from controller.critic.features import basis_of
from controller.game.basis import Basis
from controller.game.zero_sum import Game
from hfa_aircraft.readers.matrices_file import FileScales
from hfa_aircraft.signals import PlantNames

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

    basis: str | list[str] | None = None
    network: str = ""
    activation: str | None = None
    scale: np.ndarray | None = None
    linear: LinearModel | None = None

    def psi(self, game: Game) -> Basis | ca.Function:
        """Return the basis ψ of the weights for the states of a game (`basis_of`)."""
        return basis_of(self.basis or "quadratic", len(game.A), game.names.states)


class CriticFile(NamedTuple):
    """A critic file that was read, and what it declares of its game.

    critic: function (game, settings) -> the critic, as a function of the game's states. Raises
        BadInputError if the file contains no critic of this game.
    is_network: whether the settings of networks apply
    inputs: the inputs that the policy moves, () if the file has none
    cost: "Q" and "R" -> name -> weight, empty if the file has none
    game: function of the plant's names -> Q, R, N, E, delta, dt and discount, those that the file
        has, in the units of the plant
    """

    critic: Callable[[Game, Reading], Critic]
    is_network: bool = False
    inputs: tuple[str, ...] = ()
    cost: Mapping[str, Mapping[str, float]] = {}
    game: Callable[[PlantNames], Mapping[str, Any]] = lambda names: {}


def in_plant_units(
    parts: Mapping[str, np.ndarray], scales: FileScales, basis: Basis | ca.Function | None = None
) -> dict[str, np.ndarray]:
    """Return a critic's arrays, converted from the file's units to the units of the plant.

    With the factors s of the states and r of the inputs, P becomes diag(s) P diag(s), K becomes
    diag(r)⁻¹ K diag(s), L becomes L diag(s), H becomes diag(s, r, 1) H diag(s, r, 1), and W becomes
    `basis.scaling(s)` W. Disturbances have no unit.
    An array whose shape does not fit the plant is returned unchanged. W is also returned unchanged
    if `basis` is not a `Basis`.

    parts: W (M,), P (n, n), K (m, n), L (k, n), H over (x, u) or (x, u, w)
    scales: factors from the plant's units to the file's units
    basis: ψ of W, or None without W
    """
    states = scales.states
    factors = {"K": scales.gain, "P": np.outer(states, states), "L": states}
    if isinstance(basis, Basis) and len(states) == basis.states:
        factors["W"] = basis.scaling(states)
    if "H" in parts:
        of_signals = np.concatenate([scales.states, scales.inputs])
        disturbances = np.atleast_1d(parts["H"]).shape[-1] - len(of_signals)
        of_signals = np.pad(of_signals, (0, max(disturbances, 0)), constant_values=1.0)
        factors["H"] = np.outer(of_signals, of_signals)
    converted = dict(parts)
    for name, factor in factors.items():
        fits_the_plant = name in parts and parts[name].shape[-factor.ndim :] == factor.shape
        if fits_the_plant:
            converted[name] = parts[name] * factor
    return converted
