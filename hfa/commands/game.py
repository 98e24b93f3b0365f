"""The commands `hfa solve` and `hfa learn`."""

from __future__ import annotations

import argparse
from typing import Any

from hfa.options import games, trims
from hfa.options.parser import Options, command
from hfa.output import ProgressLine, show


def _exact() -> Options:
    return {**games.game_options(), **trims.output()}


@command(_exact)
def solve(arguments: argparse.Namespace) -> int:
    """The exact solution of the zero-sum game, its certificate, the smallest delta, and simulations
    of its policies.

    Exit code 1 without a certified solution. A --model with B1, B2, C1, D12 and optionally C2, D21,
    D11, D22 is a generalized plant, as `hinfsyn` takes it: the controller with a gain below delta,
    by default 1.01 delta_min."""
    from controller.riccati.solution_report import analyse_game, solution_report

    found = None
    if arguments.model is not None:
        from controller.game.array_file import read_arrays
        from controller.game.user_files import has_all

        found = read_arrays(arguments.model)
        if has_all(found, "B2"):
            return _solve_plant(arguments, found)
    named = games.game_of(arguments, found)
    report = solution_report(analyse_game(named.game, ProgressLine("solve")), *named.names)
    show(report.with_data(**named.labels()), arguments, notes=named.warnings)
    return 0


def _solve_plant(arguments: argparse.Namespace, found: dict[str, Any]) -> int:
    from controller.servo.generalized_plant import stored_plant
    from controller.servo.plant_report import plant_report

    games.refuse_of_the_aircraft(arguments)
    trims.refuse(arguments, ("Q", "R"), "is in C1 and D12 of a generalized plant; leave it out")
    plant, delta, notes = stored_plant(arguments.model, found)
    delta = delta if arguments.delta is None else arguments.delta
    report = plant_report(plant, delta, str(arguments.model)).with_data(warnings=list(notes))
    show(report, arguments, notes=notes)
    return 0


def _learned() -> Options:
    return {**games.game_options(), **games.learning(), **trims.output()}


@command(_learned)
def learn(arguments: argparse.Namespace) -> int:
    """Learn the value and the gain of the game with a critic; the weights go to a file for `hfa
    verify`.

    Exit code 1 when a certificate does not hold.
    """
    named = games.game_of(arguments)
    result = games.run_learning(arguments, named.game)
    whole = result.report(*named.names, history=True).data
    report = result.report(*named.names).with_data(**named.labels())
    show(report, arguments, only_in_files=whole, notes=named.warnings)
    return 0 if result.converged else 1
