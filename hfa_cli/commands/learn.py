"""Learn the value and the gain of the game with one of the critics; the weights go to a file for `hfa verify`."""

from __future__ import annotations

import argparse

from controller.laws.learning_report import learning_data, learning_table, learning_text
from hfa_cli import options
from hfa_cli.games import add_game, game_of
from hfa_cli.learning import add_learning, run_learning
from hfa_cli.output import deliver, say_notes, write


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options of `hfa learn`."""
    add_game(parser)
    add_learning(parser)
    options.add_output(parser)


def run(arguments: argparse.Namespace) -> int:
    """Learn and report; exit 1 when a certificate does not hold."""
    named = game_of(arguments)
    result = run_learning(arguments, named.game)
    if arguments.output is not None:
        # Files hold the whole history; on a terminal it would drown the result.
        write(arguments.output, learning_data(result, history=True) | named.labels(), lambda: learning_table(result))
    deliver(
        learning_data(result, history=False) | named.labels(),
        lambda: learning_text(result, named.states, named.inputs, named.origin),
        lambda: learning_table(result),
        as_json=arguments.json,
        target=None,
    )
    say_notes(named.warnings)
    return 0 if result.converged else 1
