"""The exact solution of the zero-sum game, its certificate, the smallest delta, and simulations of its policies.

A design with sensors is solved from their measurements too.
"""

from __future__ import annotations

import argparse
from dataclasses import replace

import numpy as np

from controller.analysis.solution_report import AnalysedGame, analyse_game, output_report, solution_report
from controller.riccati.output_feedback import OutputGame
from hfa_cli.options import shared_options as options
from hfa_cli.options.games import NamedGame, add_game, game_of
from hfa_cli.output import show
from hfa_cli.progress import ProgressLine, say_notes
from verification.synthesis.gust_cost import estimated_gust_cost, gust_cost


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options of `hfa solve`."""
    add_game(parser)
    options.add_output(parser)


def run(arguments: argparse.Namespace) -> int:
    """Solve and report; a game without a certified solution is exit 1 and prints no P."""
    named = game_of(arguments)
    found = analyse_game(named.game, ProgressLine("solve"))
    _show(found, named, arguments)
    say_notes(named.warnings)
    return 0


def _show(found: AnalysedGame, named: NamedGame, arguments: argparse.Namespace) -> None:
    report = solution_report(found, *named.names).with_data(**named.labels())
    built = named.built
    if built is not None:
        gust = gust_cost(built, named.game, found.solution.K)
        report = replace(report, parts=(*report.parts, gust.text())).with_data(worst_updraft=gust.to_dict())
    if built is not None and built.sensors:
        problem = OutputGame(named.game, built.C, built.D, built.V)
        measured = output_report(problem, built.sensors, built.sensor_units)
        Ak, Bk, Ck = (np.array(measured.data[name]) for name in ("Ak", "Bk", "Ck"))
        gust = estimated_gust_cost(built, named.game, (Ak, Bk, Ck))
        measured = replace(measured, parts=(*measured.parts, gust.text())).with_data(worst_updraft=gust.to_dict())
        report = replace(report, parts=(*report.parts, measured)).with_data(output_feedback=measured.data)
    show(report, arguments, target=arguments.output)
