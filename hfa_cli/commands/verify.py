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
from hfa_cli.options import games, trims
from hfa_cli.options.argument_types import input_file, number, positive
from hfa_cli.options.games import MATRIX_FILES, NamedGame
from hfa_cli.options.parser import Option, Options
from hfa_cli.output import ProgressLine, draw, show
from hfa_support.errors import BadInputError, refuse_unknown, said_of
from verification.critic.candidate import features_of, from_network, from_stored, from_weights
from verification.critic.check_result import CriticCheck, check_figure, checks_figure, checks_report
from verification.critic.critic_check import LIMIT, check_critic, check_discounted, check_history
from verification.critic.critic_errors import ordinary_box
from verification.critic.network_file import ACTIVATIONS, NETWORK_FILES, is_network

#: Of more files than this, each network is flown from a few starts.
_MANY, _FEW_FLIGHTS = 5, 10
#: What --set says of a file of --weights -> the kind of its value, and what the file must be.
_SETTINGS: dict[str, tuple[Any, str]] = {
    "predefined_time": (positive, "critics over time"),
    "activation": (str, "networks"),
    "scale": (lambda text: [number(each) for each in text.split(",")], "networks"),
}


def _critics(text: str) -> list[Path]:
    """A file; of a folder those with a known suffix, in the order of the numbers in their names."""
    known, folder = (*MATRIX_FILES, *NETWORK_FILES), Path(text)
    if not folder.is_dir():
        return [input_file(*known)(text)]
    found = sorted(each for each in folder.iterdir() if each.suffix.lower() in known)
    if not found:
        raise argparse.ArgumentTypeError(f"{text}: there is no critic in the folder ({' '.join(known)})")
    return sorted(found, key=lambda each: [int(part) for part in re.findall(r"\d+", each.name)])


def options() -> Options:
    """Of `hfa verify`."""
    files = f"critics from elsewhere: W, P or K, with `time` also over time ({' '.join(MATRIX_FILES)}), or a network "
    files += f"of V, dV/dx or u ({' '.join(NETWORK_FILES)}); of several, or of a folder of checkpoints, one table"
    settings = (
        "a setting of the law; of --weights predefined_time=S, of a network scale=a,b,... (times each state) and "
    )
    settings += f"of a state dict activation={'|'.join(ACTIVATIONS)} between its layers, after a comma at its output"
    functions = "of --weights: a name (default quadratic), or a list 'x1**2, x1*x2, sin(x3)'"
    network = "which part of a file is what: value, V=critic,policy=actor, gradient=; default: by its number of outputs"
    cost = "exit 0 when the critic costs at most this much more than the optimum"
    return {
        **games.game_options(),
        **games.LEARNING,
        "--set": Option(settings, "NAME=VALUE", lambda _, text: text, named=True),
        "--weights": Option(files, "FILE", _critics, more={"nargs": "+"}),
        "--basis": Option(functions, "BASIS"),
        "--network": Option(network, "[V=]NAME"),
        "--discount": Option(
            "of the discounted problem in discrete time: factor of a step; with --dt", "NUMBER", positive
        ),
        "--dt": Option("length of a step of that problem; with --discount", "S", positive),
        "--limit-error": Option(
            f"limit of the relative errors; default {LIMIT:g}", "X", positive, more={"default": LIMIT}
        ),
        "--limit-cost": Option(cost, "PERCENT", positive),
        **trims.picture("P learned, exact, difference, and errors over time; of several critics their errors"),
        **trims.output(),
    }


def run(arguments: argparse.Namespace) -> int:
    """Learn or load, check, report; exit 1 when a check fails."""
    paths = [path for each in arguments.weights or [] for path in each]
    settings = _settings(arguments, paths)
    named = games.game_of(arguments)

    @cache
    def at_dihedral(degrees: float) -> Any:
        return games.game_of(argparse.Namespace(**vars(arguments) | {"at": math.radians(degrees)})).game

    how: dict[str, Any] = {
        "limit": arguments.limit_error,
        "box": ordinary_box(named.game, named.states, named.inputs, named.state_units),
        "at_dihedral": None if arguments.at is None else at_dihedral,
    }
    cost, checks = arguments.limit_cost, dict[str, CriticCheck]()
    if arguments.discount is not None:
        problem, limit = (arguments.discount, arguments.dt), arguments.limit_error
        critic = _candidate(paths[0], arguments, named, settings)
        if isinstance(critic, History):
            raise BadInputError(f"{paths[0]}: --discount judges one critic and this is over time; give one row of it")
        judged = check_discounted(named.game, critic, *problem, limit=limit)
        checks, report = {"": judged}, judged.report(*named.names, limit_cost=cost)
    elif len(paths) > 1:
        found, told = dict[str, CriticCheck](), ProgressLine("compare")
        for count, path in enumerate(paths):
            told(count, len(paths))
            found[str(path)] = _check_file(path, arguments, named, settings, how, len(paths))
        draw(arguments.picture, lambda: checks_figure(found, named.origin))
        checks, report = {**found}, checks_report(found, named.origin, cost)
    else:
        if paths:
            check = _check_file(paths[0], arguments, named, settings, how)
        else:
            result = games.run_learning(arguments, named.game)
            time = result.settings.get("predefined_time")
            candidate = from_weights(named.game, result.weights[-1], result.basis)
            check = check_critic(named.game, candidate, run=result, predefined_time=time, **how)
        draw(arguments.picture, lambda: check_figure(check, *named.names))
        checks, report = {"": check}, check.report(*named.names, limit_cost=cost)
    show(report.with_data(**named.labels()), arguments, target=arguments.output, notes=named.warnings)
    return 0 if all(check.holds(cost) for check in checks.values()) else 1


def _settings(arguments: argparse.Namespace, paths: list[Path]) -> dict[str, Any]:
    """What --set says of the files; BadInputError for options that would change nothing."""
    if not any(map(is_network, paths)):
        trims.refuse(arguments, ("network",), "belongs to a network; give its file by --weights")
    if (arguments.discount is None) != (arguments.dt is None):
        raise BadInputError("--discount and --dt belong together; neither has a default")
    if arguments.discount is not None:
        trims.refuse(arguments, ("picture",), "does not go with --discount; leave it out")
        if len(paths) != 1:
            raise BadInputError("--discount needs one file of --weights")
    if not paths:
        trims.refuse(arguments, ("basis",), "belongs to --weights; for a law, use --set basis=...")
        return {}
    trims.refuse(arguments, ("law", "seed"), "belongs to a law; leave it out with --weights")
    found = {}
    for name, text in (arguments.set or {}).items():
        refuse_unknown("a critic of a file has no setting", name, _SETTINGS)
        kind, of = _SETTINGS[name]
        if of == "networks" and not any(map(is_network, paths)):
            raise BadInputError(f"--set {name} belongs to networks; give the file of one by --weights")
        if of == "critics over time" and arguments.discount is not None:
            raise BadInputError(f"--set {name} does not go with --discount; leave it out")
        try:
            found[name] = kind(text)
        except argparse.ArgumentTypeError as error:
            raise BadInputError(f"--set {name} {error}") from error
    return found


def _candidate(
    path: Path, arguments: argparse.Namespace, named: NamedGame, settings: dict[str, Any], files: int = 1
) -> Any:
    """The critic in a file, or its `History`."""
    game, name = named.game, arguments.basis
    listed = name is not None and re.search(r"[^a-z+]", name) is not None
    n = len(game.A)
    functions: Any = features_of(name, n, named.states) if listed else basis(name or "quadratic", n)
    if is_network(path):
        activation = settings.get("activation")
        if files == 1 and path.suffix.lower() == ".onnx" and activation is not None:
            raise BadInputError(f"{path}: --set activation belongs to a state dict; an ONNX file says it")
        how: dict[str, Any] = {"network": arguments.network or "", "activation": activation}
        return from_network(game, path, features=functions, scale=settings.get("scale"), **how)
    found = critic_in(path, game, None if listed else name, named.plant)
    with said_of(path):
        if listed and (isinstance(found, History) or found.W is None):
            raise BadInputError("a list of --basis belongs to weights W without times; there are none")
        return found if isinstance(found, History) else from_stored(game, found, functions)


def _check_file(
    path: Path, arguments: argparse.Namespace, named: NamedGame, settings: dict[str, Any], how: Any, files: int = 1
) -> CriticCheck:
    """The critic in a file, or each of its rows where it has a time."""
    time, game = settings.get("predefined_time"), named.game
    found = _candidate(path, arguments, named, settings, files)
    if isinstance(found, History):
        with said_of(path):
            return check_history(game, found, predefined_time=time, progress=ProgressLine("compare"), **how)
    if time is not None:
        raise BadInputError(f"--set predefined_time belongs to a critic over time; {path} has no time")
    flown: dict[str, Any] = {"flights": _FEW_FLIGHTS} if files > _MANY else {}
    if found.nonlinear is not None and named.nonlinear is not None:
        flown["plant"] = named.nonlinear()
    return check_critic(game, found, **flown, **how)
