"""The exact solution of the zero-sum game, with its certificate, the smallest delta, and what it means in flight."""

from __future__ import annotations

import argparse

from hfa_cli import options
from hfa_cli.games import add_game, game_of
from hfa_cli.output import say_notes, show
from hfa_model.support.report import Report
from verification.meaning.solution_report import solution_data, solution_report, solution_table, solution_text


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options of `hfa solve`."""
    add_game(parser)
    options.add_output(parser)


def run(arguments: argparse.Namespace) -> int:
    """Solve and report; a game without a certified solution is exit 1 and prints no P."""
    named = game_of(arguments)
    report = solution_report(named.game)
    shown = Report(
        title="",
        parts=(solution_text(report, named.states, named.inputs, named.origin),),
        data=solution_data(report, named.states, named.inputs) | named.labels(),
        records=solution_table(report, named.states, named.inputs),
    )
    show(shown, as_json=arguments.json, target=arguments.output)
    say_notes(named.warnings)
    return 0
