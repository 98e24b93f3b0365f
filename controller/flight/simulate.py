"""One flight of the nonlinear aircraft under a linear policy, beside what the linear model predicts."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, field, replace
from typing import Any

import numpy as np

from controller.flight.actuators import LONGEST_STEP, Actuators
from controller.flight.closed_loop import ClosedLoop, CompiledLoop, Flight
from controller.flight.envelope import Departure, Envelope, angles_of_attack
from controller.flight.gusts import Gust
from controller.flight.plants import Equations, LinearizedAircraft, NonlinearPlant, Plant
from controller.flight.times import check_times
from controller.flight.uncertain import Uncertainty
from controller.policy.commands import CommandedStates
from controller.policy.flown_law import FlownLaw
from controller.policy.policies import Policy
from controller.policy.signals import Signal, TimeVector, zero
from hfa_model.aircraft import Aircraft
from hfa_model.parameters import Parameters
from hfa_model.reporting.report import Report, Reported
from hfa_model.support.errors import BadInputError
from hfa_model.vectors import LINEAR_STATES, STATES
from trim.point.condition import CONTROL_LIMITS
from trim.point.operating_point import OperatingPoint

_N = len(LINEAR_STATES)


@dataclass(frozen=True, eq=False)
class Scenario:
    """Everything that happens in a flight. All is off unless given.

    duration, step, tick: s; gains, noise samples and turbulence change once a tick, which holds a whole number of
    steps. initial: (7,), deviation from trim. reference, disturbance, noise: (6,) each. errors: parameter -> factor on
    the flown aircraft, which the design does not know. actuators, gust: stages of the loop. uncertainty: what is still
    to be drawn (`drawn`). samples: (ticks, 6), drawn noise, held in each tick. BadInputError when the times do not fit
    each other or the actuators, are too long, an error names no parameter, or there are two gusts.
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
    uncertainty: Uncertainty = field(default_factory=Uncertainty)
    samples: np.ndarray | None = None

    def __post_init__(self) -> None:
        """Refuse times that do not fit and errors of nothing."""
        check_times(self.duration, self.step, self.tick)
        if self.actuators is not None:
            self.actuators.refuse_step(self.step)
        for name, factor in self.errors.items():
            if name not in Parameters._fields:
                raise BadInputError(f"unknown parameter {name!r}; choose from {', '.join(Parameters._fields)}")
            if not (np.isfinite(factor) and factor > 0.0):
                raise BadInputError(f"the error of {name} is a factor of {factor}; it must be a positive number")
        if self.gust is not None and self.uncertainty.turbulence is not None:
            raise BadInputError("the scenario has a gust and turbulence to be drawn; give one of them")

    @property
    def steps_per_tick(self) -> int:
        """Steps in a tick."""
        return round(self.tick / self.step)

    @property
    def moving_air(self) -> bool:
        """Whether the air moves: a gust, or turbulence that is still to be drawn."""
        return self.gust is not None or self.uncertainty.turbulence is not None

    @property
    def ticks(self) -> int:
        """Ticks in the flight."""
        return round(self.duration / self.tick)

    def drawn(self, seed: int, member: int, speed: float) -> Scenario:
        """One draw of what is uncertain, decided by seed and member alone. speed: at which gusts are met, ft/s."""
        uncertain = self.uncertainty
        factors = zip(uncertain.errors, uncertain.factors(seed, member).tolist(), strict=True)
        return replace(
            self,
            errors={**self.errors, **{name: self.errors.get(name, 1.0) * factor for name, factor in factors}},
            gust=uncertain.air(seed, member, speed, self.tick, self.ticks) or self.gust,
            uncertainty=Uncertainty(),
            samples=uncertain.samples(seed, member, self.ticks),
        )

    def to_dict(self) -> dict[str, Any]:
        """What is known before anything is drawn, for JSON; a signal without a formula is named by its kind."""
        signals = {name: getattr(self, name) for name in ("reference", "disturbance", "noise")}
        formulas = {
            name: each.to_dict() if isinstance(each, (Signal, CommandedStates)) else type(each).__name__
            for name, each in signals.items()
        }
        return {
            "duration": self.duration,
            "step": self.step,
            "tick": self.tick,
            "initial": self.initial,
            "errors": dict(self.errors),
            **formulas,
            "actuators": None if self.actuators is None else asdict(self.actuators),
            "gust": _gust_data(self.gust),
        }


def _gust_data(gust: Any) -> dict[str, Any] | None:
    return None if gust is None else {"kind": type(gust).__name__, **asdict(gust)}


@dataclass(frozen=True, eq=False, repr=False)
class NonlinearFlight(Reported):
    """A flight, up to the first tick that left the envelope.

    loop: what was flown. flight: of the nonlinear aircraft, deviations from `point`. predicted: the same of its linear
    model, None when none was asked for. departure: which state left the envelope first, None when it held.
    """

    scenario: Scenario
    point: OperatingPoint
    envelope: Envelope
    loop: ClosedLoop
    flight: Flight
    predicted: Flight | None
    departure: Departure | None

    def report(self) -> Report:
        """See `flight_report`."""
        from controller.flight.flight_report import flight_report

        return flight_report(self)

    @property
    def states(self) -> np.ndarray:
        """X, absolute, (N, 7)."""
        return self.flight.states + np.array(self.point.states)

    @property
    def angles_of_attack(self) -> np.ndarray:
        """Alpha of the center of mass through the air, absolute, (N,), rad; alpha itself in still air."""
        return angles_of_attack(self.states, self.flight.updrafts if self.scenario.moving_air else None)

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
    law: FlownLaw,
    scenario: Scenario,
    envelope: Envelope,
    *,
    progress: Callable[[int, int], None] | None = None,
) -> NonlinearFlight:
    """X' = f(X, U, w) + d with U = U0 + u of the law, and its linear prediction x' = A x + B u + b w + d.

    The prediction is of the aircraft as designed: without the parameter errors. Both end at the first tick in
    which the nonlinear flight leaves the envelope.
    """
    result = fly_law(NonlinearPlant(with_errors(aircraft, scenario), point), law, scenario, envelope, progress=progress)
    ticks = (len(result.flight.times) - 1) // scenario.steps_per_tick
    model = LinearizedAircraft.at(aircraft, point)
    predicted = CompiledLoop(loop_of(model, law.policy, scenario, point)).fly(
        scenario.initial,
        law.constants,
        step=scenario.step,
        steps_per_tick=scenario.steps_per_tick,
        ticks=ticks,
        memory=law.memory,
        stiff=_stiff(law, scenario),
    )
    return replace(result, predicted=predicted)


def fly_law(
    plant: NonlinearPlant,
    law: FlownLaw,
    scenario: Scenario,
    envelope: Envelope,
    *,
    progress: Callable[[int, int], None] | None = None,
) -> NonlinearFlight:
    """The nonlinear aircraft under a law, without a prediction.

    BadInputError when it does not begin inside the envelope, or part of the scenario is still to be drawn.
    """
    if scenario.uncertainty != Uncertainty():
        raise BadInputError("part of the scenario is still to be drawn; simulate scenario.drawn(seed, member, speed)")
    offsets = np.array(plant.point.states)
    loop = loop_of(plant, law.policy, scenario, plant.point)
    compiled = CompiledLoop(loop)
    start = loop.start(scenario.initial, law.memory)
    air = compiled.updrafts(np.zeros(1), start[None], loop.constants(law.constants)(0))
    envelope.refuse_start(scenario.initial + offsets, air)

    def left(times: np.ndarray, y: np.ndarray, p: np.ndarray) -> bool:
        return not bool(envelope.inside(loop.parts(y)[0] + offsets, compiled.updrafts(times, y, p)).all())

    flight = compiled.fly(
        scenario.initial,
        law.constants,
        step=scenario.step,
        steps_per_tick=scenario.steps_per_tick,
        ticks=scenario.ticks,
        memory=law.memory,
        stiff=_stiff(law, scenario),
        progress=progress,
        stop=left,
    )
    updrafts = flight.updrafts if scenario.moving_air else None
    departure = envelope.departure(flight.times, flight.states + offsets, updrafts)
    return NonlinearFlight(scenario, plant.point, envelope, loop, flight, None, departure)


def _stiff(law: FlownLaw, scenario: Scenario) -> bool:
    """Whether the law has modes that Runge-Kutta 4 cannot follow with the step of the scenario."""
    return law.fastest * scenario.step > LONGEST_STEP


def with_errors(aircraft: Aircraft, scenario: Scenario) -> Equations:
    """The aircraft that is flown: its parameters times the errors of the scenario."""
    wrong = {name: getattr(aircraft.parameters, name) * factor for name, factor in scenario.errors.items()}
    return Equations(aircraft.parameters._replace(**wrong), aircraft.variant)


def loop_of(plant: Plant, policy: Policy, scenario: Scenario, point: OperatingPoint) -> ClosedLoop:
    """The loop of a plant about a point, under a policy, with everything that happens in the scenario."""
    signals = scenario.reference, scenario.disturbance, scenario.noise
    trim = np.array(point.inputs)
    return ClosedLoop(plant, policy, *signals, scenario.gust, scenario.samples, scenario.actuators, trim, scenario.tick)
