"""`hfa.fly`: one flight of a policy, or many with random differences."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, overload

import numpy as np

from hfa.options.command import ProgressLine
from hfa_aircraft.batch_simulation import Cost
from hfa_aircraft.limits import Limits
from hfa_aircraft.model import Model
from hfa_flight.air.scenario import Scenario, Uncertainty, with_errors
from hfa_flight.needs import ALL
from hfa_flight.policies.given import policy_and_scenario
from hfa_flight.policies.policy import OpenLoop
from hfa_flight.samples.monte_carlo import MonteCarlo, run_monte_carlo
from hfa_flight.samples.report import member_report
from hfa_flight.simulate.closed_loop import FlightLoop, NonlinearPlant
from hfa_flight.simulate.envelope import flight_envelope
from hfa_flight.simulate.flight import Flight, lengthened, simulated_loop
from hfa_support.errors import BadInputError, numbers_in, refuse_unknown, refuse_unless_positive
from hfa_support.matrices import LARGEST, checked_matrix, shape_text
from hfa_support.progress import Progress
from hfa_support.reporting.report import Report, Reported
from trim.point.operating_point import OperatingPoint


@dataclass(frozen=True, eq=False, repr=False)
class FlightsInAir(Reported):
    """Flights of a policy from a trim, each with its own random differences.

    plan: the flights
    flown: name of a result -> its values, one row for each flight
    uncontrolled: results of the same flights without control, or None if no policy acts

    >>> import hfa
    >>> from hfa_flight import Uncertainty
    >>> model = hfa.aircraft()
    >>> point = hfa.trim(model, dihedral=0.2)
    >>> noisy = hfa.Scenario(0.1, uncertainty=Uncertainty(noise={"speed": 0.3}))
    >>> hfa.fly(model, point, scenario=noisy, samples=2).ok
    True
    """

    plan: MonteCarlo
    flown: Mapping[str, np.ndarray]
    uncontrolled: Mapping[str, np.ndarray] | None = None

    @property
    def ok(self) -> bool:
        """True if enough flights stay within their limits."""
        return bool(self.report().data["ok"])

    def __bool__(self) -> bool:
        return self.ok

    @property
    def warnings(self) -> list[str]:
        """Warnings about the trim, each once."""
        return list(dict.fromkeys(self.plan.point.warnings))

    def report(self) -> Report:
        """Return the report: flights that leave, the 95 % band of their share, and quantiles."""
        return member_report(self.plan, self.flown, self.uncontrolled)


def flights_in_air(
    plan: MonteCarlo, workers: int | str = 1, progress: Progress | None = None
) -> FlightsInAir:
    """Simulate the flights of a plan in memory.

    workers: as for `open_workers`
    progress: callback, by default a line on a terminal
    """
    flown = run_monte_carlo(plan, workers, progress or ProgressLine("simulate"))
    return FlightsInAir(plan, flown, uncontrolled(plan, workers))


def uncontrolled(plan: MonteCarlo, workers: int | str) -> Mapping[str, np.ndarray] | None:
    """Return the results of the same flights with the inputs at trim, or None if no policy acts."""
    if isinstance(plan.policy, OpenLoop):
        return None
    no_policy, scenario = policy_and_scenario(None, plan.point, plan.scenario)
    inputs_at_trim = replace(plan, policy=no_policy, scenario=scenario)
    return run_monte_carlo(inputs_at_trim, workers, ProgressLine("simulate without control"))


#: Limits of the states, or only those that differ from the usual ones.
_Envelope = Limits | Mapping[str, tuple[float, float]] | None


@overload
def fly(
    model: Model,
    point: OperatingPoint,
    policy: Any = None,
    duration: float | None = None,
    *,
    initial: Any = None,
    scenario: Scenario | None = None,
    envelope: _Envelope = None,
    predict: bool = True,
    weights: tuple[np.ndarray, np.ndarray] | None = None,
    progress: Progress | None = None,
) -> Flight: ...


@overload
def fly(
    model: Model,
    point: OperatingPoint,
    policy: Any = None,
    duration: float | None = None,
    *,
    initial: Any = None,
    scenario: Scenario | None = None,
    envelope: _Envelope = None,
    progress: Progress | None = None,
    samples: int,
    seed: int = 0,
    share: float = ALL,
) -> FlightsInAir: ...


def fly(
    model: Model,
    point: OperatingPoint,
    policy: Any = None,
    duration: float | None = None,
    *,
    initial: Any = None,
    scenario: Scenario | None = None,
    envelope: _Envelope = None,
    predict: bool = True,
    weights: tuple[np.ndarray, np.ndarray] | None = None,
    progress: Progress | None = None,
    samples: int | None = None,
    seed: int = 0,
    share: float = ALL,
) -> Flight | FlightsInAir:
    """Simulate a policy u on the nonlinear aircraft X' = f(X, U0 + u, w) + d and return the flight.

    The flight ends where it leaves the envelope. With `predict`, its report
    compares it with the flight of the linear model x' = A x + B u + E w + d with nominal
    parameters, up to the same time, which is simulated when it is first read (`flight.predicted`).

    The steps of the integration have errors of at most 1e-7 of each state. A Python function of (t,
    X) is called once a tick of each of the two flights.

    With `samples`, so many flights are simulated, each with its own draw of the scenario's random
    quantities, and returned as `hfa.FlightsInAir`.

    model: the aircraft with nominal parameters
    point: the trim X0, U0, relative to which x and u are defined
    policy: a gain K (m, k) of u = -K z, a critic, a solution, a network, a deployment, a file of
      one of these, a `Policy`, steps of inputs or a function. Steps are deviations from trim,
      {name: [(time, value), ...]}. A function of (t, X) returns U and is called once a tick. With
      None, the inputs remain at trim.
    duration: s. Default: that of the scenario, or 20 s without a scenario, or more if the
      linear loop has growing modes
    initial: deviations from trim at the start, by the names of states (numbers, or text with a
        unit: "2 deg"), or (n,)
    scenario: disturbances, noise and faults. Of a single flight, its random quantities must be
        drawn already
    envelope: limits, or only those that differ from `flight_envelope(model, point)`
    predict: whether the flight is compared with that of the linear model, except with a policy that
        plans. Of a single flight
    weights: Q (k, k) and R (m, m) of the cost of a single flight, or None without a cost
    progress: called during the flights; by default a line on a terminal
    samples: number of flights, or None for a single one
    seed: seed of the random quantities of several flights
    share: share of several flights that must stay within their limits, by default all

    Raises BadInputError if the flight does not begin inside the envelope, the scenario has random
    quantities that are not drawn yet, or the policy is not supported.

    >>> import hfa
    >>> model = hfa.aircraft()
    >>> point = hfa.trim(model, hfa.paper.level_flight(0.2))
    >>> solution = hfa.solve(hfa.paper.published_game(hfa.linearize(model, point)))
    >>> hfa.fly(model, point, solution, 1.0, initial={"alpha": 0.01}).states.shape
    (1001, 7)
    """
    if samples is None:
        if seed != 0 or share != ALL:
            raise BadInputError("fly: seed and share apply to several flights; add samples=N")
        if scenario is not None and scenario.uncertainty != Uncertainty():
            raise BadInputError(
                "the random quantities of the scenario are not drawn; call scenario.drawn(seed, "
                "member, point), or add samples=N for N flights"
            )
    elif weights is not None:
        raise BadInputError("fly: weights are of the cost of a single flight; remove samples")
    own_scenario = _scenario_of(model, scenario or Scenario(), duration, initial)
    flown_policy, own_scenario = policy_and_scenario(policy, point, own_scenario)
    limits = envelope if isinstance(envelope, Limits) else flight_envelope(model, point, envelope)
    if samples is not None:
        plan = MonteCarlo(
            samples, seed, model, point, flown_policy, own_scenario, limits, share=share
        )
        return flights_in_air(plan, progress=progress)
    plant = NonlinearPlant(with_errors(model, own_scenario), point)
    cost = None if weights is None else _cost_of(model, weights)
    loop = FlightLoop(plant, flown_policy, own_scenario, cost, limits)
    if duration is None and scenario is None:
        loop = replace(loop, scenario=lengthened(loop))
    return simulated_loop(loop, predict=predict, progress=progress or ProgressLine("fly"))


def _cost_of(model: Model, weights: Sequence[Any]) -> Cost:
    """Return the cost of weights (Q, R) of a user."""
    sizes = {"Q": len(model.linear), "R": len(model.inputs)}
    if len(weights) != len(sizes):
        raise BadInputError(f"fly: weights has {len(weights)} entries; give the two matrices Q, R")
    matrices = {}
    for (name, n), weight in zip(sizes.items(), weights, strict=True):
        matrices[name] = checked_matrix(name, weight, LARGEST)
        if matrices[name].shape != (n, n):
            given = shape_text(matrices[name].shape)
            raise BadInputError(f"fly: {name} is {given}; give {shape_text((n, n))}")
    return Cost(**matrices)


def _scenario_of(model: Model, given: Scenario, duration: float | None, initial: Any) -> Scenario:
    """Return the scenario for a flight of a model, with its duration and initial condition."""
    if duration is not None:
        refuse_unless_positive("fly: duration", duration, " s")
    scenario = given if duration is None else replace(given, duration=float(duration))
    if isinstance(initial, Mapping):
        for name in initial:
            refuse_unknown("initial names the unknown state", name, tuple(model.states))
        initial = [model.number(name, initial.get(name, 0.0)) for name in model.states]
    if initial is not None:
        scenario = replace(scenario, initial=numbers_in("initial", initial))
    return scenario.on(model)
