"""Compare a critic with the exact game solution: our own laws, or weights, P, K or networks from elsewhere.

Exit code 0 only when every check passes, or with --limit-cost when the critic costs no more than that.
"""

from __future__ import annotations

import argparse
import math
import re
from functools import cache
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
from verification.critic.candidate import features_of, from_network, from_stored, from_weights
from verification.critic.check_result import CriticCheck, check_figure, checks_figure, checks_report
from verification.critic.critic_check import LIMIT, check_critic, check_discounted, check_history
from verification.critic.critic_errors import ordinary_box
from verification.critic.network_file import ACTIVATIONS, NETWORK_FILES, is_network

_OF_NETWORKS = ("activation", "network", "scale")
#: Of more files than this, each network is flown from a few starts.
_MANY, _FEW_FLIGHTS = 5, 10


def _numbers(text: str) -> list[float]:
    return [float(each) for each in text.split(",")]


def _critic(text: str) -> Path:
    """A file, or a folder of them."""
    return Path(text) if Path(text).is_dir() else input_file(*MATRIX_FILES, *NETWORK_FILES)(text)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options of `hfa verify`."""
    add_game(parser)
    add_learning(parser)
    about = f"critics from elsewhere: W, P or K, with `time` also over time ({' '.join(MATRIX_FILES)}), or a network "
    about += f"of V, dV/dx or u ({' '.join(NETWORK_FILES)}); of several, or of a folder of checkpoints, one table"
    add_value(parser, "--weights", _critic, "FILE", about, nargs="+")
    add_value(parser, "--basis", str, "NAME", "basis of --weights; default quadratic")
    add_value(parser, "--features", str, "LIST", "a basis of your own: 'x1**2, x1*x2, sin(x3)'")
    about = f"between the layers of a state dict: {', '.join(ACTIVATIONS)}; after a comma, at its output"
    add_value(parser, "--activation", str, "NAME", about)
    about = "which part of a file is what: value, V=critic,policy=actor, gradient=; default: by its number of outputs"
    add_value(parser, "--network", str, "[V=]NAME", about)
    add_value(parser, "--scale", parsed(_numbers), "a,b,...", "a network takes each state times this; default 1")
    about = "of the discounted problem in discrete time: factor of a step; with --dt"
    add_value(parser, "--discount", positive, "NUMBER", about)
    add_value(parser, "--dt", positive, "S", "length of a step of that problem; with --discount")
    about = "by when the errors of --weights over time must be within the limit for good"
    add_value(parser, "--predefined-time", positive, "S", about)
    about = f"limit of the relative errors; default {LIMIT:g}"
    add_value(parser, "--limit-error", positive, "X", about, default=LIMIT)
    about = "exit 0 when the critic costs at most this much more than the optimum"
    add_value(parser, "--limit-cost", positive, "PERCENT", about)
    options.add_picture(parser, "P learned, exact, difference, and errors over time; of several critics their errors")
    options.add_output(parser)


def run(arguments: argparse.Namespace) -> int:
    """Learn or load, check, report; exit 1 when a check fails."""
    paths = _files(arguments.weights or [])
    if not any(map(is_network, paths)):
        options.refuse(arguments, _OF_NETWORKS, "belongs to a network; give its file by --weights")
    for name in ("basis", "features", "predefined_time"):
        if arguments.weights is None and getattr(arguments, name) is not None:
            option = name.replace("_", "-")
            raise BadInputError(f"--{option} belongs to --weights; for a law, use --set {name}=...")
    if arguments.weights is not None:
        options.refuse(arguments, ("law", "seed", "set"), "belongs to a law; leave it out with --weights")
    if arguments.features is not None:
        options.refuse(arguments, ("basis", "predefined_time"), "does not go with --features; leave it out")
    discounted = (arguments.discount, arguments.dt)
    if None in discounted and any(discounted):
        raise BadInputError("--discount and --dt belong together; neither has a default")
    named = game_of(arguments)

    @cache
    def at_dihedral(degrees: float) -> Any:
        return game_of(argparse.Namespace(**vars(arguments) | {"dihedral": math.radians(degrees)})).game

    options_of_all = {
        "limit": arguments.limit_error,
        "box": ordinary_box(named.game, named.states, named.inputs, named.state_units),
        "at_dihedral": None if arguments.dihedral is None else at_dihedral,
    }
    limit_cost, result, time = arguments.limit_cost, None, None
    if arguments.discount is not None:
        if len(paths) != 1:
            raise BadInputError("--discount needs one file of --weights")
        options.refuse(arguments, ("picture", "predefined_time"), "does not go with --discount; leave it out")
        judged = check_discounted(
            named.game, _candidate(paths[0], arguments, named), *discounted, limit=arguments.limit_error
        )
        report = judged.report(*named.names, limit_cost=limit_cost).with_data(**named.labels())
        show(report, arguments, target=arguments.output)
        say_notes(named.warnings)
        return 0 if judged.holds(limit_cost) else 1
    if len(paths) > 1:
        told = ProgressLine("compare")
        checks = {}
        for count, path in enumerate(paths):
            told(count, len(paths))
            checks[str(path)] = _check_file(path, arguments, named, options_of_all, len(paths))
        draw(arguments.picture, lambda: checks_figure(checks, named.origin))
        report = checks_report(checks, named.origin, limit_cost)
    else:
        if arguments.weights is None:
            result = run_learning(arguments, named.game)
            time = result.settings.get("predefined_time")
            candidate = from_weights(named.game, result.weights[-1], result.basis)
            check = check_critic(named.game, candidate, run=result, predefined_time=time, **options_of_all)
        else:
            check = _check_file(paths[0], arguments, named, options_of_all)
        checks = {"": check}
        draw(arguments.picture, lambda: check_figure(check, *named.names))
        report = check.report(*named.names, limit_cost=limit_cost)
    show(report.with_data(**named.labels()), arguments, target=arguments.output)
    say_notes(named.warnings)
    return 0 if all(check.holds(limit_cost) for check in checks.values()) else 1


def _files(paths: list[Path]) -> list[Path]:
    """The files, of a folder those with a known suffix in the order of the numbers in their names."""
    found, known = [], (*MATRIX_FILES, *NETWORK_FILES)
    for path in paths:
        inside = [path]
        if path.is_dir():
            inside = sorted(each for each in path.iterdir() if each.suffix.lower() in known)
            inside.sort(key=lambda each: [int(part) for part in re.findall(r"\d+", each.name)])
        if not inside:
            raise BadInputError(f"{path}: there is no critic in the folder ({' '.join(known)})")
        found += inside
    return found


def _candidate(path: Path, arguments: argparse.Namespace, named: NamedGame, files: int = 1) -> Any:
    """The critic in a file, or its `History`."""
    game, n = named.game, len(named.game.A)
    functions: Any = basis("quadratic" if arguments.basis is None else arguments.basis, n)
    if arguments.features is not None:
        functions = features_of(arguments.features, n, named.states)
    if is_network(path):
        if files == 1 and path.suffix.lower() == ".onnx" and arguments.activation is not None:
            raise BadInputError(f"{path}: --activation belongs to a state dict; an ONNX file says it")
        how: dict[str, Any] = {"network": arguments.network or "", "activation": arguments.activation}
        return from_network(game, path, features=functions, scale=arguments.scale, **how)
    found = critic_in(path, game, arguments.basis, named.plant)
    with said_of(path):
        if arguments.features is not None and (isinstance(found, History) or found.W is None):
            raise BadInputError("--features belongs to weights W without times; there are none")
        return found if isinstance(found, History) else from_stored(game, found, functions)


def _check_file(
    path: Path, arguments: argparse.Namespace, named: NamedGame, options_of_all: dict[str, Any], files: int = 1
) -> CriticCheck:
    """The critic in a file, or each of its rows where it has a time."""
    time, game = arguments.predefined_time, named.game
    found = _candidate(path, arguments, named, files)
    if isinstance(found, History):
        told = ProgressLine("compare")
        with said_of(path):
            return check_history(game, found, predefined_time=time, progress=told, **options_of_all)
    if time is not None:
        raise BadInputError(f"--predefined-time belongs to a critic over time; {path} has no time")
    flown: dict[str, Any] = {"flights": _FEW_FLIGHTS} if files > _MANY else {}
    if found.nonlinear is not None and named.nonlinear is not None:
        flown["plant"] = named.nonlinear()
    return check_critic(game, found, **flown, **options_of_all)
