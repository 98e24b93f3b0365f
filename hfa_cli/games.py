"""Options that name a game: the aircraft at a dihedral angle, or a plant of the user's own."""

from __future__ import annotations

import argparse
import math
from dataclasses import dataclass
from typing import Any

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
    state_units: tuple[str, ...]
    input_units: tuple[str, ...]
    origin: str

    def labels(self) -> dict[str, Any]:
        """What the numbers of a result are about; units are "" for a plant of the user's own."""
        named = {name: list(getattr(self, name)) for name in ("states", "inputs", "state_units", "input_units")}
        return {"plant": self.origin, **named, "delta": self.game.delta if math.isfinite(self.game.delta) else None}


def add_game(parser: argparse.ArgumentParser) -> None:
    """--dihedral or --model, and --delta, --Q, --R."""
    options.add_condition(parser, dihedral_required=False)
    options.add_aircraft(parser)
    parser.add_argument(
        "--model", metavar="FILE", help="a plant of your own: A, B, optionally E, Q, R (.mat .npz .json)"
    )
    parser.add_argument("--delta", metavar="NUMBER", help="disturbance weight, inf for none; default: the paper's 200")
    parser.add_argument("--Q", metavar="a,b,...", help="diagonal of Q; default: the paper's")
    parser.add_argument("--R", metavar="a,b,...", help="diagonal of R; default: the paper's")


def game_of(arguments: argparse.Namespace) -> NamedGame:
    """The game that the options name."""
    if (arguments.model is None) == (arguments.dihedral is None):
        raise BadInputError("name the plant: either --dihedral DEG or --model FILE")
    given = {name: parse_diagonal(name, text) for name in ("Q", "R") if (text := getattr(arguments, name)) is not None}
    delta = None if arguments.delta is None else _delta(arguments.delta)
    if arguments.model is not None:
        _refuse_options_of_the_aircraft(arguments)
        game = load_game(arguments.model, **given, delta=delta)
        n, m = game.B.shape
        states, inputs = (tuple(f"{letter}{i + 1}" for i in range(count)) for letter, count in (("x", n), ("u", m)))
        return NamedGame(game, states, inputs, ("",) * n, ("",) * m, str(arguments.model))
    aircraft = options.aircraft_of(arguments)
    model = linearize(aircraft, trim(aircraft, options.condition_of(arguments)))
    changes = given if delta is None else given | {"delta": delta}
    origin = f"the aircraft at dihedral {float(arguments.dihedral):g} deg, {aircraft.variant.name} dynamics"
    game = published_game(model.A, model.B, **changes)
    return NamedGame(game, model.states, model.inputs, model.state_units, model.input_units, origin)


def _delta(text: str) -> float:
    return math.inf if text.strip().lower() in ("inf", "infinity") else number(text, "delta")


def _refuse_options_of_the_aircraft(arguments: argparse.Namespace) -> None:
    """An option that would change nothing is a mistake."""
    names = ("speed", "altitude", "alpha", "gamma", "limit", "parameters")
    given = [name for name in names if getattr(arguments, name) is not None]
    given += ["dynamics"] * (arguments.dynamics != options.DEFAULT_DYNAMICS)
    if given:
        raise BadInputError(f"--{given[0]} belongs to the aircraft; leave it out with --model")
