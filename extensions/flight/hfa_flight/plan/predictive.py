"""Predictive policy: plans a nonlinear flight at each sample and applies its first inputs."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from controller.game.held_game import held
from controller.game.linear_game import game
from controller.game.zero_sum import Game
from controller.riccati.gare import solve
from hfa_aircraft.model import Model
from hfa_flight.plan.held_model import wrong_samples_note
from hfa_flight.plan.planner import Planner
from hfa_flight.plan.problem import FlightProblem, flight_problem
from hfa_flight.plan.receding import FlownSamples, RecedingHorizon
from hfa_flight.plan.scaled import HOLDS, EndPolicy, ScaledProblem, grid_of, hold_of
from hfa_flight.policies.policy import NextSample, SampledPolicy
from hfa_support.arguments import ArrayLike
from hfa_support.errors import (
    BadInputError,
    refuse_unless_positive,
    shown,
)
from trim.point.operating_point import OperatingPoint

#: Default fraction of the distances from trim to limits by which a plan's envelope is narrowed.
MARGIN = 0.01


@dataclass(frozen=True, eq=False, repr=False)
class Predictive(SampledPolicy):
    """Policy that plans a flight at each sample and applies its first inputs.

    problem: aircraft, trim, weights and limits
    controller: the plans and the memory of a flight, in nominal units
    """

    plans = True

    problem: FlightProblem
    controller: RecedingHorizon

    def reset(self) -> None:
        """Forget the plan and the times of an earlier flight."""
        self.controller.reset(self.delay)

    def begin(self, X: Any, following: NextSample | None = None) -> None:
        """Begin a flight with a first plan, which takes longer than a sample.

        X: all states that are expected at the first sample, absolute, (n,). The plan is improved
            from the states of that sample, or made anew if they differ much
        following: as in `of_estimate`, or None without an estimate
        """
        scaled = None if following is None else self._scaled(following)
        self.controller.begin(self.problem.followed_of(X), self.delay, scaled)

    def __call__(self, t: float, X: Any) -> np.ndarray:
        """Return the inputs U of the sample at t, absolute, (m,).

        A sample that is not finite or impossible is not used: its prediction is.

        t: s
        X: all states, absolute, (n,) or by name in their order
        """
        return self.problem.inputs_of(self.controller(self.problem.followed_of(X)))

    def of_estimate(self, t: float, X: np.ndarray, following: NextSample) -> np.ndarray:
        """Return the inputs U (m,) from a filter's estimate of all states, used without a check.

        following: what is known of the next sample, for which the limits of states are moved and
            narrowed
        """
        z = self.problem.followed_of(X)
        return self.problem.inputs_of(self.controller(z, self._scaled(following)))

    def _scaled(self, following: NextSample) -> NextSample:
        """Return what is known of the followed states in nominal values, (followed,) each."""
        places, nominal = self.problem.followed_places, self.problem.nominal.states
        return NextSample(*(values[places] / nominal for values in following))

    @property
    def holds(self) -> np.ndarray:
        """Durations of the holds of a plan, s, (N,). The first is the sample time."""
        return self.controller.planner.grid.at(0).seconds

    @property
    def K(self) -> np.ndarray:
        """Held gain of v = -K z near the trim, (m, k)."""
        return self.problem.gain_of(self.controller.end.K)

    @property
    def samples(self) -> FlownSamples:
        """Record of the samples since the last reset: plans, refused steps, times."""
        return self.controller.samples

    @property
    def first_plan(self) -> float | None:
        """Cost of the first plan, or None without one and of a flight that begins at its target."""
        first = self.samples.first
        return None if first is None or first.cost <= self.controller.cost_at_target else first.cost

    def sampled_modes(self) -> np.ndarray:
        """Return the eigenvalues of the held linear loop near the trim, 1/s, (k,)."""
        poles = self.controller.end.poles  # of the loop from sample to sample
        # A pole of 0, which has no logarithm, is a mode that ends within one sample.
        return np.log(poles[poles != 0.0].astype(complex)) / self.dt

    def data(self, model: Model) -> dict[str, Any]:
        """Return the JSON data on the policy.

        They contain the counts of `FlownSamples`, the number of wrong samples in whose place the
        prediction was used, quantiles of the computing times in s, and the cost `first_plan`.
        """
        samples = self.samples
        median = high = None
        if len(samples.seconds):
            median, high = np.quantile(samples.seconds, (0.5, 0.99)).tolist()
        entries = {
            "planned": samples.planned,
            "refused": samples.refused,
            "unsolved": samples.unsolved,
            "late": samples.late,
            "linear": samples.linear,
            "wrong": self.controller.measured.wrong_count,
            "median_seconds": median,
            "seconds_99": high,
            "first_plan": self.first_plan,
        }
        return {**super().data(model), "dt": self.dt, "holds": self.holds, "samples": entries}

    def notes(self) -> tuple[str, ...]:
        """Return what the samples of the last flight needed, and what they found."""
        samples = self.samples
        lines = [
            f"Plans minimize the {self.problem.weights_text()}.",
            f"Plans of {self.holds.sum():.3g} s in {len(self.holds)} holds, one every "
            f"{self.dt:g} s; not proved to converge or to stay inside.",
            f"Limits of states narrowed by {100 * self.controller.planner.margin:.3g} % of their "
            "distance from the trim (margin).",
            f"{samples.planned} samples with a plan, {samples.linear} with the exact gain for a "
            f"zero-order hold; {samples.refused} steps of the quadratic program refused.",
        ]
        asked = self.controller.planner.grid.asked
        if asked is not None:
            lines.append(
                f"The horizon of {asked:g} s was cut to {self.holds.sum():.3g} s: plans are "
                f"open-loop flights of at most {2 * HOLDS} holds."
            )
        if self.first_plan is not None:
            when = "made before" if self.samples.is_before else "made in the first sample of"
            lines.append(
                f"First plan: cost {self.first_plan:.6g}, {when} the flight in "
                f"{1e3 * samples.first_seconds:.3g} ms."
            )
        if len(samples.seconds):
            lines.append(self._time_text())
        if samples.unsolved:
            lines.append(
                f"HPIPM ended {samples.unsolved} programs before its tolerance. Flights judged "
                "them."
            )
        return (*lines, *wrong_samples_note(self.controller.measured.wrong_count))

    def _time_text(self) -> str:
        """Return the processor time of the samples, and what the budget did, as a sentence."""
        seconds, budget = np.array(self.samples.seconds), self.controller.budget
        median, most = np.quantile(seconds, (0.5, 0.99))
        if math.isinf(budget):
            ended = (
                f"{(seconds > self.dt).sum()} of {len(seconds)} took longer than "
                f"{1e3 * self.dt:g} ms and were flown as if they had not."
            )
        else:
            ended = (
                f"No further program begins after {1e3 * budget:.3g} ms, which ended "
                f"{self.samples.late} samples."
            )
        return (
            f"Processor time of a sample: median {1e3 * median:.2g} ms, 99 % below "
            f"{1e3 * most:.2g} ms. {ended}"
        )


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
    budget: float | None = None,
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
    The limits of states hold at the nodes of a plan, for the model in still air. Behind
    `hfa.filter`, they are moved by what the estimated air along the path adds to the states in a
    sample, and narrowed by 4 standard deviations of the predicted states, at most to half.

    model: the aircraft
    point: trim at which flights end
    Q, R: weights, as `hfa.game` accepts them and with its defaults; R is the weight of the
        moving inputs
    delta: δ of the game whose P and K are at the end of a plan; by default the LQR
    dt: sample time, s, by default chosen from the linear model
    horizon: duration of a plan, s, by default chosen from the linear model. The rule cuts a longer
        one than it permits, and the notes of a flight say so
    margin: fraction of the distances from trim to limits by which a plan's envelope is narrowed
    budget: processor time of a sample after which no further quadratic program begins, s, by
        default half of dt. The plan of the sample before is then flown on. With math.inf, flights
        do not depend on the machine
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
    ([-1.0], 0.2)
    """
    if dt is not None:
        refuse_unless_positive("dt", dt, " s")
    if not 0.0 <= margin < 1.0:
        raise BadInputError(f"margin is {shown(margin)}; give a fraction from 0 to less than 1")
    if budget is not None and not budget > 0.0:
        raise BadInputError(f"budget is {shown(budget)}; give a time above 0 s")
    problem = flight_problem(model, point, Q, R, inputs, limits)
    end_game = game(problem.linear, Q=problem.Q, R=problem.R, delta=delta)
    scaled = ScaledProblem(problem)
    grid = grid_of(scaled, dt, horizon)
    P, K = _end_of(scaled, grid.dt, end_game)
    planner = Planner(scaled, grid, P, margin)
    end = EndPolicy(scaled, hold_of(*scaled.linear_states, grid.dt), K)
    if budget is None:
        budget = 0.5 * grid.dt
    controller = RecedingHorizon(planner, end, budget)
    controller.rehearse()
    return Predictive("predictive", problem.point, grid.dt, problem, controller)


def _end_of(scaled: ScaledProblem, dt: float, end_game: Game) -> tuple[np.ndarray, np.ndarray]:
    """Return P (n, n) of a game in continuous time, and the gain K (m, k) of the same game with
    inputs that are held for samples dt, in nominal units.
    """
    k, n, _ = scaled.counts
    if math.isinf(end_game.delta):  # the LQR, whose P the problem has
        K, _ = hold_of(*scaled.linear_states, dt).infinite_horizon()
        return scaled.P, K
    of_states, of_inputs = scaled.problem.nominal
    P = np.pad(np.array(solve(end_game).P), [(0, n - k)] * 2) * np.outer(of_states, of_states)
    K = np.array(solve(held(end_game, 1.0 / dt)).K)
    return P, K * of_states[:k] / of_inputs[:, None]
