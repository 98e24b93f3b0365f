"""Search for the cheapest flight to a trim."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from hfa_aircraft.model import Model
from hfa_flight.plan.best_flight import BestFlight
from hfa_flight.plan.flights import AFTER
from hfa_flight.plan.initial_box import drawn_starts
from hfa_flight.plan.problem import FlightProblem, flight_problem
from hfa_flight.plan.search import BestFlights
from hfa_flight.plan.starts_table import StartsTable, starts_table
from hfa_support.arguments import ArrayLike
from hfa_support.progress import Progress
from trim.point.operating_point import OperatingPoint


def optimize(
    model: Model,
    point: OperatingPoint,
    initial: Mapping[str, float] | OperatingPoint,
    Q: ArrayLike | Mapping[str, float] | None = None,
    R: ArrayLike | Mapping[str, float] | None = None,
    *,
    inputs: Sequence[str] | None = None,
    limits: Mapping[str, Any] | None = None,
    policies: Mapping[str, Any] | None = None,
) -> BestFlight:
    """Return the cheapest flight found from an initial condition to a trim.

    The cost is ∫ z'Qz + v'Rv dt, where z and v are the deviations from the trim. Collocation
    proposes the flight. The proposal is accepted if a simulation confirms it. Otherwise the result
    is the cheapest simulated flight, with the reason in `BestFlight.reason`.

    model: the aircraft
    point: trim at which the flight ends
    initial: state of the linear model -> deviation from the trim, in the units of the model, or
        another trim
    Q, R: weights, as `hfa.game` accepts them and with its defaults. R is the weight of the
        moving inputs.
    inputs: inputs that move, by default all. The others are constant.
    limits: state -> (lowest, highest), absolute, replacing the limits of the flight envelope
    policies: name -> policy, in any form that `hfa.fly` accepts, flown from the same initial
        condition for comparison (`BestFlight.policies`). Gains and critics are saturated

    Raises BadInputError for unknown names and an initial condition outside the limits. Raises
    NoSolutionError if no simulated flight within the limits converges.

    >>> import hfa
    >>> cart = hfa.Model(
    ...     "cart",
    ...     {"position": hfa.Signal("m"), "velocity": hfa.Signal("m/s")},
    ...     {"force": hfa.Signal("N", min=-1.0, max=1.0)},
    ...     lambda x, u, p, w: ({"position": x.velocity, "velocity": u.force}, {}),
    ...     trim={"position": 0.0},
    ... )
    >>> point = hfa.trim(cart)
    >>> round(hfa.optimize(cart, point, {"position": 0.1}).cost, 4)  # sqrt(3) position²
    0.0173
    """
    problem = flight_problem(model, point, Q, R, inputs, limits)
    start = problem.deviations(initial)
    search = BestFlights(problem)
    loops = [search.flights.of(name, policy) for name, policy in (policies or {}).items()]
    found = search.found(start)
    seconds = (1.0 + AFTER) * found.seconds
    others = tuple(search.flights.fly(loop, start, seconds) for loop in loops)
    return BestFlight(problem, found, others)


def optimize_starts(
    problem: FlightProblem,
    starts: int,
    policies: Mapping[str, Any],
    *,
    seed: int,
    progress: Progress | None,
) -> StartsTable:
    """Return the best flights from random initial conditions in the default box, and those of
    policies.

    starts: number of initial conditions
    policies: as for `optimize`
    seed: seed of the initial conditions
    """
    search = BestFlights(problem, starts)
    loops = [search.flights.of(name, policy) for name, policy in policies.items()]
    return starts_table(search, drawn_starts(problem, starts, seed), loops, progress)
