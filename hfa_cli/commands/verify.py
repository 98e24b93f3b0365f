"""Compare a critic with the exact game solution: our own laws, or weights, P or K from elsewhere.

Exit code 0 only when every check passes, or with --limit-cost when the critic costs no more than that.
"""

from __future__ import annotations

import argparse
import math
from pathlib import Path
from typing import Any

from controller.game.basis import basis
from controller.game.critic_file import History, critic_in
from hfa_cli.options import shared_options as options
from hfa_cli.options.argument_types import input_file, parsed, positive
from hfa_cli.options.games import MATRIX_FILES, NamedGame, add_game, game_of
from hfa_cli.options.learning_options import add_learning, run_learning
from hfa_cli.options.parser import add_value
from hfa_cli.output import draw, show
from hfa_cli.progress import ProgressLine, say_notes
from hfa_support.errors import BadInputError, said_of
from verification.critic.candidate import from_run, from_stored
from verification.critic.check_result import CriticCheck, check_figure, check_report, checks_report
from verification.critic.critic_check import LIMIT, check_critic, check_history
from verification.critic.critic_errors import ordinary_box
from verification.critic.network_check import OUTPUTS, check_network, network_critic
from verification.critic.network_file import ACTIVATIONS, NETWORK_FILES, network_in

_OF_NETWORKS = ("activation", "network", "network_output", "scale")


def _numbers(text: str) -> list[float]:
    return [float(each) for each in text.split(",")]


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options of `hfa verify`."""
    add_game(parser)
    add_learning(parser)
    about = f"critics from elsewhere: W, P or K, with `time` also over time ({' '.join(MATRIX_FILES)}), or a network "
    about += f"of V, dV/dx or u ({' '.join(NETWORK_FILES)}); of several, one table"
    add_value(parser, "--weights", input_file(*MATRIX_FILES, *NETWORK_FILES), "FILE", about, nargs="+")
    add_value(parser, "--basis", str, "NAME", "basis of --weights; default quadratic")
    about = f"between the layers of a state dict: {', '.join(ACTIVATIONS)}"
    add_value(parser, "--activation", str, "NAME", about)
    add_value(parser, "--network", str, "NAME", "which network of a state dict: how its names begin")
    about = f"what a network computes: {', '.join(OUTPUTS)}; default: what its number of outputs says"
    add_value(parser, "--network-output", str, "NAME", about)
    add_value(parser, "--scale", parsed(_numbers), "a,b,...", "a network takes each state times this; default 1")
    about = "by when the errors of --weights over time must be within the limit for good"
    add_value(parser, "--predefined-time", positive, "S", about)
    about = f"limit of the relative errors; default {LIMIT:g}"
    add_value(parser, "--limit-error", positive, "X", about, default=LIMIT)
    about = "exit 0 when the critic costs at most this much more than the optimum"
    add_value(parser, "--limit-cost", positive, "PERCENT", about)
    options.add_picture(parser, "P learned, exact, difference, and errors over time")
    options.add_output(parser)


def run(arguments: argparse.Namespace) -> int:
    """Learn or load, check, report; exit 1 when a check fails."""
    paths = arguments.weights or []
    if len(paths) > 1:
        options.refuse(arguments, ("picture",), "draws one critic; leave it out with several files of --weights")
    if not any(path.suffix.lower() in NETWORK_FILES for path in paths):
        options.refuse(arguments, _OF_NETWORKS, "belongs to a network; give its file by --weights")
    for name in ("basis", "predefined_time"):
        if arguments.weights is None and getattr(arguments, name) is not None:
            option = name.replace("_", "-")
            raise BadInputError(f"--{option} belongs to --weights; for a law, use --set {name}=...")
    if arguments.weights is not None:
        options.refuse(arguments, ("law", "seed", "set"), "belongs to a law; leave it out with --weights")
    named = game_of(arguments)

    def at_dihedral(degrees: float) -> Any:
        return game_of(argparse.Namespace(**vars(arguments) | {"dihedral": math.radians(degrees)})).game

    options_of_all = {
        "limit": arguments.limit_error,
        "box": ordinary_box(named.game, named.states, named.inputs, named.state_units),
        "at_dihedral": None if arguments.dihedral is None else at_dihedral,
    }
    limit_cost, result, time = arguments.limit_cost, None, None
    if len(paths) > 1:
        checks = {str(path): _check_file(path, arguments, named, options_of_all) for path in paths}
        show(
            checks_report(checks, named.origin, limit_cost).with_data(**named.labels()),
            arguments,
            target=arguments.output,
        )
        say_notes(named.warnings)
        return 0 if all(check.holds(limit_cost) for check in checks.values()) else 1
    if arguments.weights is None:
        result = run_learning(arguments, named.game)
        time = result.settings.get("predefined_time")
        check = check_critic(
            named.game, from_run(named.game, result), run=result, predefined_time=time, **options_of_all
        )
    else:
        check = _check_file(paths[0], arguments, named, options_of_all)
    draw(arguments.picture, lambda: check_figure(check, *named.names, run=result, predefined_time=time))
    report = check_report(check, *named.names, limit_cost=limit_cost).with_data(**named.labels())
    show(report, arguments, target=arguments.output)
    say_notes(named.warnings)
    return 0 if check.holds(limit_cost) else 1


def _check_file(
    path: Path, arguments: argparse.Namespace, named: NamedGame, options_of_all: dict[str, Any]
) -> CriticCheck:
    """The critic in a file, or each of its rows where it has a time."""
    time, game = arguments.predefined_time, named.game
    functions = basis("quadratic" if arguments.basis is None else arguments.basis, len(game.A))
    if path.suffix.lower() in NETWORK_FILES:
        if time is not None:
            raise BadInputError(f"--predefined-time belongs to a critic over time; {path} is a network")
        of_file = arguments.activation, arguments.network
        if len(arguments.weights) > 1 and path.suffix.lower() == ".onnx":
            of_file = None, None  # they are for the state dicts among several files
        network = network_in(path, len(game.A), *of_file, functions.size)
        with said_of(path):
            critic = network_critic(game, network, functions, arguments.network_output, arguments.scale)
            return check_network(game, critic, fly=arguments.limit_cost is not None, **options_of_all)
    found = critic_in(path, game, arguments.basis, named.plant)
    if not isinstance(found, History) and time is not None:
        raise BadInputError(f"--predefined-time belongs to a critic over time; {path} has no time")
    with said_of(path):
        if isinstance(found, History):
            told = ProgressLine("compare")
            return check_history(game, found, predefined_time=time, progress=told, **options_of_all)
        return check_critic(game, from_stored(game, found, functions), **options_of_all)
