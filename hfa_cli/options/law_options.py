"""Options of the law that is flown: exact, learned, or from a file, and the game that it solves."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING

from controller.game.zero_sum import Game, published_game
from hfa_cli.options import games, shared_options as options
from hfa_cli.options.argument_types import input_file, whole
from hfa_cli.options.games import MATRIX_FILES
from hfa_cli.options.learning_options import add_settings
from hfa_cli.options.parser import add_value
from hfa_model.support.errors import BadInputError, said_of
from trim.linear.linear_model import LinearModel

if TYPE_CHECKING:
    from controller.game.array_file import PlantNames
    from controller.game.zero_sum import Game
    from controller.policy.flown_law import FlownLaw

#: Laws of a simulation: the exact gain, or a learned one that comes with certificates.
LAWS = ("exact", "certified", "irl")
_FILES = ("gain", "weights")


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


def add_stored(parser: argparse.ArgumentParser) -> None:
    """--gain and --weights."""
    suffixes = " ".join(MATRIX_FILES)
    about = f"use the gain K in this file instead of a law ({suffixes})"
    add_value(parser, "--gain", input_file(*MATRIX_FILES), "FILE", about)
    about = f"use the policy of the critic in this file: quadratic weights W, or P, or K ({suffixes})"
    add_value(parser, "--weights", input_file(*MATRIX_FILES), "FILE", about)


def check_stored(arguments: argparse.Namespace) -> bool:
    """Whether a file takes the place of a law; BadInputError for options that then would change nothing."""
    given = [name for name in _FILES if getattr(arguments, name, None) is not None]
    if not given:
        return False
    if len(given) == 2:
        raise BadInputError("--gain and --weights do not go together; give one of them")
    option = f"--{given[0]}"
    if arguments.law != "certified" or arguments.set or getattr(arguments, "online", False):
        raise BadInputError(f"{option} takes the place of a law; leave out --law, --set and --online")
    of_the_game = ("delta", "Q", "R") if given[0] == "gain" else ("delta", "Q")
    options.refuse(arguments, of_the_game, f"belongs to the game of a law; leave it out with {option}")
    return True


def stored_law(arguments: argparse.Namespace, game: Game, plant: PlantNames) -> FlownLaw:
    """u = -K z of the file that the options name. game: whose B and R make K of a value; plant: of its states."""
    from controller.game.basis import basis
    from controller.game.critic_file import load_critic
    from controller.policy.flown_law import gain_law
    from verification.critic.candidate import from_gain, from_stored

    path = arguments.weights if arguments.gain is None else arguments.gain
    functions = basis("quadratic", len(game.A))
    stored = load_critic(path, plant, functions)
    if arguments.gain is not None and stored.K is None:
        raise BadInputError(f"{path}: there is no K; --gain needs a file that holds one")
    if arguments.gain is None and stored.W is not None and stored.W.size != functions.size:
        raise BadInputError(
            f"{path}: there are {stored.W.size} weights; a simulation takes the {functions.size} of the quadratic basis"
        )
    with said_of(path):
        K = from_stored(game, stored, functions).K if stored.K is None else from_gain(game, stored.K).K
    return gain_law(f"{'weights' if arguments.gain is None else 'gain'} of {path}", K)
