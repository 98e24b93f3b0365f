"""Costs of a policy's flights, beside those of the exact gain."""

from __future__ import annotations

import math
import statistics
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from controller.game.linear_game import default_weight
from hfa_aircraft.model import Model
from hfa_flight.judge.outcomes import TrimCase
from hfa_flight.plan.flights import AFTER, Flights, SimulatedFlight
from hfa_flight.plan.problem import drawn_starts, flight_problem
from hfa_flight.policies.deployment.deployed import Deployed
from hfa_flight.policies.deployment.policy import policy_about
from hfa_flight.policies.deployment.sampled_loop import Equilibrium
from hfa_support.errors import BadInputError, NoSolutionError, numbers_in, prefix_errors
from hfa_support.progress import Progress, with_progress
from hfa_support.reporting.results import Result
from trim.linear.modes import modes_of
from trim.point.operating_point import OperatingPoint


def has_weights(deployed: Deployed) -> bool:
    """Return whether the deployment file or the plant file contains the weights Q and R."""
    about = deployed.model.about
    is_of_file = about.weights_source == "file" and {"Q", "R"} <= set(about.weights)
    return deployed.deployment.cost is not None or is_of_file


def refuse_cross_weights(model: Model) -> None:
    """Raise BadInputError if a plant file contains cross weights N."""
    if np.any(numbers_in("N", model.about.weights.get("N", 0.0))):
        raise BadInputError(
            f"{model.name} has cross weights N, which are not supported; remove N, or give a "
            "deployment file with Q and R in [cost]"
        )


def cost_weights(deployed: Deployed) -> tuple[Mapping[str, float], Mapping[str, float]]:
    """Return Q of states and outputs, and R of inputs, by name, as given in the deployment file.

    Without a cost, the weights of the linear states and the commanded inputs are those of the model
    (`default_weight`).

    Raises BadInputError if a matrix Q or R of a model from a plant file is not diagonal.
    """
    cost = deployed.deployment.cost
    if cost is not None:
        return cost["Q"], cost["R"]
    model = deployed.model
    refuse_cross_weights(model)
    R = usual_weights("R", model)
    return usual_weights("Q", model), {name: R[name] for name in deployed.commanded}


def usual_weights(matrix: str, model: Model) -> dict[str, float]:
    """Return the diagonal of the default weight "Q" or "R" (`default_weight`), by name.

    Raises BadInputError if the matrix in a plant file is not diagonal.
    """
    names = tuple(model.linear if matrix == "Q" else model.inputs)
    weight = default_weight(matrix, model, model.linear, tuple(model.inputs))
    with prefix_errors(model.name):
        return diagonal_weights(matrix, weight, names)


def diagonal_weights(matrix: str, given: Any, names: Sequence[str]) -> dict[str, float]:
    """Return name -> weight of a diagonal matrix (k, k), or of its diagonal (k,).

    Raises BadInputError if the matrix is not diagonal.
    """
    weights = numbers_in(matrix, given)
    diagonal = np.diagonal(weights) if weights.ndim == 2 else weights
    # A matrix that is not diagonal has more nonzero entries than its diagonal.
    if diagonal.shape != (len(names),) or np.count_nonzero(weights) > np.count_nonzero(diagonal):
        raise BadInputError(
            f"{matrix} is not a diagonal matrix of {len(names)} weights; give one weight for each "
            f"of {', '.join(names)}"
        )
    return dict(zip(names, diagonal.tolist(), strict=True))


def weights_at(
    deployed: Deployed, place: Equilibrium | OperatingPoint
) -> tuple[np.ndarray, np.ndarray]:
    """Return Q (k, k) of the linear states and R (m', m') of the commanded inputs.

    The weights are those of the deployment file; an output with the weight q and the slopes c
    contributes q c c' to Q. Without them, they are the default weights of the model.

    Raises BadInputError for an output that depends on the inputs, and for cross weights.

    place: point at which the outputs are linearized
    """
    model, linear = deployed.model, deployed.model.linear
    if deployed.deployment.cost is None:
        refuse_cross_weights(model)
        usual = partial(default_weight, model=model, states=linear, inputs=deployed.commanded)
        return usual("Q"), usual("R")
    of_states, of_inputs = cost_weights(deployed)
    outputs = tuple(name for name in of_states if name not in linear)
    slopes = deployed.model.at(place.states, place.inputs, outputs)
    if np.any(slopes.D):
        wrong = [name for name, row in zip(outputs, slopes.D, strict=True) if row.any()]
        raise BadInputError(
            f"cost.Q.{wrong[0]} weights an output that depends directly on the inputs, which is "
            "not supported; give weights of states instead"
        )
    rows = deployed.model.state_places(linear)
    Q = np.diag([float(of_states.get(name, 0.0)) for name in linear])
    for name, row in zip(outputs, slopes.C[:, rows], strict=True):
        Q += float(of_states[name]) * np.outer(row, row)
    R = np.diag([float(of_inputs[name]) for name in deployed.commanded])
    return Q, R


def offset_rate(deployed: Deployed, point: OperatingPoint, equilibrium: Equilibrium) -> float:
    """Return the cost per second at an equilibrium, z'Qz + v'Rv in deviations from the trim."""
    Q, R = weights_at(deployed, point)
    model = point.model
    rows, columns = model.state_places(model.linear), model.input_places(deployed.commanded)
    z = (equilibrium.states - point.x)[rows]
    v = (equilibrium.inputs - point.u)[columns]
    return float(z @ Q @ z + v @ R @ v)


def cost_rate(deployed: Deployed) -> ca.Function:
    """Return the CasADi Function (X, U, trim) -> x'Q x + u'R u, the cost rate of an episode.

    x are the deviations of states and outputs from the trim, and u those of the inputs. Q and R are
    the weights from `cost_weights`.
    """
    Q, R = cost_weights(deployed)
    X, U, trim = deployed.symbols()
    at_state = deployed.values(X, U, trim)
    at_trim = deployed.at_trim(trim)
    terms = [weight * (at_state[name] - at_trim[name]) ** 2 for name, weight in {**Q, **R}.items()]
    return ca.Function("cost_rate", [X, U, trim], [ca.densify(ca.SX(sum(terms)))])


#: Longest time until the linear cost of a flight has decayed, s. Longer flights are not compared.
_LONGEST_HORIZON = 3000.0


class Ratios(NamedTuple):
    """Least, median and largest ratio of two costs."""

    least: float
    median: float
    worst: float

    @staticmethod
    def of(values: Sequence[float]) -> Ratios | None:
        """Return the ratios of some flights, or None without flights."""
        if not values:
            return None
        return Ratios(min(values), statistics.median(values), max(values))


class MeanCost(NamedTuple):
    """Mean and standard deviation of the costs of some flights."""

    mean: float
    deviation: float

    @staticmethod
    def of(costs: Sequence[float]) -> MeanCost | None:
        """Return the mean of some costs, or None without costs."""
        return MeanCost(float(np.mean(costs)), float(np.std(costs))) if costs else None

    def text(self) -> str:
        """Return the mean and the standard deviation as text."""
        return f"{self.mean:.4g}" + (f" ± {self.deviation:.3g}" if self.deviation else "")


@dataclass(frozen=True, eq=False)
class FlightCosts(Result):
    """Costs of a policy's flights from one trim's initial-condition box.

    The LQR is the exact gain of the linear model for the weights of the cost, saturated at the
    limits of the inputs. It begins at the same initial conditions as the policy.

    starts: number of initial conditions.
    not_converged: number of the policy's flights that leave the envelope or have not returned to
        the trim. The others converge.
    seconds: duration of the longest of the policy's flights, s.
    lqr_not_converged: number of the LQR's flights that leave or have not returned.
    both: number of initial conditions from which the flights of both converge.
    unresolved: number of converging flights whose cost changes with half the integration step.
    ratios: costs of the policy's flights relative to the LQR's, where both converge, or None.
    cost: cost of the policy's flights, where both converge, or None.
    lqr_cost: the same of the LQR's flights.
    offset_rate: cost per second of the steady-state error, or None without an equilibrium.
    """

    starts: int
    not_converged: int
    seconds: float
    lqr_not_converged: int
    both: int
    unresolved: int
    ratios: Ratios | None
    cost: MeanCost | None
    lqr_cost: MeanCost | None
    offset_rate: float | None

    @property
    def median(self) -> float:
        """Median of `ratios`, or inf if both return from no initial condition."""
        return math.inf if self.ratios is None else self.ratios.median

    def ratio_text(self) -> str:
        """Return the median of `ratios` as a phrase that names the comparison.

        If most flights of the policy do not converge, or none of the LQR where one of the policy
        does, the phrase says this.
        """
        if 2 * self.not_converged > self.starts:
            those = f"{self.not_converged} of {self.starts} flights"
            return f"{those} leave or have not returned after {self.seconds:.3g} s"
        if self.ratios is None:
            return "the exact gain returns from no initial condition from which the policy does"
        return f"median cost {_number(self.median)}x the exact gain's"

    def sentences(self) -> list[str]:
        """Return sentences on the mean costs and on the range of the ratios."""
        sentences = []
        if self.cost is not None and self.lqr_cost is not None:
            where = ""
            if self.both < self.starts:
                where = f" where both return ({self.both} of {self.starts})"
            sentences.append(f"mean cost {self.cost.text()}, LQR {self.lqr_cost.text()}{where}")
        if self.ratios is not None:
            least, _, worst = self.ratios
            between = f"{_number(least)} to {_number(worst)}"
            sentences.append(f"flights cost {between} x the exact gain's")
        if self.lqr_not_converged:
            sentences.append(
                f"of the LQR, {self.lqr_not_converged} of {self.starts} flights leave or have not "
                "returned"
            )
        if self.unresolved:
            sentences.append(f"{self.unresolved} flights are not resolved by the integration step")
        return sentences


def _number(ratio: float) -> str:
    """Return a ratio as text, without an exponent if it is large."""
    return f"{ratio:.0f}" if ratio >= 1000.0 else f"{ratio:.3g}"


def _refuse_slow(flights: Flights, starts: np.ndarray) -> None:
    """Raise NoSolutionError if the exact loop has a mode that decays in too long a time."""
    if max(map(flights.horizon, starts)) <= _LONGEST_HORIZON:
        return
    slowest = max(
        modes_of(flights.loop, flights.problem.states), key=lambda mode: mode.eigenvalue.real
    )
    state = max(slowest.participation, key=lambda name: slowest.participation[name])
    raise NoSolutionError(
        f"with the exact gain, the mode {slowest.name} has a time constant of "
        f"{-1.0 / slowest.eigenvalue.real:.3g} s; give a deployment file with a larger weight of "
        f"{state} in Q of [cost]"
    )


def flight_costs(
    deployed: Deployed, case: TrimCase, count: int, seed: int, progress: Progress | None
) -> FlightCosts:
    """Return the costs of flights from random initial conditions in the box of a trim.

    deployed: the policy. Without a cost in its deployment, the weights are those of `weights_at`
    count: number of initial conditions
    seed: seed of the initial conditions

    Raises NoSolutionError if no gain has a finite cost, or if a mode of the exact loop is so slow
    that flights until it has decayed are too long.
    """
    point = case.point
    Q, R = weights_at(deployed, point)
    problem = flight_problem(point.model, point, Q, R, inputs=deployed.commanded)
    flights = Flights(problem, count)
    loop = flights.of("policy", policy_about(deployed, point, "policy"))
    starts = drawn_starts(problem, count, seed, case.box)
    _refuse_slow(flights, starts)
    policy_flights: list[SimulatedFlight] = []
    lqr_flights: list[SimulatedFlight] = []
    for start in with_progress([*starts], progress):
        seconds = (1.0 + AFTER) * flights.horizon(start)
        lqr_flights.append(flights.linear(start, seconds))
        policy_flights.append(flights.fly(loop, start, seconds))
    converged = [flight for flight in policy_flights if flight.converges]
    lqr_converged = [flight for flight in lqr_flights if flight.converges]
    both_converged = [
        (flight, lqr_flight)
        for flight, lqr_flight in zip(policy_flights, lqr_flights, strict=True)
        if flight.converges and lqr_flight.converges
    ]
    rate = None
    if case.equilibrium is not None:
        rate = offset_rate(deployed, point, case.equilibrium)
    return FlightCosts(
        starts=count,
        not_converged=count - len(converged),
        seconds=max(flight.seconds for flight in policy_flights),
        lqr_not_converged=count - len(lqr_converged),
        both=len(both_converged),
        unresolved=sum(not flight.resolved for flight in (*converged, *lqr_converged)),
        ratios=Ratios.of([flight.cost / lqr_flight.cost for flight, lqr_flight in both_converged]),
        cost=MeanCost.of([flight.cost for flight, _ in both_converged]),
        lqr_cost=MeanCost.of([lqr_flight.cost for _, lqr_flight in both_converged]),
        offset_rate=rate,
    )
