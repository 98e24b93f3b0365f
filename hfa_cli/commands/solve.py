"""The exact solution of the zero-sum game, its certificate, the smallest delta, and simulations of its policies."""

from __future__ import annotations

import argparse
from dataclasses import replace

from hfa_cli import options
from hfa_cli.games import add_game, game_of
from hfa_cli.output import say_notes, show
from verification.meaning.solution_report import analyse_game, solution_report


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options of `hfa solve`."""
    add_game(parser)
    options.add_output(parser)


def run(arguments: argparse.Namespace) -> int:
    """Solve and report; a game without a certified solution is exit 1 and prints no P."""
    named = game_of(arguments)
    report = solution_report(analyse_game(named.game), named.states, named.inputs, named.origin)
    show(replace(report, data=dict(report.data) | named.labels()), arguments, target=arguments.output)
    say_notes(named.warnings)
    return 0
