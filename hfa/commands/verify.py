"""The command `hfa verify`."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from controller.critic.critic_file import (
    critic_in,
    critic_suffixes,
    entries_in,
    is_network,
    stated_in,
)
from controller.critic.reading import Stated
from controller.game.zero_sum import Game
from hfa.options.argument_types import positive, whole
from hfa.options.command import Request, command, picture_option
from hfa.options.critic_files import ReadingOptions, critic_path, reading_of
from hfa.options.games import CONTINUOUS, GameOptions, NamedGame, given_game, given_weights
from hfa.options.option import is_given, option, refuse
from hfa.options.output import ProgressLine
from hfa.options.plants import loaded_model
from hfa.options.show import show
from hfa.options.tracking import reference_of, reference_option, with_tracking
from hfa.options.trims import OF_THE_TRIM
from hfa_aircraft.readers.matrices_file import words
from hfa_support.errors import BadInputError, prefix_errors
from hfa_support.files import MATRIX_FILES
from hfa_support.progress import with_progress
from hfa_support.reporting.report import Report
from verification.critic.critic_check import verify as judge
from verification.scope import FLIGHTS, LIMIT, Scope
from verification.verdict import NEAR, Verdict

if TYPE_CHECKING:
    from matplotlib.figure import Figure


#: With more files than this, a critic that is not quadratic is simulated from only a few initial
#: conditions.
_MANY = 5
_FEW_FLIGHTS = 10
#: Suffix of a deployment file, which `hfa assess` reads too.
_DEPLOYMENT = ".toml"


def _critics(text: str) -> list[Path]:
    """Return the paths of the critic files given by --weights."""
    folder = Path(text)
    if not folder.is_dir():
        return [critic_path(text)]
    suffixes = critic_suffixes()
    paths = sorted(path for path in folder.iterdir() if path.suffix.lower() in suffixes)
    if not paths:
        raise BadInputError(
            f"{text}: the folder contains no critic ({' '.join(suffixes)}); choose another folder"
        )
    return sorted(paths, key=lambda path: [int(part) for part in re.findall(r"\d+", path.name)])


def _names(text: str) -> tuple[str, ...]:
    """Return the names in a text "a,b,..."."""
    return tuple(name.strip() for name in text.split(","))


def _about_weights() -> str:
    """Return the help of --weights with the suffixes of critic files."""
    known = (*MATRIX_FILES, _DEPLOYMENT)
    others = [suffix for suffix in critic_suffixes() if suffix not in known]
    return (
        f"critic to check: W, P or K ({' '.join(MATRIX_FILES)}), or a "
        f"network of V, dV/dx or u ({' '.join(others)}), or a deployment file (.toml); several "
        "files or a folder of checkpoints are reported in one table"
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class VerifyRequest(Request, GameOptions, ReadingOptions):
    """Options of `hfa verify`."""

    picture: Path | None = picture_option(
        "P, the exact P and their difference, or errors of several critics"
    )
    weights: tuple[list[Path], ...] = option(
        _about_weights,
        "FILE",
        _critics,
        default=(),
        count="+",
        required=True,
    )
    inputs: tuple[str, ...] = option(
        "inputs that the critic's policy moves; the others stay at the trim; default: all",
        "NAME,NAME",
        _names,
        default=(),
        rare=True,
    )
    taylor: bool = option(
        "judge a network on the nonlinear game: Taylor coefficients about the trim, and flights",
        rare=True,
    )
    discount: float | None = option(
        "discount factor per sample; requires --dt", "NUMBER", positive, rare=True
    )
    dt: float | None = option("sample time, s; requires --discount", "S", positive, rare=True)
    limit_error: float = option(
        f"largest accepted relative error; default {LIMIT:g}", "X", positive, default=LIMIT
    )
    limit_cost: float | None = option(
        "largest excess of the cost above the optimum for exit code 0, percent", "PERCENT", positive
    )
    reference: Mapping[str, str] = reference_option()
    flights: int | None = option(
        "add N nonlinear flights with the critic, compared with the best flights found",
        "N",
        whole(1),
        rare=True,
        package="hfa_flight",
    )


@command(VerifyRequest)
def verify(request: VerifyRequest) -> int:
    """Compare a critic with the exact solution of the game.

    The exit code is 0 if every check passes or the cost is within --limit-cost, and 1 otherwise."""
    paths = [path for files in request.weights for path in files]
    _refuse_unused(request, paths)
    named = _given_game(request, paths)
    if named.game.is_discrete:
        refuse(request, ("discount", "dt", "flights", "reference"), CONTINUOUS)
    reference = reference_of(request.reference, named)
    progress = ProgressLine("compare")
    progress(0, len(paths))
    verdicts = {}
    for path in with_progress(paths, progress):
        with named.asking_for_time():
            verdicts[str(path)] = _verdict(request, path, named, len(paths))
    judged = list(verdicts.values())
    report = _report(request, named, verdicts)
    if request.flights is not None:
        from hfa_flight.commands.section import with_flights

        report = with_flights(report, judged, named, request.flights)
    last = judged[-1]
    report = with_tracking(report, reference, named, last.exact.P, last.critic.K)

    def figure() -> Figure:
        from verification.figures import verdicts_figure

        return verdicts_figure(verdicts, named.game.names.origin)

    others = [note for path in paths for note in _of_another_plant(path, named.game)]
    show(request, report, named.source, figure=figure, notes=(*named.warnings, *others))
    return 0 if all(verdict.holds(request.limit_cost) for verdict in judged) else 1


def _refuse_unused(request: VerifyRequest, paths: list[Path]) -> None:
    """Raise BadInputError if an option has no effect or contradicts another option."""
    if len(paths) > 1:
        refuse(
            request,
            ("reference", "taylor"),
            "requires a single critic; remove it, or give a single file with --weights",
        )
    if not any(map(is_network, paths)):
        refuse(
            request,
            ("network", "set"),
            "applies only to a network; give a network with --weights",
        )
    if (request.discount is None) != (request.dt is None):
        raise BadInputError("--discount and --dt require each other; give both options")
    if request.discount is not None:
        refuse(request, ("reference",), "applies only to continuous time; remove it or --discount")


def _given_game(request: VerifyRequest, paths: list[Path]) -> NamedGame:
    """Return the game of the options, in which only the inputs of the policy move.

    A single deployment file gives Q, R and the moved inputs that no option gives.
    """
    stated = stated_in(paths[0], lambda: loaded_model(request)) if len(paths) == 1 else Stated()
    moved = request.inputs or stated.inputs
    weights = {**stated.cost, **given_weights(request)}
    if isinstance(weights.get("R"), Mapping) and request.plant is None:
        all_inputs = tuple(loaded_model(request).inputs)
        weights["R"] = _of_moved(weights["R"], all_inputs, moved)
    named = given_game(request, weights)
    notes = list(named.warnings)
    of_file = [name for name in stated.cost if getattr(request, name) is None]
    if of_file:
        notes.append(f"used: {' and '.join(of_file)} of {paths[0]}")
    if moved and not request.inputs:
        notes.append(f"{paths[0]} moves {', '.join(moved)}; the other inputs stay at the trim")
    sources = {**named.weights_from, **dict.fromkeys(of_file, "deployment")}
    named = replace(named, warnings=tuple(notes), weights_from=sources)
    if not moved:
        return named
    with prefix_errors("--inputs"):
        return named.select(moved)


def _of_moved(
    R: Mapping[str, float], names: tuple[str, ...], moved: tuple[str, ...]
) -> dict[str, float]:
    """Return R with a weight, which is not used, for each input that stays at the trim.

    Raises BadInputError if all inputs move and one has no weight.
    """
    without = [name for name in names if name not in R]
    if without and not moved:
        raise BadInputError(
            f"--R has no weight for {', '.join(without)}; add them, or --inputs {','.join(R)} for "
            "a policy that moves no others"
        )
    return {name: 1.0 for name in without if name not in moved} | dict(R)


def _verdict(request: VerifyRequest, path: Path, named: NamedGame, files: int) -> Verdict:
    """Return the verdict on the critic in a file.

    A single critic is also judged on the nonlinear game of the aircraft. With --discount, the game
    is the sampled one.

    files: number of files
    """
    game = named.game
    if request.discount is not None and request.dt is not None:
        game = game.sampled(request.dt, request.discount)
    critic = critic_in(path, game, reading_of(request, named.linear))
    scope = Scope(flights=FLIGHTS if files <= _MANY else _FEW_FLIGHTS)
    if not critic.is_quadratic and named.linear is not None:
        from verification.scope import nonlinear_plant

        scope = replace(scope, plant=nonlinear_plant(named.linear))
    with prefix_errors(path):
        return judge(
            game,
            critic,
            limit=request.limit_error,
            scope=scope,
            linear=named.linear if files == 1 else None,
            taylor=request.taylor,
            progress=ProgressLine("verify"),
        )


def _of_another_plant(path: Path, game: Game) -> list[str]:
    """Return a note on the plant that a file of `hfa learn` or `hfa solve` states, if it is not
    that of the game.
    """
    plant = () if is_network(path) else words(entries_in(path), "plant")
    if plant in ((), (game.names.origin,)):
        return []
    return [f"{path} is of {', '.join(plant)}; the game is of {game.names.origin}"]


def _report(request: VerifyRequest, named: NamedGame, verdicts: Mapping[str, Verdict]) -> Report:
    """Return the report of the verdicts, file -> verdict."""
    if len(verdicts) > 1:
        from verification.reports import verdicts_report

        report = verdicts_report(verdicts, named.game.names.origin, request.limit_cost)
    else:
        ((source, verdict),) = verdicts.items()
        lines = [named.weights_line()]
        if request.limit_cost is None and verdict.grade == "near":
            lines.append(f"Near the optimum, exit code 1; --limit-cost {NEAR:g} accepts it")
        is_network = verdict.flights is not None and not verdict.critic.has_weights
        if named.linear is not None and is_network:
            assess = _assess_line(request, source)
            lines.append(f"With sample time, delay and input limits: {assess}")
        report = verdict.report(limit_cost=request.limit_cost, about=lines, source=source)
    return report.with_data(named, named.weights)


def _assess_line(request: VerifyRequest, source: str) -> str:
    """Return the command line that assesses the policy of a network at the same trim."""
    is_deployment = Path(source).suffix.lower() == _DEPLOYMENT
    line = ["hfa assess", source if is_deployment else "DEPLOYMENT.toml"]
    if request.aircraft is not None:
        line.append(f"--aircraft {request.aircraft}")
    if request.dihedral is not None:
        line.append(f"--dihedral {request.dihedral}")
    elif request.at is not None:
        line.append(f"--at {request.at}")
    if any(is_given(request, name) for name in OF_THE_TRIM):
        line.append("with the same options of the trim")
    if not is_deployment:
        line.append(f"(DEPLOYMENT.toml names {source}, its observations and actions)")
    return " ".join(line)
