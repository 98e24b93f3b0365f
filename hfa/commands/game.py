"""The commands `hfa solve` and `hfa learn`."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

from hfa.learning import Learning
from hfa.options.aircraft import Aircraft
from hfa.options.argument_types import whole
from hfa.options.game import CONTINUOUS, GameGiven, NamedGame
from hfa.options.output import Output, ProgressLine, picture_option
from hfa.options.part import OfModel, is_installed, option, part
from hfa.options.reference import reference_option, with_tracking
from hfa.options.request import Request, command
from hfa.options.trim import Trim
from hfa_aircraft.waveform import Waveform
from hfa_support.errors import BadInputError

if TYPE_CHECKING:
    from controller.critic.training_run import TrainingRun
    from hfa_aircraft.model import Model
    from trim.linear.linear_model import LinearModel
    from verification.verdict import Verdict


def _about_design(model: Model) -> str:
    from hfa_design.options import about_design

    return about_design(model)


def _design(model: Model, name: str) -> Any:
    from hfa_design.design import load_design

    return load_design(name, model)


@dataclass(frozen=True, kw_only=True, eq=False)
class DesignedGame(GameGiven):
    """The game, whose weights a design may define."""

    design: Any = option(_about_design, "NAME", OfModel(_design), package="hfa_design")

    def game_at(self, linear: LinearModel, aircraft: Aircraft) -> NamedGame:
        """Return the game on the linear model of an aircraft at a trim, of --design if given."""
        if self.design is None:
            return super().game_at(linear, aircraft)
        from hfa_design.options import designed_game

        aircraft.refuse(
            ("units",),
            "cannot be combined with --design, whose weights are in the units of the declaration; "
            "remove this option",
        )
        return designed_game(self.design, self.weights, linear)


@dataclass(frozen=True, kw_only=True, eq=False)
class GameRequest(Request):
    """Request of a command that solves, learns or checks one game."""

    aircraft: Aircraft = part(Aircraft)
    trim: Trim = part(Trim)
    game: GameGiven = part(GameGiven)

    def named_game(self, read: dict[str, Any] | None = None) -> NamedGame:
        """Return the game that the options define, in continuous or discrete time.

        read: entries of the plant file, if it has been read already, or None
        """
        return self.game.game(self.aircraft, self.trim, read, may_be_discrete=True)


@dataclass(frozen=True, kw_only=True, eq=False)
class SolveRequest(GameRequest):
    """Options of `hfa solve`."""

    game: DesignedGame = part(DesignedGame)
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

    A file of --model with B1, B2, C1, D12 and optionally C2, D21, D11, D22 is a generalized plant,
    as for `hinfsyn`. The H-infinity norm of the closed loop is then below delta, by default 1.01
    delta_min. With --order D, the value and the policy of the nonlinear aircraft are also computed,
    as polynomials, with the set in which they agree with simulated flights. With --reference, the
    exact feedforward for a command is reported, with the cost of tracking, and whether the command
    is a trim. The exit code is 1 if there is no certified solution."""
    from controller.expansion.expansion import expand
    from controller.riccati import gare

    if request.order is None:
        request.output.refuse(("picture",), "shows the nonlinear game; add --order D")
    plant = request.game.plant
    if plant is not None or request.game.design is not None:
        request.refuse(
            ("order", "reference"),
            "requires the equations of an aircraft; remove --model and --design",
        )
    arrays = None
    if plant is not None:
        from hfa_aircraft.readers.matrices_file import has_all
        from hfa_support.arrays.read import read_arrays

        arrays = read_arrays(plant)
        if has_all(arrays, "B2"):
            request.game.refuse_aircraft(request.aircraft, request.trim)
            request.game.weights.refuse(
                ("Q", "R"),
                "does not apply to a generalized plant; define the cost by C1 and D12",
            )
            if not is_installed("hfa_design"):
                raise BadInputError(
                    f"{plant} is a generalized plant, which requires the package hfa_design; "
                    "install this package"
                )
            from hfa_design.plant.plant_report import solved_plant

            report = solved_plant(plant, arrays, request.game.weights.delta)
            request.show(report, notes=report.data["warnings"])
            return 0
    named = request.named_game(arrays)
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
        verdict.headline(),
        named.weights_line(),
        *report.parts,
        checks_part(verdict.checks),
    )
    title = report.title
    if not verdict.ok:
        title = f"{verdict.grade.upper()}: K is off by {100.0 * verdict.K_rel_error:.2g} %\n{title}"
    report = replace(report, title=title, parts=parts).with_data(named, judged)
    whole = run.report(history=True).with_data(judged).data
    request.show(report, only_in_files=whole, notes=named.warnings)
    return 0 if verdict.ok else 1
