"""The commands `hfa solve` and `hfa learn`."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from hfa.learning import Learning
from hfa.options.aircraft import Aircraft
from hfa.options.argument_types import whole
from hfa.options.game import CONTINUOUS, GameGiven, NamedGame
from hfa.options.output import Output, ProgressLine, picture_option
from hfa.options.part import option, part
from hfa.options.ranges import Range, array_of, value_or_range
from hfa.options.reference import reference_option, with_tracking
from hfa.options.request import Request, command
from hfa.options.trim import Trim, called_at, scheduled
from hfa_aircraft.waveform import Waveform
from hfa_support.errors import BadInputError
from hfa_support.progress import with_progress
from hfa_support.reporting.report import Report
from hfa_support.reporting.text import Table

if TYPE_CHECKING:
    from controller.critic.training_run import TrainingRun
    from controller.riccati.gare import Solution
    from hfa_aircraft.model import Model
    from verification.verdict import Verdict

#: Largest number of games of a gain table. Each takes about a tenth of a second.
_MOST_BREAKPOINTS = 1000


@dataclass(frozen=True, kw_only=True, eq=False)
class GameRequest(Request):
    """Request of a command that solves, learns or checks one game."""

    aircraft: Aircraft = part(Aircraft)
    trim: Trim = part(Trim)
    game: GameGiven = part(GameGiven)

    def named_game(self) -> NamedGame:
        """Return the game that the options define, in continuous or discrete time."""
        return self.game.game(self.aircraft, self.trim, may_be_discrete=True)


@dataclass(frozen=True, kw_only=True, eq=False)
class SolvedTrim(Trim):
    """The trim of one game, or the trims of a gain table."""

    at: float | Range | None = scheduled(
        value_or_range, "RANGE", "a number, or a list a,b,c or a range start:stop:step of a table"
    )

    @property
    def breakpoints(self) -> np.ndarray | None:
        """Values of the scheduling variable of a gain table, (G,), or None for one trim.

        Raises BadInputError unless they increase.
        """
        if self.at is None or isinstance(self.at, float):
            return None
        name = f"--{called_at(self.model)}"
        values = array_of(name, self.at, _MOST_BREAKPOINTS)
        if np.any(np.diff(values) <= 0.0):
            raise BadInputError(f"{name} does not increase; give the values in increasing order")
        return values


@dataclass(frozen=True, kw_only=True, eq=False)
class SolveRequest(GameRequest):
    """Options of `hfa solve`."""

    trim: SolvedTrim = part(SolvedTrim)
    output: Output = part(
        Output,
        picture=picture_option("with --order: errors of V2 to VD over the distance from the trim"),
    )
    order: int | None = option(
        "also the value of the nonlinear game about the trim, to degree D = 2 to 5",
        "D",
        whole(2, 5),
    )
    reference: Mapping[str, Waveform] = reference_option()


@command(SolveRequest)
def solve(request: SolveRequest) -> int:
    """Solve the zero-sum game exactly, and report a certificate, the smallest delta, the cost of
    the policies and their stability margins.

    With --order D, the value and the policy of the nonlinear aircraft are also computed, as
    polynomials, with the set in which they agree with simulated flights. With --reference, the
    exact feedforward for a command is reported, with the cost of tracking, and whether the command
    is a trim. With several values of the scheduling variable, such as --dihedral 5,10,15, the gain
    is computed at each: -o FILE writes the gain table that `hfa fly --controller FILE` interpolates
    linearly. The exit code is 1 if there is no certified solution."""
    from controller.expansion.expansion import expand
    from controller.riccati import gare

    if request.order is None:
        request.output.refuse(("picture",), "shows the nonlinear game; add --order D")
    if request.game.plant is not None:
        request.refuse(
            ("order", "reference"),
            "requires the equations of an aircraft; remove --model",
        )
    elif request.trim.breakpoints is not None:
        return _solve_table(request, request.trim.breakpoints)
    named = request.named_game()
    with named.asking_for_time():
        solution = gare.solve(named.game, ProgressLine("solve"))
        solved = solution.report()
    figure = None
    if request.order is not None:
        assert named.linear is not None  # --order requires an aircraft
        expansion = expand(named.linear, solution, request.order)
        figure = expansion.figure
        expanded = expansion.report()
        parts = (*solved.parts, expanded.title, *expanded.parts)
        solved = replace(solved, parts=parts).with_data(expanded.data)
    solved = with_tracking(solved, request.reference, named, solution.P, solution.K)
    request.show(solved.with_data(named), figure=figure, notes=named.warnings)
    return 0


def _solve_table(request: SolveRequest, breakpoints: np.ndarray) -> int:
    """Solve the game at each value of the scheduling variable, and show the gain table."""
    from controller.riccati import gare

    request.refuse(
        ("order", "reference"),
        f"applies to one trim; remove this option, or give one --{called_at(request.model)}",
    )
    games: list[NamedGame] = []
    solutions: list[Solution] = []
    for value in with_progress(breakpoints.tolist(), ProgressLine("solve")):
        named = replace(request, trim=replace(request.trim, at=value)).named_game()
        games.append(named)
        solutions.append(gare.solve(named.game))
    notes = dict.fromkeys(note for named in games for note in named.warnings)
    request.show(_table_report(request.model, breakpoints, games, solutions), notes=notes)
    return 0


def _table_report(
    model: Model, breakpoints: np.ndarray, games: list[NamedGame], solutions: list[Solution]
) -> Report:
    """Return the report of a gain table.

    breakpoints: (G,), values of the scheduling variable, rad for angles
    games, solutions: the game and its solution at each value
    """
    by = model.schedule
    in_degrees = np.degrees(breakpoints)
    rows = []
    for value, solution in zip(breakpoints.tolist(), solutions, strict=True):
        disk = solution.disk_margin
        rows.append(
            (
                model.describe(by, value),
                f"{solution.delta_min:.6g}",
                f"{solution.poles().real.max():.4g}",
                "none" if disk is None else f"{disk.disk:.4g}",
            )
        )
    columns = (by, "delta_min", "largest real part, 1/s", "disk margin, all inputs")
    title = (
        f"Gain table over {by} for {model.title}: {len(rows)} exact solutions, certified,"
        f" {rows[0][0]} to {rows[-1][0]}"
    )
    data = {
        "schema": "hfa.gain-table/1",
        "plant": model.title,
        model.schedule_key: in_degrees.round(10) if model.is_typed_in_degrees else breakpoints,
        "K": np.array([solution.K for solution in solutions]),
        "P": np.array([solution.P for solution in solutions]),
        "delta_min": [solution.delta_min for solution in solutions],
    }
    report = Report(title, (games[0].weights_line(), Table(columns, rows)))
    return report.with_data(games[0], data)


@dataclass(frozen=True, kw_only=True, eq=False)
class LearnRequest(GameRequest):
    """Options of `hfa learn`."""

    learning: Learning = part(Learning)


@command(LearnRequest)
def learn(request: LearnRequest) -> int:
    """Learn the value and gain of the game, and compare them with the exact solution.

    -o FILE saves the weights for `hfa verify`. For a discrete-time plant, Q-learning from recorded
    steps is used. The exit code is 1 if a check fails.
    """
    from verification.critic.critic_check import verify

    named = request.named_game()
    if named.game.is_discrete:
        request.learning.refuse(("law",), CONTINUOUS)
    run = request.learning.learned(named.game)
    return _show_learned(request, named, run, verify(named.game, run))


def _show_learned(
    request: LearnRequest,
    named: NamedGame,
    run: TrainingRun,
    verdict: Verdict,
) -> int:
    """Print and save a learned critic with its checks, and return the exit code."""
    from verification.verdict import checks_part

    judged = {"certificates": verdict.checks, "converged": verdict.ok}
    report = run.report()
    parts = (
        verdict.headline,
        named.weights_line(),
        *report.parts,
        checks_part(verdict.checks),
    )
    title = report.title
    if not verdict.ok:
        title = f"{verdict.grade.upper()}: K is off by {100.0 * verdict.K_rel_error:.2g} %\n{title}"
    report = replace(report, title=title, parts=parts).with_data(named, judged)
    request.show(report, notes=named.warnings)
    return 0 if verdict.ok else 1
