"""Predictive policy: plans a flight of the nonlinear model at each sample, and flies its begin."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from controller.game.linear_game import game
from controller.riccati.gare import solve
from hfa_aircraft.model import Model
from hfa_flight.policies.sampled_policy import SampledPolicy
from hfa_flight.problem import FlightProblem, flight_problem
from hfa_optimal.end_law import EndLaw
from hfa_optimal.holds import grid_of, hold_of
from hfa_optimal.planner import Planner
from hfa_optimal.receding import RecedingHorizon, Samples
from hfa_optimal.scaled import ScaledProblem
from hfa_support.arguments import ArrayLike, checks_arguments, need
from hfa_support.errors import BadInputError, refuse_unless_positive, shown
from trim.point.operating_point import OperatingPoint

#: Default fraction of the distances from trim to limits by which a plan's envelope is narrowed.
MARGIN = 0.03
#: Estimate of one constant disturbance for each rate, and no estimate.
RATES = "rates"
NOTHING = "nothing"


@dataclass(frozen=True, eq=False, repr=False)
class Predictive(SampledPolicy):
    """Policy that plans a flight at each sample and applies its first inputs.

    problem: aircraft, trim, weights and limits
    controller: the plans and the memory of a flight, in nominal units
    """

    problem: FlightProblem
    controller: RecedingHorizon

    def reset(self) -> None:
        """Forget the plan, the estimates and the times of an earlier flight."""
        self.controller.reset()

    def __call__(self, t: float, X: Any) -> np.ndarray:
        """Return the inputs U of the sample at t, absolute, (m,).

        t: s
        X: all states, absolute, (n,) or by name in their order
        """
        z = self.problem.followed_of(X)
        return self.problem.inputs_of(self.controller(z, self.delay))

    @property
    def holds(self) -> np.ndarray:
        """Durations of the holds of a plan, s, (N,). The first is the sample time."""
        return self.controller.planner.grid.holds

    @property
    def K(self) -> np.ndarray:
        """Held gain of v = -K z near the trim, (m, k)."""
        of_states, of_inputs = self.problem.sizes
        nominal = self.controller.nominal_gain
        return nominal * of_inputs[:, None] / of_states[: nominal.shape[1]]

    @property
    def samples(self) -> Samples:
        """Record of the samples since the last reset: plans, refused steps, times."""
        return self.controller.samples

    def sampled_modes(self) -> np.ndarray:
        """Return the eigenvalues of the held linear loop near the trim, 1/s, (k,)."""
        values = self.controller.nominal_poles
        return np.log(values[values != 0.0].astype(complex)) / self.dt


@checks_arguments
def predictive(
    model: Model,
    point: OperatingPoint,
    Q: ArrayLike | Mapping[str, float] | None = None,
    R: ArrayLike | Mapping[str, float] | None = None,
    *,
    delta: float = math.inf,
    dt: float | None = None,
    horizon: float | None = None,
    margin: float = MARGIN,
    estimate: str = RATES,
    inputs: Sequence[str] | None = None,
    limits: Mapping[str, Any] | None = None,
) -> Predictive:
    """Return the policy that plans a flight to the trim at each sample and flies its begin.

    The plan minimizes ∫ z'Qz + v'Rv dt over the horizon plus z'Pz at its end. z and v are the
    deviations of states and inputs from the trim, P is the exact solution of the linear game. The
    equations are those of the nonlinear model, and the running cost that of the linear model with
    held inputs. Inputs stay within their limits. The limits of states are soft: exceeding them
    costs more than it saves. A plan is improved by one quadratic program a sample, and only if the
    flight of the model becomes cheaper. Where the linear loop keeps all limits, the exact held gain
    takes over.

    This does not prove that a flight converges or stays within the limits. Plans are local optima.
    The limits of states hold at the nodes of a plan, for the model without other disturbances than
    the estimated ones.

    model: the aircraft
    point: trim at which flights end
    Q, R: weights, as `hfa.game` accepts them, by default diag(1/nominal²); R is the weight of the
        moving inputs
    delta: δ of the game whose P and K are at the end of a plan; by default the LQR
    dt: sample time, s, by default chosen from the linear model
    horizon: duration of a plan, s, by default chosen from the linear model
    margin: fraction of the distances from trim to limits by which a plan's envelope is narrowed
    estimate: "rates" for one constant disturbance of each rate, estimated from the samples; the
        name of a disturbance of the model, which is estimated too; or "nothing"
    inputs: inputs that move, by default all
    limits: state -> (lowest, highest), absolute, replacing the limits of the flight envelope

    Raises BadInputError for a wrong argument, and NoSolutionError if the linear model cannot be
    stabilized or the game has no solution.

    >>> import hfa
    >>> force = hfa.Signal("N", min=-1.0, max=1.0)
    >>> def moved(x, u, p, w):
    ...     return {"speed": u.force}, {}
    >>> slider = hfa.Model("slider", {"speed": hfa.Signal("m/s")}, {"force": force}, moved)
    >>> policy = hfa.predictive(slider, hfa.trim(slider))
    >>> policy(0.0, [3.0]).round(3).tolist(), policy.dt  # as fast as the force permits
    ([-1.0], 0.1)
    """
    need(model, Model, "predictive: model", Model.how_to_make)
    need(point, OperatingPoint, "predictive: point", "a trim: hfa.trim(model)")
    if dt is not None:
        refuse_unless_positive("dt", dt, " s")
    if not 0.0 <= margin < 1.0:
        raise BadInputError(f"margin is {shown(margin)}; give a fraction from 0 to less than 1")
    own = "" if estimate in (RATES, NOTHING) else estimate
    if own and own not in model.disturbances:
        names = ", ".join([RATES, NOTHING, *model.disturbances])
        raise BadInputError(f"estimate is {shown(estimate)}; give one of {names}")
    problem = flight_problem(model, point, Q, R, inputs, limits)
    return policy_of(problem, delta, dt, horizon, margin, estimate)


def policy_of(
    problem: FlightProblem,
    delta: float = math.inf,
    dt: float | None = None,
    horizon: float | None = None,
    margin: float = MARGIN,
    estimate: str = RATES,
) -> Predictive:
    """Return the predictive policy of a problem. The arguments are those of `predictive`."""
    own = "" if estimate in (RATES, NOTHING) else estimate
    scaled = ScaledProblem(problem)
    grid = grid_of(scaled, dt, horizon)
    P, K = _end_of(scaled, grid.dt, delta)
    planner = Planner(scaled, grid, P, margin, own)
    end = EndLaw(scaled, hold_of(*scaled.linear_states, grid.dt), K)
    controller = RecedingHorizon(planner, end, estimates=estimate != NOTHING)
    identity = {
        "predictive": [problem.Q.tolist(), problem.R.tolist(), delta, margin, estimate],
        "holds": grid.holds.tolist(),
    }
    held = np.zeros((1, len(problem.model.inputs)))
    return Predictive(
        "predictive", problem.point, grid.dt, problem, controller, held=held, identity=identity
    )


def _end_of(scaled: ScaledProblem, dt: float, delta: float) -> tuple[np.ndarray, np.ndarray]:
    """Return P (n, n) of the game and the gain K (m, k) of the game held dt for ever."""
    problem = scaled.problem
    k, n, _ = scaled.sizes
    if math.isinf(delta):
        K, _ = hold_of(*scaled.linear_states, dt).forever()
        return scaled.P, K
    of_states, of_inputs = problem.sizes
    solution = solve(game(problem.linear, problem.Q, problem.R, delta=delta))
    P = np.pad(np.array(solution.P), [(0, n - k)] * 2) * np.outer(of_states, of_states)
    return P, np.array(solution.K) * of_states[:k] / of_inputs[:, None]
