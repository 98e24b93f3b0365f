"""Costs of a policy's flights, beside those of the exact gain."""

from __future__ import annotations

import math
from collections.abc import Mapping
from functools import partial
from typing import NamedTuple

import casadi as ca
import numpy as np

from controller.game.linear_game import default_weight
from controller.game.zero_sum import Game
from hfa_aircraft.model import Model
from hfa_flight.plan.scaled import hold_of
from hfa_flight.policies.deployment.actor import gain_function
from hfa_flight.policies.deployment.deployed import Deployed
from hfa_flight.policies.deployment.deployment import Deployment
from hfa_flight.policies.deployment.sampled_loop import Equilibrium, EquilibriumSearch
from hfa_flight.policies.given import diagonal_weights
from hfa_flight.simulate.sampled_flights import SampledFlight
from hfa_support.errors import BadInputError, NoSolutionError, numbers_in, prefix_errors
from hfa_support.matrices import power_of_two
from trim.point.operating_point import OperatingPoint


def has_weights(deployed: Deployed) -> bool:
    """Return whether the deployment file or the model has the weights Q and R."""
    has_own = {"Q", "R"} <= set(deployed.model.about.weights)
    return deployed.deployment.cost is not None or has_own


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
    """Return the diagonal of the weight "Q" or "R" of a model, by name, by default 1/nominal².

    Raises BadInputError if the matrix in a plant file is not diagonal.
    """
    states, inputs = tuple(model.linear), tuple(model.inputs)
    weight = default_weight(matrix, model, states, inputs)
    with prefix_errors(model.name):
        return diagonal_weights(matrix, weight, states if matrix == "Q" else inputs)


def weights_at(
    deployed: Deployed, place: Equilibrium | OperatingPoint
) -> tuple[np.ndarray, np.ndarray]:
    """Return Q (k, k) of the linear states and R (m', m') of the commanded inputs.

    The weights are those of the deployment file; an output with the weight q and the slopes c
    contributes q c c' to Q. Without them, they are the default weights of the model.

    Raises BadInputError for an output that depends on the inputs, and for cross weights, and
    NoSolutionError without Q and R.

    place: point at which the outputs are linearized
    """
    model, linear = deployed.model, deployed.model.linear
    if deployed.deployment.cost is None:
        if not has_weights(deployed):
            raise NoSolutionError(
                f"{deployed.deployment.origin} has no cost with diagonal Q and R alone, and the "
                f"file of {model.title} has no Q and R"
            )
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


class CostRatio(NamedTuple):
    """Cost of flights relative to that of the exact gain's from the same initial conditions.

    The exact gain is the LQR of the linear model for the weights of the cost and inputs that are
    held for a sample. It acts without a delay, within the limits of the inputs.

    median: median of the ratios; inf if most flights of the policy leave the envelope.
    low, high: ends of the 95 % band of the median, that of the order statistics.
    flights: number of flights of each.
    exact_left: number of the exact gain's flights that leave the envelope.
    seconds: time over which the costs are taken, s.
    """

    median: float
    low: float
    high: float
    flights: int
    exact_left: int
    seconds: float

    def text(self) -> str:
        """Return the ratio as a phrase, with its band and the time."""
        if not math.isfinite(self.median):
            return "the median cost is not finite, as flights leave"
        band = f"{_number(self.low)} to {_number(self.high)}, 95 %" if self.flights > 5 else ""
        over = f"in {self.seconds:.3g} s"
        return f"median cost {_number(self.median)}x the exact gain's {over}" + (
            f" ({band})" if band else ""
        )


def _number(ratio: float) -> str:
    """Return a ratio as text, without an exponent if it is large."""
    return f"{ratio:.0f}" if ratio >= 1000.0 else f"{ratio:.3g}"


def cost_ratio(costs: np.ndarray, exact: np.ndarray, seconds: float) -> CostRatio:
    """Return the ratio of costs of flights, inf for one that leaves, from the same starts, (N,)."""
    from scipy.stats import binom

    exact_left = int(np.isinf(exact).sum())
    with np.errstate(invalid="ignore", divide="ignore"):
        ratios = np.sort(np.where(np.isinf(exact), 0.0, costs / exact))
    count = len(ratios)
    rank = int(binom.ppf(0.025, count, 0.5))  # of the ends of the band
    low, high = (ratios[max(rank - 1, 0)], ratios[min(count - rank, count - 1)])
    return CostRatio(float(np.median(ratios)), float(low), float(high), count, exact_left, seconds)


class SampleCost:
    """Cost of each sample of flights about a trim, exact for the linear model between samples.

    deployed: the policy, whose weights are used, on its aircraft
    point: the trim
    flight: layout of the states of its flights
    """

    def __init__(self, deployed: Deployed, point: OperatingPoint, flight: SampledFlight) -> None:
        """Prepare the weights of the parts of a sample in which one command acts.

        Raises NoSolutionError without an exact gain, and BadInputError without weights.
        """
        model, self._flight = deployed.model, flight
        at_trim = EquilibriumSearch(deployed, point).at_trim()
        self.game = game = lqr_at(deployed, at_trim)
        self._rows = model.state_places(model.linear)
        self._columns = model.input_places(deployed.commanded)
        self._x, self._u = model.nominal(model.linear), model.nominal(deployed.commanded)
        self._trim = point.x[self._rows], point.u[self._columns]
        whole, rest = flight.delay_in_samples
        # Of each part, the number of samples ago of the command that acts, and its weights.
        self._parts = [
            (ago, hold_of(game.A, game.B, game.Q, game.R, seconds))
            for ago, seconds in ((whole + 1, rest), (whole, flight.dt - rest))
            if seconds > 0.0
        ]

    def exact(self) -> Deployment:
        """Return the exact gain of held inputs as a deployment without delay."""
        game, names = self.game, self._flight.deployed.commanded
        hold = hold_of(game.A, game.B, game.Q, game.R, self._flight.dt)
        K, _ = hold.infinite_horizon()
        linear = self._flight.deployed.model.linear
        return Deployment(
            policy={"file": gain_function(K)},
            observation={
                name: {"scale": size} for name, size in zip(linear, self._x.tolist(), strict=True)
            },
            action={
                name: {"map": f"trim + {size!r} * a"}
                for name, size in zip(names, self._u.tolist(), strict=True)
            },
            timing={"dt": self._flight.dt},
            origin="the exact gain",
        )

    def of(self, states: np.ndarray) -> np.ndarray:
        """Return the cost of the samples of a window, (F,), from its states (F, T + 1, s)."""
        (x0, u0), m = self._trim, len(self._flight.deployed.model.inputs)
        z = (states[:, :-1, self._flight.slices.X][..., self._rows] - x0) / self._x
        memory = states[..., self._flight.slices.memory]
        cost = np.zeros(len(states))
        with np.errstate(all="ignore"):  # a flight may diverge
            for ago, hold in self._parts:
                # The command of the sample itself is the latest one after the sample.
                held = memory[:, 1:, :m] if ago == 0 else memory[:, :-1, (ago - 1) * m : ago * m]
                v = (held[..., self._columns] - u0) / self._u
                both = np.concatenate([z, v], axis=2)
                cost += np.einsum("fti,ij,ftj->f", both, hold.W, both)
                z = z @ hold.A.T + v @ hold.B.T
        return cost


def lqr_at(deployed: Deployed, at: Equilibrium) -> Game:
    """Return the LQR problem of the linearization at an equilibrium, in nominal values.

    Q and R are those of the deployment, in a unit of the cost in which the largest is about 1.
    """
    model = deployed.model
    x = model.nominal(model.linear)
    u = model.nominal(deployed.commanded)
    of_states, of_inputs = weights_at(deployed, at)
    Q, R = of_states * np.outer(x, x), of_inputs * np.outer(u, u)
    largest = power_of_two(np.array(max(np.abs(Q).max(), np.abs(R).max())))
    A, B = at.nominal.A, at.nominal.B
    return Game(A, B, E=np.eye(len(A)), Q=Q / largest, R=R / largest, delta=math.inf)
