"""Learn the value and the gain of the game with one of the critics; the weights go to a file for `hfa verify`."""

from __future__ import annotations

import argparse

from hfa_cli.options import shared_options as options
from hfa_cli.options.games import add_game, game_of
from hfa_cli.options.learning_options import add_learning, run_learning
from hfa_cli.output import show
from hfa_cli.progress import say_notes


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options of `hfa learn`."""
    add_game(parser)
    add_learning(parser)
    options.add_output(parser)


def run(arguments: argparse.Namespace) -> int:
    """Learn and report; exit 1 when a certificate does not hold."""
    named = game_of(arguments)
    result = run_learning(arguments, named.game)
    whole = result.report(*named.names, history=True)
    report = result.report(*named.names).with_data(**named.labels())
    show(report, arguments, target=arguments.output, only_in_files=whole.data)
    say_notes(named.warnings)
    return 0 if result.converged else 1
