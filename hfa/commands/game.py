"""The commands `hfa solve` and `hfa learn`."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from controller.game.held_game import held
from controller.learning.law_names import DEFAULT_LAW
from hfa.learning import LearningOptions
from hfa.options.argument_types import whole
from hfa.options.command import Outcome, ProgressLine, Request, command
from hfa.options.games import (
    CONTINUOUS_ONLY,
    REFERENCE,
    GameOptions,
    NamedGame,
    game_at,
    given_game,
    given_weights,
    reference_of,
    weight_sources,
    with_tracking,
)
from hfa.options.parser import option, refuse
from hfa.options.trims import OF_THE_TRIM, SeveralTrims, at_name, given_trims
from hfa_support.errors import BadInputError
from hfa_support.progress import with_progress
from hfa_support.reporting.report import Report
from hfa_support.reporting.text import Table

if TYPE_CHECKING:
    from controller.game.zero_sum import Game
    from controller.riccati.gare import Solution
    from trim.linear.delays import Chain

#: Largest number of games of a gain table. Each takes about .1 s.
_MOST_BREAKPOINTS = 1000
#: Options of `hfa solve` that apply to one trim of an aircraft.
_OF_ONE_TRIM = ("order", "reference")


@dataclass(frozen=True, kw_only=True, eq=False)
class SolveRequest(Request, SeveralTrims, GameOptions):
    """Options of `hfa solve`."""

    order: int | None = option(
        "also the value of the nonlinear game about the trim, to degree D = 2 to 5",
        "D",
        whole(2, 5),
    )
    reference: Mapping[str, str] = REFERENCE


class GivenGames(NamedTuple):
    """The game that the options define, or the games at several values of the scheduling variable.

    at: values of the scheduling variable, (G,), rad for angles, or None for a single game
    source: entries of the provenance
    """

    games: list[NamedGame]
    at: np.ndarray | None
    source: Mapping[str, Any]


def given_games(request: SolveRequest) -> GivenGames:
    """Return the games that the options define."""
    typed = request.dihedral or request.at or ""
    is_single = not ("," in typed or ":" in typed)  # neither a list nor a range
    if request.plant is not None or request.rate is not None or not is_single:
        reason = "applies to one trim of an aircraft, in continuous time; remove this option"
        refuse(request, _OF_ONE_TRIM, reason)
    if request.plant is not None or is_single:
        named = given_game(request)
        return GivenGames([named], None, named.source)
    trims, source = given_trims(request, _MOST_BREAKPOINTS)
    name = f"--{at_name(trims[0].model)}"
    refuse(
        request, ("rate", "delay"), f"applies to one trim; remove this option, or give one {name}"
    )
    breakpoints = np.array([given.at for given in trims])
    if np.any(np.diff(breakpoints) <= 0.0):
        raise BadInputError(f"{name} does not increase; give the values in increasing order")
    weights = given_weights(request, trims[0].model)
    trimmed = with_progress(trims, ProgressLine("trim"))
    return GivenGames([game_at(given, weights) for given in trimmed], breakpoints, source)


@command(SolveRequest, given_games)
def solve(request: SolveRequest, given: GivenGames) -> Outcome:
    """Solve the zero-sum game exactly, and report a certificate, the smallest delta, the cost of
    the policies and their stability margins.

    With --order D, the value and the policy of the nonlinear aircraft are also computed, as
    polynomials, with the set in which they agree with simulated flights. With --reference, the
    exact feedforward for a command is reported, with the cost of tracking, and whether the command
    is a trim. With several values of the scheduling variable, such as --dihedral 5,10,15, the gain
    is computed at each: -o FILE writes the gain table that `hfa fly --policy FILE` interpolates
    linearly. The exit code is 1 if there is no certified solution."""
    from controller.riccati import gare

    if given.at is not None:
        return _gain_table(given.games, given.at, given.source)
    (named,) = given.games
    reference = reference_of(request.reference, named) if request.reference else None
    solution = gare.solve(named.game)
    report = solution.report()
    # A game without a linear model is that of --model, with which --order is refused.
    if request.order is not None and named.linear is not None:
        from controller.expansion.expansion import expand

        expanded = expand(named.linear, solution, request.order).report()
        parts = (*report.parts, expanded.title, *expanded.parts)
        report = replace(report, parts=parts).with_data(expanded.data)
    if named.of_rates is not None:
        prompt = gare.solve(held(named.of_rates, request.rate)) if request.delay else None
        report = _with_delays(report, solution, named.of_rates, prompt)
    report = replace(report, parts=(*named.sizes_line(), *report.parts))
    if reference is not None:
        report = with_tracking(report, reference, named, solution)
    return Outcome(report=report.with_data(named), source=named.source, notes=named.warnings)


def _with_delays(
    report: Report, solution: Solution, plant: Game, prompt: Solution | None
) -> Report:
    """Return the report of a game of samples with the price of its delay, and the further delay
    that makes its linear loop unstable.

    plant: the game in continuous time
    prompt: the solution of the game without its delay, or None if it has none
    """
    from controller.riccati.suboptimality import price_of_delay
    from trim.linear.delays import chain_of, searched_delays, text_of_further_delay

    dt, (n, m) = float(solution.game.dt or 0.0), plant.B.shape
    count = (len(solution.P) - n) // m  # commands under way, of which the gain has the oldest first

    def loop(further: float) -> Chain:
        """Return the loop with a further delay, s."""
        return chain_of(
            plant.A,
            plant.B,
            lambda x, earlier: -solution.K @ np.vstack([x, *earlier[:count][::-1]]),
            dt,
            count * dt + further,
        )

    further = searched_delays(loop, dt, 0.0)
    parts = [text_of_further_delay(further.limit, further.searched)]
    if prompt is not None:
        parts.insert(0, price_of_delay(solution.enclosure, prompt.enclosure))
    report = replace(report, parts=(*report.parts, *parts))
    return report.with_data(further_delay=further.limit)


def _gain_table(games: list[NamedGame], at: np.ndarray, source: Mapping[str, Any]) -> Outcome:
    """Return the outcome of the exact solutions at several values of the scheduling variable.

    at: the values, (G,), rad for angles
    """
    from controller.riccati import gare

    solutions = [gare.solve(named.game) for named in with_progress(games, ProgressLine("solve"))]
    linear = games[0].linear
    assert linear is not None  # the games of a table are those of an aircraft
    model = linear.model
    schedule, is_angle = model.schedule, model.is_typed_in_degrees
    rows = []
    for value, solution in zip(at.tolist(), solutions, strict=True):
        margin = solution.disk_margin
        rows.append(
            (
                model.describe(schedule, value),
                f"{solution.delta_min:.6g}",
                f"{solution.poles().real.max():.4g}",
                "none" if margin is None else f"{margin.disk:.4g}",
            )
        )
    columns = (
        schedule,
        "delta_min",
        f"largest real part, 1/{model.time_unit}",
        "disk margin, all inputs",
    )
    title = (
        f"Gain table over {schedule} for {model.title}: {len(rows)} exact solutions, proved,"
        f" {rows[0][0]} to {rows[-1][0]}"
    )
    data = {
        "schema": "hfa.gain-table/1",
        "plant": model.title,
        model.schedule_key: np.degrees(at).round(10) if is_angle else at,
        "K": np.array([solution.K for solution in solutions]),
        "P": np.array([solution.P for solution in solutions]),
        "delta_min": [solution.delta_min for solution in solutions],
    }
    report = Report(title, (games[0].weights_line(), Table(columns, rows)))
    return Outcome(
        report=report.with_data(games[0], data),
        source=source,
        notes=dict.fromkeys(note for named in games for note in named.warnings),
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class LearnRequest(Request, GameOptions, LearningOptions):
    """Options of `hfa learn`."""


def given_learning(request: LearnRequest) -> NamedGame:
    """Return the game on the plant of the options, or with A = 0 that of --data without a plant."""
    plants = (request.plant, request.aircraft, request.at, request.dihedral)
    if plants != (None,) * 4 or not request.data:  # a plant is given or required
        return given_game(request)
    refuse(request, OF_THE_TRIM, "applies only to the aircraft; remove this option")
    from controller.learning.recorded import game_of_data

    weights = given_weights(request, None)
    game = game_of_data(list(request.data), **weights)
    sources = weight_sources(weights, of_critic=(), of_file=())
    return NamedGame(game, weights_from=sources, source={"model": str(request.data[0])})


@command(LearnRequest, given_learning)
def learn(request: LearnRequest, named: NamedGame) -> Outcome:
    """Learn the value and gain of the game, and compare them with the exact solution.

    -o FILE saves the weights for `hfa verify`. For a discrete-time plant, Q-learning is used. With
    --data, the linear fit of recorded transitions takes the place of A and B; those of the plant
    are used for the comparison alone, and without a plant there is none. The exit code is 1 if a
    check fails.
    """
    from controller.learning.laws import learn

    if named.game.is_discrete:
        refuse(request, ("law",), CONTINUOUS_ONLY)
    if request.data:
        refuse(request, ("seed",), "applies only to simulated data; remove this option or --data")
    law, data = request.law or DEFAULT_LAW, list(request.data) or None
    run = learn(named.game, law, request.seed, data=data, progress=ProgressLine("learn"))
    report = run.report()
    if not named.game.A.any():  # the game of `game_of_data`, whose plant is unknown
        parts = (f"{named.weights_line()}; not compared: no plant is given", *report.parts)
        report = replace(report, parts=parts).with_data(named)
        return Outcome(report=report, source=named.source)
    from verification.critic_check import verify
    from verification.reports import checks_part

    verdict = verify(named.game, run)
    judged: dict[str, Any] = {"certificates": verdict.checks, "converged": verdict.ok}
    parts = (named.weights_line(), *report.parts, checks_part(verdict.checks))
    if run.P_band is not None:
        inside = {
            name: np.abs(getattr(run, name) - getattr(verdict.exact, name))
            <= getattr(run, f"{name}_band")
            for name in "PK"
        }
        judged["entries_in_bands"] = {name: int(entries.sum()) for name, entries in inside.items()}
        counts = [f"{each.sum()} of {each.size} of {name}" for name, each in inside.items()]
        parts = (f"Exact entries in the 95 % bands: {', '.join(counts)}", *parts)
    title = f"{verdict.headline}\n{report.title}"
    report = replace(report, title=title, parts=parts).with_data(named, judged)
    return Outcome(report=report, ok=verdict.ok, source=named.source, notes=named.warnings)
