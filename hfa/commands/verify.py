"""The command `hfa verify`."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import NamedTuple

from controller.critic.critic import Critic
from controller.critic.critic_file import critic_file, critic_suffixes
from controller.critic.reading import CriticFile
from controller.game.zero_sum import Game
from hfa.options.argument_types import listed_names, number, positive, whole
from hfa.options.command import Outcome, ProgressLine, Request, command, picture_option
from hfa.options.games import (
    CONTINUOUS_ONLY,
    GameOptions,
    NamedGame,
    ReadingOptions,
    critic_path,
    given_game,
    reading_of,
)
from hfa.options.parser import option, refuse
from hfa_support.errors import BadInputError, prefix_errors
from hfa_support.files import MATRIX_FILES, Number
from hfa_support.progress import with_progress
from hfa_support.reporting.report import Report
from verification.critic_check import FLIGHTS, SECONDS, verify as judge
from verification.critic_errors import LIMIT
from verification.reports import verdict_report, verdicts_figure, verdicts_report
from verification.verdict import NEAR, Verdict


def _critics(text: str) -> list[Path]:
    """Return the path of a critic file, or of all in a folder, step_2 before step_10."""
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


def _about_weights() -> str:
    """Return the help of --weights with the suffixes of critic files."""
    known = (*MATRIX_FILES, ".toml")
    others = [suffix for suffix in critic_suffixes() if suffix not in known]
    return (
        f"critic to check: W, P, K or H ({' '.join(MATRIX_FILES)}), or a "
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
        "NAME,...",
        listed_names,
        default=(),
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
    flights: int = option(
        "number of flights of a critic that is not quadratic, if its cost is not proved; default "
        f"{FLIGHTS}",
        "N",
        whole(0),
        default=FLIGHTS,
    )
    limit_seconds: float = option(
        "largest duration of the proof of a critic that is not quadratic, s of the processor; "
        f"default {SECONDS:g}",
        "S",
        partial(number, declared=Number(0.0)),
        default=SECONDS,
    )


class GivenCritics(NamedTuple):
    """The critics of --weights and their game.

    files: path -> what the file contains
    named: game of the options and of a single deployment file
    game: the game on which the critics are judged, sampled with --discount
    """

    files: Mapping[str, CriticFile]
    named: NamedGame
    game: Game


def given_critics(request: VerifyRequest) -> GivenCritics:
    """Return the critics and the game that the options define."""
    files = {str(path): critic_file(path) for paths in request.weights for path in paths}
    _refuse_unused(request, files)
    first = next(iter(files))  # the critics of several files are judged on the game of the first
    named = given_game(request, request.inputs, files[first])
    moved = named.game.names.inputs
    # Of a deployment file that declares only some inputs of the aircraft.
    is_part = named.linear is not None and len(moved) < len(named.linear.model.inputs)
    of_critic = [name for name, source in named.weights_from.items() if source == "critic"]
    notes = list(named.warnings)
    if of_critic:
        notes.append(f"used: {', '.join(of_critic)} of {first}")
    if is_part and not request.inputs:
        notes.append(f"{first} moves {', '.join(moved)}; the other inputs stay at the trim")
    named = replace(named, warnings=tuple(notes))
    if named.game.is_discrete:
        refuse(request, ("discount", "dt"), CONTINUOUS_ONLY)
    game = named.game
    dt, discount = request.dt, request.discount
    if dt is None and not game.is_discrete:
        of_file = files[first].game(game.names)
        dt, discount = of_file.get("dt"), of_file.get("discount")
    if dt is not None and discount is not None:
        game = game.sampled(dt, discount)
    return GivenCritics(files, named, game)


def _with_assumption(critic: Critic, named: NamedGame) -> Critic:
    """Return the critic with the sentence that nothing gives the weights of its game."""
    assumed = [name for name, source in named.weights_from.items() if source == "default"]
    if not {"Q", "R"} <= set(assumed):
        return critic
    says = (
        f"{', '.join(assumed)} are the paper's, as neither an option nor the file gives others: "
        "give those of the critic by --Q and --R or --sizes, and --delta (inf for LQR)"
    )
    return replace(critic, declared=critic.declared._replace(assumed=says))


def _refuse_unused(request: VerifyRequest, files: Mapping[str, CriticFile]) -> None:
    """Raise BadInputError if an option has no effect or contradicts another option."""
    if not any(file.is_network for file in files.values()):
        refuse(
            request,
            ("network", "set"),
            "applies only to a network; give a network with --weights",
        )
    if (request.discount is None) != (request.dt is None):
        raise BadInputError("--discount and --dt require each other; give both options")


@command(VerifyRequest, given_critics)
def verify(request: VerifyRequest, given: GivenCritics) -> Outcome:
    """Compare a critic with the exact solution of the game.

    The exit code is 0 if every check passes or the cost is within --limit-cost, and 1 otherwise."""
    files, named, game = given
    reading = reading_of(request, named.linear)
    verdicts = {}
    for path, file in with_progress([*files.items()], ProgressLine("compare")):
        with prefix_errors(path):
            verdicts[path] = judge(
                game,
                _with_assumption(file.critic(game, reading), named),
                limit=request.limit_error,
                flights=request.flights,
                limit_seconds=request.limit_seconds,
                linear=named.linear,
                # The comparison with the nonlinear game takes long.
                taylor=None if len(files) == 1 else False,
                progress=ProgressLine("verify"),
            )
    report = _report(request, named, verdicts)
    return Outcome(
        report=report,
        ok=all(verdict.holds(request.limit_cost) for verdict in verdicts.values()),
        source=named.source,
        notes=named.warnings,
        figure=partial(verdicts_figure, verdicts),
    )


def _report(request: VerifyRequest, named: NamedGame, verdicts: Mapping[str, Verdict]) -> Report:
    """Return the report of the verdicts, file -> verdict."""
    if len(verdicts) > 1:
        report = verdicts_report(verdicts, request.limit_cost)
        notes = [
            f"{path}: {note}"
            for path, verdict in verdicts.items()
            for note in verdict.critic.declared.notes
        ]
        report = replace(report, parts=(*report.parts, *notes))
    else:
        ((path, verdict),) = verdicts.items()
        about = [named.weights_line()]
        is_near = request.limit_cost is None and verdict._linear_grade() == "near"
        if is_near and verdict.holds(NEAR):  # the nonlinear game may decide otherwise
            about.append(f"Near the optimum, exit code 1; --limit-cost {NEAR:g} accepts it")
        if verdict.critic.network and not verdict.critic.has_weights:
            about.append("Without sample time, delay and input limits; see hfa assess")
        report = verdict_report(verdict, limit_cost=request.limit_cost, about=about, source=path)
    return report.with_data(named, weights_from=named.weights_from)
