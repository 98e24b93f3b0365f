"""The command `hfa verify`."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache, partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from controller.critic.critic_file import critic_suffixes, critics_in, is_network
from controller.game.zero_sum import Game
from hfa.commands.game import GameRequest
from hfa.learning import Learning, setting_option
from hfa.options.argument_types import positive, whole
from hfa.options.critics import READING_SETTINGS, ReadingGiven, critic_path
from hfa.options.draws import draws_option, with_draws
from hfa.options.game import CONTINUOUS, NamedGame
from hfa.options.output import Output, ProgressLine, picture_option
from hfa.options.part import option, part
from hfa.options.request import command
from hfa_aircraft.model import Model
from hfa_support.errors import BadInputError, prefix_errors, refuse_unknown
from hfa_support.files import MATRIX_FILES, note_read
from hfa_support.progress import with_progress
from verification.critic import critic_check
from verification.scope import LIMIT, SECONDS, Nearby, Scheduled, Scope
from verification.verdict import NEAR, Verdict

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from controller.critic.critic import Critic
    from controller.game.discrete_game import DiscreteGame

#: With more files than this, a critic that is not quadratic is simulated from only a few initial
#: conditions.
_MANY = 5
_FEW_FLIGHTS = 10
#: Dihedral angles, deg, where the search for the angle of a critic begins.
_ANGLES = (1.0, 3.0, 5.0, 8.0, 12.0, 16.0, 20.0)
#: Setting of --set -> type of its value, for files of --weights. The last two apply to networks.
_SETTINGS: dict[str, Callable[[str], Any]] = {
    "predefined_time": positive,
    **READING_SETTINGS,
}


def _critics(text: str) -> list[Path]:
    """Return the paths of the critic files given by --weights.

    text: path of one file, or of a folder with critic files. The files of a folder are sorted by
        the numbers in their names.

    Raises BadInputError if the folder contains no critic, if the file does not exist, or if its
    suffix is not supported.
    """
    folder = Path(text)
    if not folder.is_dir():
        return [critic_path(text)]
    suffixes = critic_suffixes()
    paths = sorted(path for path in folder.iterdir() if path.suffix.lower() in suffixes)
    note_read(folder)
    if not paths:
        raise BadInputError(
            f"{text}: the folder contains no critic ({' '.join(suffixes)}); choose another folder"
        )
    return sorted(paths, key=lambda path: [int(part) for part in re.findall(r"\d+", path.name)])


def _about_weights(_: Model) -> str:
    """Return the help of --weights with the suffixes of critic files."""
    others = [suffix for suffix in critic_suffixes() if suffix not in MATRIX_FILES]
    return (
        f"critic to check: W, P or K, optionally over `time` ({' '.join(MATRIX_FILES)}), or a "
        f"network of V, dV/dx or u ({' '.join(others)}); several files or a folder of checkpoints "
        "are reported in one table"
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class VerifyRequest(GameRequest):
    """Options of `hfa verify`."""

    learning: Learning = part(
        Learning,
        set=setting_option(
            "setting of the learning law or of a critic: predefined_time=S (critic over time), "
            "scale=a,b,... (network: factor on each state), activation=HIDDEN[,OUTPUT] (state "
            "dict)",
            _SETTINGS,
        ),
    )
    reading: ReadingGiven = part(ReadingGiven)
    output: Output = part(
        Output,
        picture=picture_option(
            "P, the exact P, their difference and errors over time, or errors of several critics"
        ),
    )
    weights: tuple[list[Path], ...] = option(
        _about_weights,
        "FILE",
        _critics,
        default=(),
        count="+",
    )
    discount: float | None = option("discount factor per sample; requires --dt", "NUMBER", positive)
    dt: float | None = option("sample time, s; requires --discount", "S", positive)
    limit_error: float = option(
        f"largest accepted relative error; default {LIMIT:g}", "X", positive, default=LIMIT
    )
    limit_cost: float | None = option(
        "largest excess of the cost above the optimum for exit code 0, percent", "PERCENT", positive
    )
    region: float | None = option(
        "add the region of attraction of the saturated loop, searched for S seconds",
        "S",
        positive,
        package="hfa_prove",
    )
    flights: int | None = option(
        "add N nonlinear flights with the critic, compared with the best flights found",
        "N",
        whole(1),
        package="hfa_optimal",
    )
    draws: int | None = draws_option()


@command(VerifyRequest)
def verify(request: VerifyRequest) -> int:
    """Compare a critic with the exact solution of the game.

    The critic is read from --weights, or learned as by `hfa learn`. The exit code is 0 if
    every check passes or the cost is within --limit-cost, and 1 otherwise."""
    paths = [path for files in request.weights for path in files]
    _refuse_unused(request, paths)
    if request.draws is not None and len(paths) > 1:
        raise BadInputError(
            "--draws requires a single critic; remove --draws, or give a single file with --weights"
        )
    named = request.named_game() if paths else request.game.game(request.aircraft, request.trim)
    if named.discrete is not None:
        return _verify_discrete(request, named, named.discrete, paths)
    scope = _scope(request, named)
    verdicts = {}
    progress = ProgressLine("compare")
    if not paths:
        run = request.learning.learned(named.game)
        verdicts[f"the law {run.law!r}, seed {run.seed},"] = critic_check.verify(
            named.game, run.critic(named.game), run=run, limit=request.limit_error, scope=scope
        )
    else:
        progress(0, len(paths))
    for path in with_progress(paths, progress):
        with named.asking_for_time():
            verdicts[str(path)] = _check_file(path, request, named, scope, len(paths))
    cost = request.limit_cost
    judged = list(verdicts.values())
    origin = named.game.names.origin
    if len(verdicts) == 1:
        ((source, verdict),) = verdicts.items()
        lines = _about(named, verdict, cost)
        report = verdict.report(limit_cost=cost, about=lines, source=source)
    else:
        from verification.verdict import verdicts_report

        report = verdicts_report(verdicts, origin, cost)
    report = report.with_data(**named.as_data(), **named.weights.as_data())
    if request.region is not None:
        from hfa_prove.commands.section import with_region

        report = with_region(report, judged, named, request.region)
    if request.flights is not None:
        from hfa_optimal.commands.section import with_flights

        report = with_flights(report, judged, named, request.flights)
    subject = (named, judged[-1].critic.K)
    report = with_draws(report, request.draws, request.aircraft, request.trim, subject)
    request.show(report, figure=partial(_figure, verdicts, origin), notes=named.warnings)
    return 0 if all(verdict.holds(cost) for verdict in judged) else 1


def _verify_discrete(
    request: VerifyRequest, named: NamedGame, problem: DiscreteGame, paths: Sequence[Path]
) -> int:
    """Check one critic of a game in discrete time and return the exit code.

    paths: one path, of a file with W, P, K, L or H or of a network

    Raises BadInputError unless exactly one path is given.
    """
    from controller.discrete.critic_file import critic_of_steps
    from verification.critic.discrete import check_discrete

    if len(paths) != 1:
        raise BadInputError(
            "a discrete-time plant requires exactly one critic; give --weights FILE once"
        )
    names = ("discount", "dt", "region", "flights", "draws", "output.picture")
    request.refuse(names, CONTINUOUS)
    (path,) = paths
    critic, more = critic_of_steps(path, problem, request.reading.reading(request.learning.set))
    scope = Scope(progress=ProgressLine("prove"))
    with prefix_errors(path):
        verdict = check_discrete(problem, critic, limit=request.limit_error, more=more, scope=scope)
    cost = request.limit_cost
    lines = _about(named, verdict, cost)
    report = verdict.report(limit_cost=cost, about=lines, source=str(path))
    report = report.with_data(**named.as_data(), **named.weights.as_data())
    request.show(report, notes=named.warnings)
    return 0 if verdict.holds(cost) else 1


def _figure(verdicts: Mapping[str, Verdict], origin: str) -> Figure:
    """Return a figure that compares critics with the exact solution.

    - one critic: the critic and the exact solution
    - several critics: their errors

    verdicts: source of each critic -> its verdict
    origin: description of the game
    """
    from verification.figures import verdicts_figure

    return verdicts_figure(verdicts, origin)


def _about(named: NamedGame, verdict: Verdict, limit_cost: float | None) -> list[str]:
    """Return the lines of the report on Q, R and delta of the game.

    If the grade is "near" and no cost limit is given, a line on --limit-cost is added.

    named: the game
    verdict: verdict on the critic
    limit_cost: value of --limit-cost, percent, or None if not given
    """
    lines = [named.weights_line()]
    if limit_cost is None and verdict.grade == "near":
        lines.append(f"Near the optimum, exit code 1; --limit-cost {NEAR:g} accepts it")
    return lines


def _scope(request: VerifyRequest, named: NamedGame) -> Scope:
    """Return the scope of the checks. The critic is compared with other games only if a dihedral
    angle is given.
    """
    nearby = None if request.trim.at is None else partial(_nearby, request, named.game)
    return Scope(nearby=nearby)


def _nearby(request: VerifyRequest, game: Game) -> Nearby:
    """Return other games, to one of which a critic may belong by mistake.

    - the games of the printed matrices whose B has the same shape
    - the games at other dihedral angles

    request: the options of `hfa verify`
    game: the game of the request
    """
    from hfa_model.published import published_models

    @cache
    def game_at(degrees: float) -> Game:
        at = replace(request.trim, at=math.radians(degrees))
        return request.game.game(request.aircraft, at).game

    printed = {
        f"of the matrices printed for {pair.dihedral_deg:g} deg": replace(game, A=pair.A, B=pair.B)
        for pair in published_models()
        if pair.B.shape == game.B.shape
    }
    return Nearby(
        printed, Scheduled(lambda degrees: f"at dihedral {degrees:.4f} deg", game_at, _ANGLES)
    )


def _refuse_unused(request: VerifyRequest, paths: list[Path]) -> None:
    """Raise BadInputError if an option of `hfa verify` has no effect or contradicts another option.

    paths: files of critics, empty if the critic is learned
    """
    if not any(map(is_network, paths)):
        request.refuse(
            ("reading.network",), "applies only to a network; give a network with --weights"
        )
        for name in ("activation", "scale") if paths else ():
            if name in request.learning.set:
                raise BadInputError(
                    f"--set {name} applies only to a network; give a network with --weights"
                )
    if (request.discount is None) != (request.dt is None):
        raise BadInputError("--discount and --dt require each other; give both options")
    if request.discount is not None:
        request.refuse(
            ("output.picture",), "cannot be combined with --discount; remove one of the two"
        )
        if len(paths) != 1:
            raise BadInputError(
                "--discount requires a single critic; give a single file with --weights"
            )
        if "predefined_time" in request.learning.set:
            raise BadInputError(
                "--set predefined_time cannot be combined with --discount; remove one of the two"
            )
    if not paths:
        request.refuse(
            ("reading.basis",),
            "applies only to --weights; for a learning law, give --set basis=...",
        )
        return
    request.learning.refuse(
        ("law", "seed"), "applies only to learning; remove this option or --weights"
    )
    for name in request.learning.set:
        refuse_unknown("a critic of a file has no setting", name, _SETTINGS)


def _check_file(
    path: Path, request: VerifyRequest, named: NamedGame, scope: Scope, files: int
) -> Verdict:
    """Return the verdict on the critic in a file.

    A file with one critic for each of several times is checked as a history.

    path: the critic file
    request: the options of `hfa verify`
    named: the game
    scope: box of states and other games for comparison
    files: number of files in the request, which share the time of the checks

    Raises BadInputError if --set predefined_time is given for a critic without time.
    """
    critics = critics_in(path, named.game, request.reading.reading(request.learning.set))
    critic = critics[-1]
    if request.discount is not None:
        return _check_discounted(path, critic, request, named.game, scope)
    if files > _MANY:
        scope = replace(scope, flights=_FEW_FLIGHTS)
    if not critic.is_quadratic:
        progress = ProgressLine("prove") if files == 1 else None
        scope = replace(scope, seconds=SECONDS / files, progress=progress)
        if named.linear is not None:
            from verification.scope import nonlinear_plant

            scope = replace(scope, plant=nonlinear_plant(named.linear))
    if critic.time is not None:
        return _check_history(path, critics, request, named, scope)
    if "predefined_time" in request.learning.set:
        raise BadInputError(
            f"{path} is not a history, but --set predefined_time requires one; remove this setting"
        )
    return critic_check.verify(named.game, critic, limit=request.limit_error, scope=scope)


def _check_discounted(
    path: Path, critic: Critic, request: VerifyRequest, game: Game, scope: Scope
) -> Verdict:
    """Return the verdict on a critic for a continuous-time game that is sampled and discounted.

    Raises BadInputError if the file contains a history of critics.
    """
    from verification.critic.discrete import check_discounted

    assert request.discount is not None
    if critic.time is not None:
        raise BadInputError(
            f"{path}: the file contains a history, but --discount requires one critic; give a "
            "file with a single critic"
        )
    scope = replace(scope, progress=ProgressLine("prove"))
    return check_discounted(
        game, critic, request.discount, request.dt, limit=request.limit_error, scope=scope
    )


def _check_history(
    path: Path,
    critics: Sequence[Critic],
    request: VerifyRequest,
    named: NamedGame,
    scope: Scope,
) -> Verdict:
    """Return the verdict on a history of critics over time, including the checks of the last
    critic.
    """
    from verification.critic.history import check_history

    with prefix_errors(path):
        return check_history(
            named.game,
            critics,
            limit=request.limit_error,
            scope=scope,
            predefined_time=request.learning.set.get("predefined_time"),
            progress=ProgressLine("compare"),
        )
