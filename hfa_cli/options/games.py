"""Options that name a game: the aircraft at a dihedral angle, or a plant of the user's own."""

from __future__ import annotations

import argparse
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any

import casadi as ca

from controller.design.design_model import DesignModel, design_model
from controller.game.array_file import MATRIX_FILES, PlantNames
from controller.game.model_file import parse_diagonal, stored_game
from controller.game.zero_sum import Game, published_game, usual_game
from hfa_cli.options import shared_options as options
from hfa_cli.options.argument_types import OWN, disturbance_weight, input_file, parsed
from hfa_cli.options.parser import add_value
from hfa_model.vectors import LINEAR_UNITS
from hfa_support.errors import BadInputError, said_of
from hfa_support.model import Model
from hfa_support.reporting.text import numbered
from hfa_support.reporting.unit_system import entries_in_force
from trim.linear.linear_model import LinearModel, linearize


@dataclass(frozen=True, eq=False)
class NamedGame:
    """A game with the names of its states and inputs, and where it comes from; `built` when that is a design.

    nonlinear: where there is a trim, makes (z, u) -> z', the aircraft about it.
    """

    game: Game
    states: tuple[str, ...]
    inputs: tuple[str, ...]
    state_units: tuple[str, ...]
    input_units: tuple[str, ...]
    origin: str
    warnings: tuple[str, ...] = ()
    built: DesignModel | None = None
    plant_provenance: Mapping[str, str] = field(default_factory=dict)
    nonlinear: Callable[[], ca.Function] | None = None

    @property
    def names(self) -> tuple[tuple[str, ...], tuple[str, ...], str, tuple[str, ...], tuple[str, ...]]:
        """States, inputs, what the plant is called, units of states and inputs: how reports take them."""
        return self.states, self.inputs, self.origin, self.state_units, self.input_units

    @property
    def plant(self) -> PlantNames:
        """What a file of a critic is read against."""
        return PlantNames(self.states, self.inputs, self.state_units)

    def labels(self) -> dict[str, Any]:
        """What the numbers of a result are about; units are "" for a plant of the user's own."""
        named = {name: list(getattr(self, name)) for name in ("states", "inputs", "state_units", "input_units")}
        delta = self.game.delta if math.isfinite(self.game.delta) else None
        origin = {"plant_provenance": dict(self.plant_provenance)} if self.plant_provenance else {}
        return {"plant": self.origin, **origin, **named, "delta": delta, "warnings": list(self.warnings)}


def add_game(parser: argparse.ArgumentParser) -> None:
    """--dihedral, with a design or without, or --model, and the weights."""
    options.add_condition(parser, dihedral_required=False)
    options.add_own(parser)
    options.add_aircraft(parser)
    about = f"a plant of your own: A, B, optionally E, Q, R ({' '.join(MATRIX_FILES)})"
    options.add_design(parser)
    add_value(parser, "--model", input_file(*MATRIX_FILES), "FILE", about)
    add_weights(parser)


def add_weights(parser: argparse.ArgumentParser) -> None:
    """--delta, --Q, --R."""
    about = "disturbance weight, inf for none; default: the paper's 200"
    add_value(parser, "--delta", disturbance_weight, "NUMBER", about)
    for name in ("Q", "R"):
        diagonal = parsed(partial(parse_diagonal, name))
        add_value(parser, f"--{name}", diagonal, "a,b,...", f"diagonal of {name}; default: the paper's")


def weights_of(arguments: argparse.Namespace, state_units: tuple[str, ...] = LINEAR_UNITS) -> dict[str, Any]:
    """Changes of the published game that the options name; Q, typed in `unit_in_force`, in these units."""
    found = {name: value for name in ("Q", "R", "delta") if (value := getattr(arguments, name)) is not None}
    if "Q" in found and len(found["Q"]) == len(state_units):
        found["Q"] = entries_in_force(found["Q"], (state_units, 1), (state_units, 1))
    return found


def game_of(arguments: argparse.Namespace, found: dict[str, Any] | None = None) -> NamedGame:
    """The game that the options name; found: what has been read of --model already."""
    if OWN.get() is not None and arguments.model is None:
        return _game_of_own(arguments)
    if (arguments.model is None) == (arguments.dihedral is None):
        raise BadInputError("name the plant: either --dihedral DEG or --model FILE")
    if arguments.model is not None:
        refuse_of_the_aircraft(arguments)
        game, notes, names, provenance = stored_game(arguments.model, found=found, **weights_of(arguments))
        n, m = game.B.shape
        plain = {"states": numbered("x", n), "inputs": numbered("u", m), "state_units": ("",) * n}
        labels = plain | {"input_units": ("",) * m} | names
        return NamedGame(game, **labels, origin=str(arguments.model), warnings=notes, plant_provenance=provenance)
    aircraft = options.aircraft_of(arguments)
    point = options.operating_point_of(arguments, aircraft)
    model = linearize(aircraft, point)
    origin = f"the aircraft at dihedral {math.degrees(arguments.dihedral):g} deg, {aircraft.variant.name} dynamics"
    if arguments.design is not None:
        built = design_model(aircraft, model, arguments.design)
        return _designed(built, origin, weights_of(arguments, built.state_units))
    game = published_game(model.A, model.B, **weights_of(arguments))
    units = model.state_units, model.input_units
    flown = partial(_about_trim, aircraft.model, model)
    return NamedGame(game, model.states, model.inputs, *units, origin, tuple(point.warnings), nonlinear=flown)


def refuse_of_the_aircraft(arguments: argparse.Namespace) -> None:
    """BadInputError where an option of the aircraft comes with --model."""
    of_the_aircraft: tuple[str, ...] = (*options.OF_THE_TRIM, "parameters", "design")
    of_the_aircraft += ("units",) * hasattr(arguments, "units")
    of_the_aircraft += ("dynamics",) * (arguments.dynamics != options.DEFAULT_DYNAMICS)
    options.refuse(arguments, of_the_aircraft, "belongs to the aircraft; leave it out with --model")


def _game_of_own(arguments: argparse.Namespace) -> NamedGame:
    """The game on the linear model of the user's own aircraft, its weights by nominal values unless given.

    Of the unsteady dynamics it is the paper's game, with weight 0 on the lag states.
    """
    what = "--dynamics unsteady" if arguments.aircraft is None else "--aircraft"
    options.refuse(arguments, ("model",), f"does not go with {what}; leave one out")
    own = options.own_of(arguments)
    assert own is not None
    model = linearize(own, options.operating_point_of(arguments, own))
    if arguments.design is not None:
        built = design_model(own, model, arguments.design)
        return _designed(built, own.title, weights_of(arguments, built.state_units))
    units, warnings = (model.state_units, model.input_units), (*model.point.warnings, *model.kinks)
    if arguments.aircraft is None:
        origin = f"the aircraft at dihedral {math.degrees(model.point.states.dihedral):g} deg, {own.title}"
        return NamedGame(game_on(arguments, model), model.states, model.inputs, *units, origin, warnings)
    missing = [name for name in ("Q", "R", "delta") if name not in weights_of(arguments, model.state_units)]
    note = f"{' and '.join(missing)} not given: Q, R are 1/nominal^2 on the diagonal, delta is inf (no disturbance)"
    notes = (*warnings, *[note] * bool(missing))
    return NamedGame(
        game_on(arguments, model),
        model.states,
        model.inputs,
        *units,
        own.name,
        notes,
        nonlinear=partial(_about_trim, own, model),
    )


def game_on(arguments: argparse.Namespace, model: LinearModel) -> Game:
    """The usual game on a linear model, with the weights that the options change."""
    return usual_game(model.point.model, model.A, model.B, **weights_of(arguments, model.state_units))


def _about_trim(model: Model, linear: LinearModel) -> ca.Function:
    """(z, u) -> z' of the nonlinear model, deviations from the trim; states that the linear model lacks are held."""
    z, u = (ca.SX.sym(name, len(each)) for name, each in (("z", linear.states), ("u", linear.inputs)))
    moved = dict(zip((*linear.states, *linear.inputs), (*ca.vertsplit(z), *ca.vertsplit(u)), strict=True))
    trim = linear.point.states._asdict(), linear.point.inputs._asdict()
    at = [[value + moved.get(name, 0.0) for name, value in each.items()] for each in trim]
    rates, _ = model.layout.expressions((*at, model.p.tolist()), ())
    return ca.Function("plant", [z, u], [rates[[list(model.states).index(name) for name in linear.states]]])


def _designed(built: DesignModel, origin: str, changes: dict[str, Any]) -> NamedGame:
    """The game of a design model, with the weights that the options change."""
    with said_of(f"design {built.design.name}"):
        game = replace(built.game(), **changes)
    names = built.states, built.inputs, built.state_units, built.input_units
    where = f"design {built.design.name} of {origin}"
    return NamedGame(game, *names, where, tuple(built.model.point.warnings), built)
