"""The game of a design, for commands with the option `--design`."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from controller.hfa_game import plant_names
from hfa_design.design_model import design_model
from hfa_support.errors import prefix_errors
from trim.linear.linear_model import LinearModel

if TYPE_CHECKING:
    from hfa.options.game import GameWeights, NamedGame
    from hfa_design.design import Design


def designed_game(design: Design, weights: GameWeights, linear: LinearModel) -> NamedGame:
    """Return the game of a design at a trim, with the weights that other options change."""
    from hfa.options.game import NamedGame

    built = design_model(linear.point.model, linear, design)
    with prefix_errors(f"design {built.design.name}"):
        game = replace(built.game(), **weights.changed)
    of_design = f"design {built.design.name} of {plant_names(linear).origin}"
    game = replace(game, names=game.names._replace(origin=of_design))
    return NamedGame(game, tuple(linear.point.warnings), weights_from=weights.sources("design"))
