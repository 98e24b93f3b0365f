"""Flights of a deployed policy compared with the best flights, for `hfa assess --best`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from hfa_flight.initial_box import drawn_starts
from hfa_flight.policies.deployment.deployed import Deployed
from hfa_flight.policies.deployment.policy import flown_deployment, sampled_scenario
from hfa_flight.problem import flight_problem
from hfa_flight.scenario import Scenario
from hfa_optimal.best_flight import PolicyFlight
from hfa_optimal.bracket import BestCosts, Ratios, ratios
from hfa_optimal.initial_conditions import starts_table
from hfa_optimal.pilots import Pilot
from hfa_optimal.search import BestFlights
from hfa_policy.assessment import AssessedPoint
from hfa_policy.cost_above_optimum import weights_at
from hfa_support.progress import Progress


def best_costs(
    deployed: Deployed,
    assessed: AssessedPoint,
    count: int,
    seed: int,
    progress: Progress,
    certificate: Path | None = None,
) -> BestCosts:
    """Return the costs of a deployed policy and of the linear optimum relative to the best flights.

    The flights begin at random initial conditions in the box of an assessed trim. A best flight is
    the cheapest flight that was found.

    deployed: the policy, with the cost for which it was trained
    assessed: the assessed trim
    count: number of initial conditions
    seed: seed of the initial conditions
    certificate: file with a lower bound of the cost of these flights, or None

    Raises BadInputError if the certificate is about other flights. Raises BadInputError or
    NoSolutionError if the certificate does not prove its statement.
    """
    point = assessed.point
    model = point.model
    Q, R = weights_at(deployed, point)
    problem = flight_problem(model, point, Q, R, inputs=deployed.commanded)
    bound = None
    if certificate is not None:
        from hfa_prove.bound import lower_bound

        bound = lower_bound(certificate, problem, progress, deployed.deployment.origin)
    search = BestFlights(problem, count)
    flights = search.flights
    policy = flown_deployment(deployed.deployment, point)
    start = np.zeros(len(model.states))
    calm = Scenario(flights.tick, flights.step, flights.tick, initial=start)
    loop = flights.compiled(policy, sampled_scenario(policy, calm, point))
    starts = drawn_starts(problem, count, seed, assessed.place.box)
    table = starts_table(search, starts, [Pilot("policy", loop)], progress, bound)
    rows = [each.policies for each in table.flights if each.cost is not None]
    linear, flown = ([row[index] for row in rows] for index in range(2))
    offset = None
    if assessed.equilibrium is not None:
        z = assessed.offset
        v = (assessed.equilibrium.inputs - np.array(point.inputs))[problem.moved]
        offset = float(z @ Q @ z + v @ R @ v)
    return BestCosts(
        starts=table.starts,
        found=table.found,
        refused=table.refused,
        lost=sum(each.lost for each in flown),
        policy_over_best=_ratios(flown),
        lqr_over_best=_ratios(linear),
        offset_rate=offset,
        brackets=[
            replace(each.bracket, policy=each.policies[1].cost)
            for each in table.flights
            if each.bracket is not None
        ],
    )


def _ratios(flights: Sequence[PolicyFlight]) -> Ratios | None:
    """Return a summary of the ratios `over_best` of a policy's flights, or None without ratios.

    Flights without a ratio are left out.
    """
    return ratios([each.over_best for each in flights if each.over_best is not None])
