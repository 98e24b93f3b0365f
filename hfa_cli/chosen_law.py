"""The law that the options name, solved for or learned, with progress on a terminal."""

from __future__ import annotations

import argparse
import sys
from typing import TYPE_CHECKING

from controller.game.array_file import PlantNames
from controller.game.learning_result import LearningResult
from controller.game.zero_sum import Game
from hfa_cli.options.law_options import check_stored, game_on, seed_of, stored_law
from hfa_cli.options.learning_options import law_name, law_settings
from hfa_cli.progress import ProgressLine
from trim.linear.linear_model import LinearModel

if TYPE_CHECKING:
    from controller.policy.policies import FlownLaw


def run_learning(arguments: argparse.Namespace, game: Game) -> LearningResult:
    """Run the law that the options name, with progress on a terminal."""
    from controller.laws.learn import learn

    return learn(
        game,
        law_name(arguments),
        arguments.seed or 0,
        progress=show_learning if sys.stderr.isatty() else None,
        **law_settings(arguments),
    )


def flown_law_of(arguments: argparse.Namespace, model: LinearModel, online_tick: float | None = None) -> FlownLaw:
    """The gain that is used: exact, or learned on the linear model and frozen, or learned in flight tick by tick, s."""
    from controller.policy.learned_gain import frozen_law, learned_value, online_law
    from controller.policy.policies import gain_law
    from controller.riccati.gare import solve_game

    game = game_on(model, arguments)
    if check_stored(arguments):
        return stored_law(arguments, game, PlantNames(model.states, model.inputs, model.state_units))
    if arguments.law == "exact":
        return gain_law("exact", solve_game(game).K)
    told = show_learning if sys.stderr.isatty() else None
    learned = learned_value(game, arguments.law, seed_of(arguments), told, **law_settings(arguments))
    if online_tick is None:
        return frozen_law(arguments.law, learned)
    return online_law(game, arguments.law, learned, online_tick)


def show_learning(fraction: float, message: str) -> None:
    """One line on standard error, gone when done."""
    ProgressLine("learn").say(fraction, message)
