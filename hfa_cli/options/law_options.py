"""Options of the law that is flown: exact, learned, or from a file, and the game that it solves."""

from __future__ import annotations

import argparse

from controller.game.zero_sum import Game, published_game
from hfa_cli.options import games
from hfa_cli.options.argument_types import whole
from hfa_cli.options.learning_options import add_settings
from hfa_cli.options.parser import add_value
from hfa_cli.options.stored_law import check_stored
from hfa_model.support.errors import BadInputError
from trim.linear.linear_model import LinearModel

#: Laws of a simulation: the exact gain, or a learned one that comes with certificates.
LAWS = ("exact", "certified", "irl")


def add_weights(parser: argparse.ArgumentParser, laws: tuple[str, ...] = LAWS) -> None:
    """--law (one of `laws`) or a file in its place, --set, --seed, --delta, --Q, --R."""
    parser.add_argument("--law", default="certified", metavar="NAME", help=f"{', '.join(laws)}; default certified")
    add_settings(parser)
    add_value(parser, "--seed", whole(0), "N", "seed of the recorded data and of the turbulence; default 0")
    games.add_weights(parser)


def game_on(model: LinearModel, arguments: argparse.Namespace) -> Game:
    """The published game on a model, with the weights that the options name."""
    return published_game(model.A, model.B, **games.weights_of(arguments))


def law_of(arguments: argparse.Namespace, laws: tuple[str, ...] = LAWS) -> str:
    """The law that the options name, one of `laws`."""
    law: str = arguments.law
    if law not in laws:
        raise BadInputError(f"unknown law {law!r}; choose one of: {', '.join(laws)}")
    return law


def check_learning(arguments: argparse.Namespace) -> None:
    """BadInputError for an unknown law, and for options of learning where nothing is learned."""
    stored = check_stored(arguments)
    if law_of(arguments) != "exact" and not stored:
        return
    for name in ("online", "set"):
        if getattr(arguments, name, None):
            raise BadInputError(f"--{name} belongs to a learning law; with --law exact there is nothing to learn")
    if arguments.seed is not None and getattr(arguments, "turbulence", None) is None:
        raise BadInputError("--seed belongs to a learning law or to --turbulence; here nothing is random")


def seed_of(arguments: argparse.Namespace) -> int:
    """The seed that the options name."""
    return 0 if arguments.seed is None else int(arguments.seed)
