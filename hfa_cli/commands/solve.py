"""The exact solution of the zero-sum game, its certificate, the smallest delta, and simulations of its policies.

A --model with B1, B2, C1, D12 and optionally C2, D21, D11, D22 is a generalized plant, as `hinfsyn` takes it: the
controller with a gain below delta, by default 1.01 delta_min.
"""

from __future__ import annotations

import argparse
from typing import Any

from controller.analysis.solution_report import analyse_game, solution_report
from hfa_cli.options import games, trims
from hfa_cli.options.parser import Options
from hfa_cli.output import ProgressLine, show


def options() -> Options:
    """Of `hfa solve`."""
    return {**games.game_options(), **trims.output()}


def run(arguments: argparse.Namespace) -> int:
    """Solve and report; a game without a certified solution is exit 1 and prints no P."""
    found = None
    if arguments.model is not None:
        from controller.game.array_file import read_arrays
        from controller.game.user_files import has_all

        found = read_arrays(arguments.model)
        if has_all(found, "B2"):
            return _solve_plant(arguments, found)
    named = games.game_of(arguments, found)
    report = solution_report(analyse_game(named.game, ProgressLine("solve")), *named.names)
    show(report.with_data(**named.labels()), arguments, target=arguments.output, notes=named.warnings)
    return 0


def _solve_plant(arguments: argparse.Namespace, found: dict[str, Any]) -> int:
    from controller.analysis.plant_report import plant_report
    from controller.riccati.generalized_plant import stored_plant

    games.refuse_of_the_aircraft(arguments)
    trims.refuse(arguments, ("Q", "R"), "is in C1 and D12 of a generalized plant; leave it out")
    plant, delta, notes = stored_plant(arguments.model, found)
    delta = delta if arguments.delta is None else arguments.delta
    report = plant_report(plant, delta, str(arguments.model)).with_data(warnings=list(notes))
    show(report, arguments, target=arguments.output, notes=notes)
    return 0
