"""One flight of Section 5: which aircraft, law and conditions; what came out."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from controller.flight.closed_loop import ClosedLoop
from controller.flight.plants import LinearPlant
from controller.flight.simulation import CompiledLoop, Flight
from controller.policy.policies import FlownLaw
from controller.policy.signals import Signal, zero
from hfa_model.vectors import LINEAR_STATES
from studies.section5.flown_laws import Critic, law_of
from studies.section5.metrics import FlightMetrics, flight_metrics, learning_metrics, residual_at
from studies.section5.setting import Setting


@dataclass(frozen=True)
class FlightPlan:
    """law controls the aircraft of a dihedral angle whose A is off by `uncertainty` * A.

    noise: whether the sensors have the noise of 5.4. commanded: False for the disturbance alone, from rest and without
    a command.
    """

    dihedral_deg: float
    law: str
    uncertainty: float = 0.0
    noise: bool = False
    commanded: bool = True

    @property
    def name(self) -> str:
        """For example "5 deg, certified, A + 0.3 A"."""
        parts = [f"{self.dihedral_deg:g} deg", self.law]
        if self.uncertainty:
            parts.append(f"A {'+' if self.uncertainty > 0 else '-'} {abs(self.uncertainty):g} A")
        parts += ["noise"] * self.noise + ["disturbance alone"] * (not self.commanded)
        return ", ".join(parts)


@dataclass(frozen=True, eq=False)
class FlightRecord:
    """What a flight was like. Arrays have one row a tick, up to the last one before the flight was lost.

    times (N,); states, commands x_d, errors z (N, 6); inputs (N, 5). residual: (N,), Bellman residual of the learned
    value at the simulated error; critic: None for laws that do not learn. lost_at: s, inf when it came to its end.
    limits: (2, 5), lowest and highest inputs that this project assumes.
    """

    plan: FlightPlan
    times: np.ndarray
    states: np.ndarray
    commands: np.ndarray
    errors: np.ndarray
    inputs: np.ndarray
    critic: Critic | None
    residual: np.ndarray
    learned_from: float
    lost_at: float
    metrics: FlightMetrics
    limits: np.ndarray

    @property
    def held(self) -> bool:
        """Whether the flight came to its end."""
        return bool(np.isinf(self.lost_at))


def simulate_plan(setting: Setting, plan: FlightPlan, section: str) -> FlightRecord:
    """Fly a plan under the conditions of a section of the paper."""
    configuration, case = setting.configuration, setting.case(plan.dihedral_deg)
    nothing = zero(len(LINEAR_STATES))
    reference = configuration.reference.signal if plan.commanded else nothing
    predefined_time = configuration.predefined_time(section)
    flown, learned = law_of(setting, case, plan.law, predefined_time, configuration.frozen(section), reference)
    loop = _loop(setting, plan, flown, reference)
    start = configuration.initial if plan.commanded else np.zeros(len(LINEAR_STATES))
    flight, lost_at = _flown(setting, loop, flown, start)
    each = configuration.flight.steps_per_tick
    times, errors = flight.times[::each], flight.errors[::each]
    # A flight that is lost in its first tick leaves its start behind.
    critic = learned(flight.memory[::each]) if learned is not None else None
    residual = residual_at(case.game, critic.basis, critic.weights, errors) if critic is not None else np.zeros(0)
    learning = None
    if critic is not None:
        learning = learning_metrics(times, critic, residual, predefined_time, lost_at)
    return FlightRecord(
        plan=plan,
        times=times,
        states=flight.states[::each],
        commands=reference.sampled(times),
        errors=errors,
        inputs=flight.inputs[::each],
        critic=critic,
        residual=residual,
        learned_from=flown.certified_from,
        lost_at=lost_at,
        metrics=flight_metrics(setting, case, flight, lost_at, learning),
        limits=case.input_limits,
    )


def _loop(setting: Setting, plan: FlightPlan, flown: FlownLaw, reference: Signal) -> CompiledLoop:
    game, nothing = setting.case(plan.dihedral_deg).game, zero(len(LINEAR_STATES))
    plant = LinearPlant((1.0 + plan.uncertainty) * game.A, game.B)
    noise = setting.configuration.noise.signal if plan.noise else nothing
    return CompiledLoop(ClosedLoop(plant, flown.policy, reference, setting.configuration.disturbance.signal, noise))


def _flown(setting: Setting, loop: CompiledLoop, flown: FlownLaw, start: np.ndarray) -> tuple[Flight, float]:
    """The flight up to the last step at which it is not lost, and when it is (inf: never)."""
    settings = setting.configuration.flight
    limit = settings.lost_beyond
    n = len(LINEAR_STATES)
    with np.errstate(invalid="ignore", over="ignore"):
        flight = loop.fly(
            start,
            flown.constants,
            step=settings.step,
            steps_per_tick=settings.steps_per_tick,
            ticks=settings.ticks,
            memory=flown.memory,
            stop=lambda rows, _: not (np.all(np.abs(rows[:, 1 : 1 + n]) <= limit) and np.all(np.isfinite(rows))),
        )
        sound = np.all(np.abs(np.hstack([flight.states, flight.inputs])) <= limit, axis=1)
        sound &= np.all(np.isfinite(flight.memory), axis=1)
    if np.all(sound):
        return flight, np.inf
    end = max(1, int(np.argmin(sound)))
    parts = {name: value[:end] for name, value in vars(flight).items()}
    return replace(flight, **parts), float(flight.times[int(np.argmin(sound))])
