"""Compare a critic with the exact game solution: our own laws, or weights, P or K from elsewhere.

Exit code 0 only when every check passes, or with --limit-cost when the critic costs no more than that.
"""

from __future__ import annotations

import argparse
import math
from pathlib import Path
from typing import Any

from controller.game.basis import basis
from controller.game.learning_result import LearningResult
from controller.game.model_file import load_critic
from hfa_cli import options
from hfa_cli.argument_types import input_file, positive
from hfa_cli.games import MATRIX_FILES, NamedGame, add_game, game_of
from hfa_cli.learning import add_learning, run_learning
from hfa_cli.origin import provenance
from hfa_cli.output import say_notes, show
from hfa_cli.parser import add_value
from hfa_model.support.errors import BadInputError
from verification.critic.candidate import Candidate, from_stored, from_weights
from verification.critic.check_report import check_report
from verification.critic.critic_check import LIMIT, CriticCheck, check_critic


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options of `hfa verify`."""
    add_game(parser)
    add_learning(parser)
    about = f"a critic from elsewhere: W, or P, or K ({' '.join(MATRIX_FILES)})"
    add_value(parser, "--weights", input_file(*MATRIX_FILES), "FILE", about)
    add_value(parser, "--basis", str, "NAME", "basis of --weights; default quadratic")
    about = f"limit of the relative errors; default {LIMIT:g}"
    add_value(parser, "--limit-error", positive, "X", about, default=LIMIT)
    about = "exit 0 when the critic costs at most this much more than the optimum"
    add_value(parser, "--limit-cost", positive, "PERCENT", about)
    options.add_picture(parser, "P learned, exact, difference, and errors over time")
    options.add_output(parser)


def run(arguments: argparse.Namespace) -> int:
    """Learn or load, check, report; exit 1 when a check fails."""
    if arguments.weights is None and arguments.basis is not None:
        raise BadInputError("--basis belongs to --weights; for a law, use --set basis=NAME")
    if arguments.weights is not None:
        options.refuse(arguments, ("law", "seed", "set"), "belongs to a law; leave it out with --weights")
    named = game_of(arguments)
    candidate, result = _candidate(arguments, named)
    time = None if result is None else result.settings.get("predefined_time")

    def at_dihedral(degrees: float) -> Any:
        return game_of(argparse.Namespace(**vars(arguments) | {"dihedral": math.radians(degrees)})).game

    check = check_critic(
        named.game,
        candidate,
        limit=arguments.limit_error,
        run=result,
        predefined_time=time,
        at_dihedral=None if arguments.dihedral is None else at_dihedral,
    )
    if arguments.picture is not None:
        _draw(check, named, result, time, arguments.picture)
    limit_cost = arguments.limit_cost
    report = check_report(check, named.states, named.inputs, named.origin, limit_cost).with_data(**named.labels())
    show(report, arguments, target=arguments.output)
    say_notes(named.warnings)
    return 0 if (check.ok if limit_cost is None else check.flight.within(limit_cost)) else 1


def _candidate(arguments: argparse.Namespace, named: NamedGame) -> tuple[Candidate, LearningResult | None]:
    if arguments.weights is None:
        result = run_learning(arguments, named.game)
        return from_weights(named.game, result.weights[-1], result.basis), result
    functions = basis("quadratic" if arguments.basis is None else arguments.basis, len(named.game.A))
    stored = load_critic(arguments.weights)
    try:
        return from_stored(named.game, stored, functions), None
    except BadInputError as error:
        raise BadInputError(f"{arguments.weights}: {error}") from error


def _draw(check: CriticCheck, named: NamedGame, result: LearningResult | None, time: float | None, path: Path) -> None:
    from hfa_model.support.figure import save
    from verification.critic.check_figure import check_figure

    save(check_figure(check, named.states, named.inputs, result, time), path, provenance().text())
