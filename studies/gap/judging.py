"""Comparison of trained policies with the best flights found and with the saturated LQR."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

import hfa
from hfa_flight.initial_box import drawn_starts, start_box
from hfa_flight.policies.deployment.policy import flown_deployment
from hfa_flight.problem import flight_problem
from hfa_optimal.flights import SimulatedFlight
from hfa_optimal.search import AFTER, BestFlights
from hfa_support.errors import NoSolutionError
from hfa_support.progress import Progress
from studies.gap.tasks import Task, cost_of, deployment_of
from studies.gap.training import Run
from trim.point.operating_point import OperatingPoint

#: Number of initial conditions of each aircraft.
STARTS = 20
#: Seed of the initial conditions. Training uses other seeds.
SEED = 1000


@dataclass(frozen=True)
class Outcome:
    """Outcome of one flight of a policy.

    stays: whether the flight stays within the flight envelope
    converges: whether the flight also ends at the trim
    cost: cost of the whole horizon, without the cost of the final state
    """

    stays: bool
    converges: bool
    cost: float


def flight_results(
    task: Task, runs: Sequence[Run], progress: Progress | None = None
) -> dict[str, Any]:
    """Return the results of simulated flights of an aircraft's policies.

    All flights begin at the initial conditions of the best flights.

    runs: training runs of the policies
    """
    point = task.point()
    problem = flight_problem(point.model, point, *cost_of(point))
    search = BestFlights(problem, STARTS)
    flights = search.flights
    starts = drawn_starts(problem, STARTS, SEED, start_box(point.model, point))
    policies = [flown_deployment(deployment_of(point, run.policy), point) for run in runs]
    loops = [flights.of_gain("LQR", problem.K), *map(flights.of_deployed, policies)]
    best: list[float | None] = []
    refused: list[str] = []
    rows: list[list[Outcome]] = []
    for number, start in enumerate(starts, start=1):
        seconds = search.horizon(start)
        try:
            found = search.found(start)
            seconds = found.seconds
            best.append(found.flown.cost)
        except NoSolutionError as error:
            best.append(None)
            refused.append(str(error))
        flown = [flights.fly(loop, start, (1.0 + AFTER) * seconds) for loop in loops]
        rows.append([_outcome(each) for each in flown])
        if progress is not None:
            progress(number, STARTS)
    columns = list(zip(*rows, strict=True))
    lqr = columns[0]
    return {
        "aircraft": task.name,
        "starts": STARTS,
        "found": STARTS - len(refused),
        "refused": {reason: refused.count(reason) for reason in dict.fromkeys(refused)},
        "lqr": summary(lqr, best, lqr),
        "policies": [
            {
                "algorithm": run.algorithm,
                "seed": run.seed,
                **summary(column, best, lqr),
                **_delay(run, point),
            }
            for run, column in zip(runs, columns[1:], strict=True)
        ],
    }


def _outcome(flown: SimulatedFlight) -> Outcome:
    stays = flown.departure is None
    return Outcome(stays, stays and flown.converges, flown.running_cost)


def summary(
    column: Sequence[Outcome], best: Sequence[float | None], lqr: Sequence[Outcome]
) -> dict[str, Any]:
    """Return counts and cost ratios of the flights of one policy.

    - stay, end_at_trim: number of flights that stay within the envelope, and number of those that
      also converge to the trim
    - over_best: median and largest ratio to the cost of the best flight, over the flights within
      the envelope for which a best flight was found
    - over_lqr: median and largest ratio to the cost of the LQR, over the initial conditions from
      which both policies stay within the envelope

    A ratio is None if no flight qualifies.

    column: flights of the policy
    best: cost of the best flight found for each initial condition, or None
    lqr: flights of the saturated LQR
    """
    over_best = [
        each.cost / least
        for each, least in zip(column, best, strict=True)
        if each.stays and least is not None
    ]
    over_lqr = [
        each.cost / linear.cost
        for each, linear in zip(column, lqr, strict=True)
        if each.stays and linear.stays
    ]
    return {
        "stay": sum(each.stays for each in column),
        "end_at_trim": sum(each.converges for each in column),
        "over_best": _median_and_worst(over_best),
        "over_lqr": _median_and_worst(over_lqr),
    }


def _median_and_worst(ratios: Sequence[float]) -> dict[str, float] | None:
    if not ratios:
        return None
    return {"median": float(np.median(ratios)), "worst": max(ratios)}


def _delay(run: Run, point: OperatingPoint) -> dict[str, Any]:
    """Return the entries on the sampled loop of a policy at a trim, for the results."""
    deployment = deployment_of(point, run.policy)
    assessed = hfa.assess(point.model, deployment, [point], samples=0).points[0]
    stable = assessed.radius < 1.0
    return {
        "radius": assessed.radius,
        "first_unstable_delay": assessed.delays.limit if stable and assessed.delays else None,
    }
