"""The game of a design, for commands with the option `--design`."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from controller.hfa_game import plant_names
from hfa_design.design_model import design_model
from hfa_support.errors import prefix_errors
from trim.linear.linear_model import LinearModel

if TYPE_CHECKING:
    from hfa.options.games import NamedGame, PlantOptions


def designed_game(request: PlantOptions, linear: LinearModel) -> NamedGame:
    """Return the game of the option --design at a trim, with the weights that other options change.

    Raises BadInputError for --units, because the weights of a design are in declared units.
    """
    from hfa.options.games import NamedGame

    why = "cannot be combined with --design, whose weights are in the units of the declaration"
    request.refuse(("units",), f"{why}; remove this option")
    built = design_model(linear.point.model, linear, request.design)
    with prefix_errors(f"design {built.design.name}"):
        game = replace(built.game(), **request.changed_weights())
    of_design = f"design {built.design.name} of {plant_names(linear).origin}"
    game = replace(game, names=game.names._replace(origin=of_design))
    whose = request.weights_from("design")
    return NamedGame(game, tuple(linear.point.warnings), weights_from=whose)
