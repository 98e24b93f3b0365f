"""The exact solution of the zero-sum game, its certificate, the smallest delta, and simulations of its policies.

A design with sensors is solved from their measurements too.
"""

from __future__ import annotations

import argparse
from dataclasses import replace

from controller.analysis.solution_report import analyse_game, output_report, solution_report
from controller.riccati.output_feedback import OutputGame
from hfa_cli.options import shared_options as options
from hfa_cli.options.games import add_game, game_of
from hfa_cli.output import show
from hfa_cli.progress import ProgressLine, say_notes


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options of `hfa solve`."""
    add_game(parser)
    options.add_output(parser)


def run(arguments: argparse.Namespace) -> int:
    """Solve and report; a game without a certified solution is exit 1 and prints no P."""
    named = game_of(arguments)
    found = analyse_game(named.game, ProgressLine("solve"))
    report = solution_report(found, *named.names).with_data(**named.labels())
    built = named.built
    if built is not None and built.sensors:
        problem = OutputGame(named.game, built.C, built.D, built.V)
        measured = output_report(problem, built.sensors, built.sensor_units)
        report = replace(report, parts=(*report.parts, measured)).with_data(output_feedback=measured.data)
    show(report, arguments, target=arguments.output)
    say_notes(named.warnings)
    return 0
