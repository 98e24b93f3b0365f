"""The command `hfa optimize`."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from hfa.options.advice import trimmed
from hfa.options.argument_types import (
    each_of,
    linear_state,
    quantity,
    span,
    whole,
)
from hfa.options.command import Outcome, ProgressLine, Request, command, picture_option
from hfa.options.games import WeightOptions, given_weights, weighted_game
from hfa.options.parser import option, refuse
from hfa.options.trims import GivenTrim, TrimInput, TrimOptions, trim_input
from hfa_flight.needs import ALL, SHARE, needed_share
from hfa_flight.options import (
    EXACT,
    NONE,
    policy_of_word,
    policy_option,
)
from hfa_flight.policies.laws import DEPLOYMENT, LAWS, TABLE
from hfa_support.errors import BadInputError
from trim.linear.linearize import linearize

if TYPE_CHECKING:
    from controller.game.zero_sum import Game
    from trim.point.operating_point import OperatingPoint

_MOST_STARTS = 10_000
#: Name, in reports, of the policy that solves the game. Without --policy, it does not decide the
#: verdict.
_EXACT_NAME = "exact game policy, saturated"


@dataclass(frozen=True, kw_only=True, eq=False)
class OptimizeRequest(Request, TrimOptions, WeightOptions):
    """Options of `hfa optimize`."""

    units: None = None
    start: None = None
    limit: Mapping[str, str] = field(default_factory=dict)
    limits: Mapping[str, str] = option(
        "limits of a state, instead of the limits of the flight envelope, degrees for angles; "
        "repeatable",
        "NAME=LOW:HIGH",
        names="--limit",
        named=True,
    )
    N: None = None
    picture: Path | None = picture_option("the best flight found, and the flights of the policies")
    seed: int = option("seed of all random numbers; default 0", "N", whole(0), default=0, rare=True)
    deviations: Mapping[str, str] = option(
        "initial deviations of states from the trim, degrees for angles",
        "NAME=VALUE,...",
        names="--initial",
        named=True,
    )
    to: Mapping[str, str] = option(
        "value imposed at the final trim, in place of its value at the initial trim; repeatable",
        "NAME=VALUE",
        named=True,
    )
    starts: int | None = option(
        "number of random initial conditions in the default box, for a table of flights",
        "N",
        whole(1, _MOST_STARTS),
    )
    need: Mapping[str, float] = option(
        "share of the initial conditions of --starts from which a flight is found and the "
        "policies of --policy converge within limits, for exit code 0; default 1, all",
        f"{SHARE}=X",
        needed_share,
        named=True,
        rare=True,
    )
    policy: tuple[str | Path, ...] = policy_option(
        f"compare with a policy, and require that it converges: {NONE}, {EXACT}, "
        f"{' or '.join(LAWS)}, or a FILE: a gain, a gain table, a critic, a network or a "
        "deployment; repeatable",
        NONE,
        EXACT,
        *LAWS,
        repeated=True,
    )


def _final_trim(request: OptimizeRequest, asked: TrimInput, begin: GivenTrim) -> GivenTrim:
    """Return the trim at which flights end: the given trim, changed by --to."""
    model = asked.model
    held = each_of("--to", model, request.to, quantity)
    for name in held:
        if name in model.parameters:
            raise BadInputError(
                f"--to {name}: {name} is a parameter, which is constant in flight; give a state"
            )
    at = held.pop(model.schedule, begin.at)
    return asked.trim(at, {**begin.hold, **held})


def _policy(
    given: str | Path, game: Game, point: OperatingPoint, limits: Mapping[str, Any]
) -> tuple[str, Any]:
    """Return the name of a policy of --policy, and the policy."""
    from hfa_flight.policies.given import kind_of_file, policy_of_file

    if not isinstance(given, Path):
        named = _EXACT_NAME if given == EXACT else given
        return named, None if given == NONE else policy_of_word(given, game, point, limits)
    policy = policy_of_file(given, point, game)
    named = {DEPLOYMENT: "policy", TABLE: "gains"}.get(kind_of_file(given), "critic")
    return f"{named} of {given}", policy


def _refuse_contradictions(request: OptimizeRequest) -> None:
    """Raise BadInputError unless one option gives the initial conditions, and for idle options."""
    begins = (bool(request.deviations), request.starts is not None, bool(request.to))
    if begins.count(True) != 1:
        raise BadInputError(
            "the initial condition is missing or given twice; give either --initial "
            "NAME=VALUE,..., --starts N or --to NAME=VALUE"
        )
    if request.starts is not None:
        refuse(
            request, ("picture",), "applies only to a single flight; remove this option or --starts"
        )
    else:
        refuse(request, ("need",), "applies only to --starts; remove this option, or add --starts")


@command(OptimizeRequest, trim_input)
def optimize(request: OptimizeRequest, asked: TrimInput) -> Outcome:
    """Search for the best flight of the nonlinear aircraft to its trim, and compare policies.

    The cost is the integral of x'Qx + u'Ru, in deviations from the trim. Collocation proposes
    flights within the limits. A simulation of each candidate yields the reported cost. A cheaper
    flight may exist. The policies are the linear optimum and the exact game policy, both saturated
    at the limits of the inputs, and those of --policy. --starts N prints a table for many initial
    conditions. --to NAME=VALUE searches for flights from one trim to another. Exit code 1 if no
    flight was found, or a policy of --policy does not converge within the limits; with --starts,
    from every initial condition, or from the share of --need.
    """
    from hfa_flight.plan import starts_table
    from hfa_flight.plan.problem import flight_problem

    _refuse_contradictions(request)
    given = asked.single()
    end = _final_trim(request, asked, given)
    model = end.model
    deviations = each_of("--initial", model, request.deviations, linear_state)
    limits = each_of("--limit", model, request.limits, span)
    point = trimmed(end)
    weights = given_weights(request, model)
    game = weighted_game(weights, linearize(model, point), of_flights=True).game
    game.refuse_cross_weights("the cost of hfa optimize")
    problem = flight_problem(model, point, game.Q, game.R, limits=limits)
    judged = dict(_policy(what, game, point, limits) for what in request.policy)
    policies = judged
    if np.isfinite(game.delta):
        policies = {_EXACT_NAME: policy_of_word(EXACT, game, point, limits), **judged}
    if request.starts is not None:
        progress = ProgressLine("optimize")
        table = starts_table.optimize_starts(
            problem, request.starts, policies, seed=request.seed, progress=progress
        )
        table = replace(table, judged=[*judged], share=request.need.get(SHARE, ALL))
        return Outcome(report=table.report(), ok=table.ok, source=given.source)
    initial = trimmed(given) if request.to else deviations
    best = starts_table.optimize(
        model, point, initial, game.Q, game.R, limits=limits, policies=policies
    )
    rows = [row for row in best.policies if row.policy in judged]
    failures = [f"FAIL: {row.policy}: {row.outcome()}" for row in rows if not row.converges]
    report = best.report()
    return Outcome(
        report=replace(report, title="\n".join([*failures, report.title])),
        ok=not failures,
        source=given.source,
        figure=best.figure,
        only_in_files={"flight": {"time": best.time, "X": best.states, "U": best.inputs}},
    )
