"""One flight of the nonlinear aircraft under a linear policy, beside what the linear model predicts."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from controller.flight.actuators import ActuatedPolicy, Actuators
from controller.flight.closed_loop import ClosedLoop, CompiledLoop, Flight
from controller.flight.envelope import Departure, Envelope
from controller.flight.gain_plan import GainPlan
from controller.flight.gusts import Gust
from controller.flight.plants import LinearizedAircraft, NonlinearPlant, Plant
from controller.flight.policies import GainPolicy, Policy
from controller.flight.signals import TimeVector, zero
from controller.flight.times import Timed
from hfa_model.aircraft import Aircraft
from hfa_model.parameters import Parameters
from hfa_model.support.errors import BadInputError
from hfa_model.vectors import INPUTS, LINEAR_STATES, STATES
from trim.point.condition import CONTROL_LIMITS
from trim.point.operating_point import OperatingPoint

_N = len(LINEAR_STATES)


@dataclass(frozen=True, eq=False)
class Scenario(Timed):
    """What happens in a flight. Everything is off unless given.

    duration, step, tick: s; gains and turbulence change once a tick, which holds a whole number of steps.
    initial: (7,), deviation from trim. reference, disturbance, noise: (6,) each. errors: parameter -> factor on
    the flown aircraft, which the design does not know. actuators, gust: stages of the loop. BadInputError when the
    times do not fit each other or the actuators, are too long, or an error names no parameter.
    """

    duration: float = 20.0
    step: float = 0.001
    tick: float = 0.01
    initial: np.ndarray = field(default_factory=lambda: np.zeros(len(STATES)))
    reference: TimeVector = field(default_factory=lambda: zero(_N))
    disturbance: TimeVector = field(default_factory=lambda: zero(_N))
    noise: TimeVector = field(default_factory=lambda: zero(_N))
    errors: Mapping[str, float] = field(default_factory=dict)
    actuators: Actuators | None = None
    gust: Gust | None = None

    def __post_init__(self) -> None:
        """Refuse times that do not fit and errors of nothing."""
        self.check_times()
        if self.actuators is not None:
            self.actuators.refuse_step(self.step)
        for name, factor in self.errors.items():
            if name not in Parameters._fields:
                raise BadInputError(f"unknown parameter {name!r}; choose from {', '.join(Parameters._fields)}")
            if not (np.isfinite(factor) and factor > 0.0):
                raise BadInputError(f"the error of {name} is a factor of {factor}; it must be a positive number")

    def with_gust(self, gust: Gust | None) -> Scenario:
        """The same with a gust, which may need the ticks of the flight to be made."""
        return replace(self, gust=gust)


@dataclass(frozen=True, eq=False)
class NonlinearFlight:
    """A flight, up to the first tick that left the envelope.

    flight: of the nonlinear aircraft, deviations from `point`. predicted: the same of its linear model, None when
    none was asked for. departure: which state left the envelope first, None when it held.
    """

    scenario: Scenario
    point: OperatingPoint
    envelope: Envelope
    flight: Flight
    predicted: Flight | None
    departure: Departure | None

    @property
    def states(self) -> np.ndarray:
        """X, absolute, (N, 7)."""
        return self.flight.states + np.array(self.point.states)

    @property
    def inputs(self) -> np.ndarray:
        """U, absolute, (N, 5)."""
        return self.flight.inputs + np.array(self.point.inputs)

    @property
    def rms_errors(self) -> np.ndarray:
        """Root mean square of the tracking error z over the second half of the flight, (6,)."""
        late = self.flight.errors[len(self.flight.errors) // 2 :]
        return np.asarray(np.sqrt(np.mean(late**2, axis=0)))

    @property
    def beyond_limits(self) -> np.ndarray:
        """Share of the flight in which each input lay beyond `CONTROL_LIMITS`, (5,)."""
        limits = np.array(CONTROL_LIMITS)
        slack = 1e-9 * (1 + np.abs(limits))
        outside = (self.inputs < limits[:, 0] - slack[:, 0]) | (self.inputs > limits[:, 1] + slack[:, 1])
        return np.asarray(outside.mean(axis=0))

    @property
    def differences(self) -> np.ndarray | None:
        """Largest |nonlinear - linear| of each state, (7,); None without a prediction."""
        if self.predicted is None:
            return None
        count = min(len(self.flight.times), len(self.predicted.times))
        return np.asarray(np.abs(self.flight.states[:count] - self.predicted.states[:count]).max(axis=0))


def fly(
    aircraft: Aircraft,
    point: OperatingPoint,
    plan: GainPlan,
    scenario: Scenario,
    envelope: Envelope,
    *,
    progress: Callable[[int, int], None] | None = None,
) -> NonlinearFlight:
    """X' = f(X, U, w) + d with U = U0 - K(t) (x + n - x_d), and its linear prediction x' = A x + B u + b w + d.

    The prediction is of the aircraft as designed: without the parameter errors. Both end at the first tick in
    which the nonlinear flight leaves the envelope.
    """
    policy = GainPolicy(zero(len(INPUTS)))
    flown = NonlinearPlant(with_errors(aircraft, scenario), point)
    result = fly_policy(flown, policy, plan.constants, scenario, envelope, progress=progress)
    ticks = (len(result.flight.times) - 1) // scenario.steps_per_tick
    model = LinearizedAircraft.at(aircraft, point)
    predicted = _loop(model, policy, scenario, point).fly(
        scenario.initial, plan.constants, step=scenario.step, steps_per_tick=scenario.steps_per_tick, ticks=ticks
    )
    return replace(result, predicted=predicted)


def fly_policy(
    plant: NonlinearPlant,
    policy: Policy,
    constants: Callable[[int], np.ndarray],
    scenario: Scenario,
    envelope: Envelope,
    *,
    progress: Callable[[int, int], None] | None = None,
) -> NonlinearFlight:
    """The nonlinear aircraft under any policy, without a prediction. constants: tick -> p of the policy.

    BadInputError when it does not begin inside the envelope.
    """
    offsets = np.array(plant.point.states)
    envelope.refuse_start(scenario.initial + offsets)
    flight = _loop(plant, policy, scenario, plant.point).fly(
        scenario.initial,
        constants,
        step=scenario.step,
        steps_per_tick=scenario.steps_per_tick,
        ticks=scenario.ticks,
        progress=progress,
        stop=lambda rows: not bool(envelope.inside(rows[:, : len(STATES)] + offsets).all()),
    )
    departure = envelope.departure(flight.times, flight.states + offsets)
    return NonlinearFlight(scenario, plant.point, envelope, flight, None, departure)


def loop_of(aircraft: Aircraft, point: OperatingPoint, scenario: Scenario) -> CompiledLoop:
    """The compiled nonlinear loop of `fly`, for those who integrate it otherwise."""
    return _loop(NonlinearPlant(with_errors(aircraft, scenario), point), GainPolicy(zero(len(INPUTS))), scenario, point)


def with_errors(aircraft: Aircraft, scenario: Scenario) -> Aircraft:
    """The aircraft that is flown: its parameters times the errors of the scenario."""
    wrong = {name: getattr(aircraft.parameters, name) * factor for name, factor in scenario.errors.items()}
    return Aircraft(aircraft.parameters._replace(**wrong), aircraft.variant)


def _loop(plant: Plant, policy: Policy, scenario: Scenario, point: OperatingPoint) -> CompiledLoop:
    if scenario.actuators is not None:
        policy = ActuatedPolicy(policy, scenario.actuators, np.array(point.inputs))
    return CompiledLoop(
        ClosedLoop(plant, policy, scenario.reference, scenario.disturbance, scenario.noise, scenario.gust)
    )
