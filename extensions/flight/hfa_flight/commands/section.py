"""Section that `hfa verify --flights` adds: flights of policies compared with the best flights
found.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from controller.riccati.gare import solve
from hfa.options.games import NamedGame
from hfa.options.output import ProgressLine
from hfa_flight.plan.initial_box import drawn_starts
from hfa_flight.plan.problem import flight_problem
from hfa_flight.plan.search import BestFlights
from hfa_flight.plan.starts_table import starts_table
from hfa_support.errors import BadInputError
from hfa_support.reporting.report import Report
from verification.verdict import Verdict

#: Seed of the initial conditions.
_SEED = 0


def with_flights(report: Report, verdicts: list[Verdict], named: NamedGame, count: int) -> Report:
    """Return the report of `hfa verify` with an added section on flights of the critic's policy.

    The flights are simulated within the limits of the nonlinear aircraft. They are compared with
    the best flights found, with flights of the linear optimum and, if δ is finite, with flights of
    the exact game policy.

    verdicts: the verdict on the critic
    named: game of the aircraft's linear model
    count: number of initial conditions

    Raises BadInputError if there is no nonlinear aircraft, or not exactly one critic.
    """
    if named.linear is None:
        raise BadInputError(
            "--flights cannot be combined with --model; remove one of these options"
        )
    if len(verdicts) != 1:
        raise BadInputError(
            f"--flights supports only one critic, but {len(verdicts)} are given; "
            "give one critic, or remove --flights"
        )
    point = named.linear.point
    game = named.game
    game.refuse_cross_weights("the cost of --flights")
    problem = flight_problem(point.model, point, game.Q, game.R, game.names.inputs)
    search = BestFlights(problem, count)
    loops = [search.flights.of("this critic, saturated", verdicts[0].critic)]
    if np.isfinite(game.delta):
        exact = solve(game).K
        loops.append(search.flights.of("exact game policy, saturated", exact))
    starts = drawn_starts(problem, count, _SEED)
    table = starts_table(search, starts, loops, ProgressLine("flights"))
    section = table.report()
    of_critic = table.policies[1:]  # after the linear optimum
    lost = [f"{each.policy.removesuffix(', saturated')} {each.lost}" for each in of_critic]
    line = f"nonlinear flights that leave the envelope or do not converge, of {table.found}: "
    title = f"{report.title}\n{line}{', '.join(lost)}"
    parts = (*report.parts, section)
    return replace(report, title=title, parts=parts).with_data(flights=section.data)
