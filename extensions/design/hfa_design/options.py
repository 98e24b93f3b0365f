"""The option --design, and the game of a design for the commands that have it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from controller.hfa_game import plant_names
from hfa.options.aircraft import is_own
from hfa.options.part import OfModel, option
from hfa_aircraft.model import Model
from hfa_design.design import NAMED, Design, load_design
from hfa_support.errors import prefix_errors
from trim.linear.linear_model import LinearModel

if TYPE_CHECKING:
    from hfa.options.game import GameWeights, NamedGame


def about_design(model: Model) -> str:
    """Return the help of --design for a model, with the shipped designs for the HFA."""
    shipped = "" if is_own(model) else f"{', '.join(NAMED)}, or "
    return f"design with actuators and weights: {shipped}a .toml file"


def design_option(about: str | Callable[[Model], str] = about_design) -> Any:
    """Return the request field `design`, with the option --design for a design with actuators and
    weights.

    about: help of the option
    """
    return option(about, "NAME", OfModel(_design))


def _design(model: Model, name: str) -> Design:
    return load_design(name, model)


def designed_game(design: Design, weights: GameWeights, linear: LinearModel) -> NamedGame:
    """Return the game of a design at a trim, with the weights that other options change."""
    from hfa.options.game import NamedGame
    from hfa_design.design_models import design_model

    built = design_model(linear.point.model, linear, design)
    with prefix_errors(f"design {built.design.name}"):
        game = replace(built.game(), **weights.changed)
    of_design = f"design {built.design.name} of {plant_names(linear).origin}"
    game = replace(game, names=game.names._replace(origin=of_design))
    weights_from = weights.sources(otherwise="design")
    notes = tuple(linear.point.warnings)
    if built.sensors:
        notes += ("solved with state feedback; `hfa design` uses the measured outputs alone",)
    return NamedGame(game, notes, weights_from=weights_from)
