"""Options that name a game: the aircraft at a dihedral angle, or a plant of the user's own."""

from __future__ import annotations

import argparse
from dataclasses import dataclass

from controller.game import Game, published_game
from controller.model_file import load_game, parse_diagonal
from hfa_cli import options
from hfa_cli.values import number
from hfa_model.errors import BadInputError
from trim.linearize import linearize
from trim.solve import trim


@dataclass(frozen=True, eq=False)
class NamedGame:
    """A game with the names of its states and inputs, and where it comes from."""

    game: Game
    states: tuple[str, ...]
    inputs: tuple[str, ...]
    origin: str


def add_game(parser: argparse.ArgumentParser) -> None:
    """--dihedral or --model, and --delta, --Q, --R."""
    options.add_condition(parser, dihedral_required=False)
    options.add_aircraft(parser)
    parser.add_argument(
        "--model", metavar="FILE", help="a plant of your own: A, B, optionally E, Q, R (.mat .npz .json)"
    )
    parser.add_argument("--delta", metavar="NUMBER", help="disturbance weight; default: the paper's 200")
    parser.add_argument("--Q", metavar="a,b,...", help="diagonal of Q; default: the paper's")
    parser.add_argument("--R", metavar="a,b,...", help="diagonal of R; default: the paper's")


def game_of(arguments: argparse.Namespace) -> NamedGame:
    """The game that the options name."""
    if (arguments.model is None) == (arguments.dihedral is None):
        raise BadInputError("name the plant: either --dihedral DEG or --model FILE")
    given = {name: parse_diagonal(name, getattr(arguments, name)) for name in ("Q", "R") if getattr(arguments, name)}
    delta = None if arguments.delta is None else number(arguments.delta, "delta")
    if arguments.model is not None:
        game = load_game(arguments.model, **given, delta=delta)
        n, m = game.B.shape
        states = tuple(f"x{i + 1}" for i in range(n))
        return NamedGame(game, states, tuple(f"u{i + 1}" for i in range(m)), str(arguments.model))
    aircraft = options.aircraft_of(arguments)
    model = linearize(aircraft, trim(aircraft, options.condition_of(arguments)))
    changes = given if delta is None else given | {"delta": delta}
    origin = f"the aircraft at dihedral {float(arguments.dihedral):g} deg, {aircraft.variant.name} dynamics"
    return NamedGame(published_game(model.A, model.B, **changes), model.states, model.inputs, origin)
