"""Hold a critic against the exact game solution: our own laws, or weights, P or K from elsewhere.

Exit code 0 only when every check holds.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

from controller.game.basis import Basis, basis
from controller.game.learning_result import LearningResult
from controller.game.model_file import load_critic
from hfa_cli import options
from hfa_cli.argument_types import input_file, positive
from hfa_cli.games import MATRIX_FILES, NamedGame, add_game, game_of
from hfa_cli.learning import add_learning, run_learning
from hfa_cli.output import say_notes, show
from hfa_cli.parser import add_value
from hfa_model.support.errors import BadInputError
from hfa_model.vectors import LINEAR_STATES
from verification.critic.candidate import Candidate, from_stored, from_weights
from verification.critic.check_report import check_report
from verification.critic.critic_check import LIMIT, ORDINARY_DEVIATIONS, CriticCheck, check_critic


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options of `hfa verify`."""
    add_game(parser)
    add_learning(parser)
    about = f"a critic from elsewhere: W, or P, or K ({' '.join(MATRIX_FILES)})"
    add_value(parser, "--weights", input_file(*MATRIX_FILES), "FILE", about)
    add_value(parser, "--basis", str, "NAME", "basis of --weights; default quadratic")
    about = f"limit of the relative errors; default {LIMIT:g}"
    add_value(parser, "--limit-error", positive, "X", about, default=LIMIT)
    options.add_picture(parser, "P learned, exact, difference, and errors over time")
    options.add_output(parser)


def run(arguments: argparse.Namespace) -> int:
    """Learn or load, check, report; exit 1 when a check fails."""
    if arguments.weights is None and arguments.basis is not None:
        raise BadInputError("--basis belongs to --weights; for a law, use --set basis=NAME")
    if arguments.weights is not None:
        options.refuse(arguments, ("law", "seed", "set"), "belongs to a law; leave it out with --weights")
    named = game_of(arguments)
    functions, candidate, result = _candidate(arguments, named)
    time = None if result is None else result.settings.get("predefined_time")
    check = check_critic(
        named.game, candidate, functions, limit=arguments.limit_error, box=_box(named), run=result, predefined_time=time
    )
    if arguments.picture is not None:
        _draw(check, named, functions, result, time, arguments.picture)
    report = check_report(check, named.states, named.inputs, named.origin).with_data(**named.labels())
    show(report, as_json=arguments.json, target=arguments.output)
    say_notes(named.warnings)
    return 0 if check.ok else 1


def _candidate(arguments: argparse.Namespace, named: NamedGame) -> tuple[Basis, Candidate, LearningResult | None]:
    n = len(named.game.A)
    if arguments.weights is not None:
        functions = basis("quadratic" if arguments.basis is None else arguments.basis, n)
        stored = load_critic(arguments.weights)
        try:
            return functions, from_stored(named.game, stored, functions), None
        except BadInputError as error:
            raise BadInputError(f"{arguments.weights}: {error}") from error
    result = run_learning(arguments, named.game)
    functions = basis(result.basis, n)
    return functions, from_weights(named.game, result.weights[-1], functions), result


def _box(named: NamedGame) -> np.ndarray | None:
    """Half widths of the box in which policies are compared: ordinary deviations of the aircraft, else the judge's."""
    return np.array(ORDINARY_DEVIATIONS) if named.states == LINEAR_STATES else None


def _draw(
    check: CriticCheck,
    named: NamedGame,
    functions: Basis,
    result: LearningResult | None,
    time: float | None,
    path: Path,
) -> None:
    from hfa_model.support.figure import save
    from verification.critic.check_figure import check_figure

    save(check_figure(check, named.states, named.inputs, functions, result, time), path)
