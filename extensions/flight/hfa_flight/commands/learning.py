"""Section that signals add to `hfa learn`: a flight of the linear plant while the law learns."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from controller.critic.training_run import TrainingRun
from controller.game.zero_sum import Game
from controller.learning.integral_rl import baseline_gain
from controller.learning.laws import learn, learner_of
from controller.learning.published import PublishedLaw
from controller.learning.ticks import Run
from controller.reference import forcing
from hfa.options.output import ProgressLine
from hfa_aircraft.names import PlantNames
from hfa_aircraft.waveform import Waveform, zero
from hfa_flight.closed_loop import ClosedLoop, LinearPlant
from hfa_flight.history import Deviations
from hfa_flight.policies.critic_policy import CriticPolicy
from hfa_flight.policies.learned_gains import certified_gains
from hfa_flight.policies.policy import GainPolicy, Policy
from hfa_flight.scenario import Scenario
from hfa_flight.simulation import CompiledLoop
from hfa_support.errors import NoSolutionError
from hfa_support.reporting.report import Report, Reported
from hfa_support.reporting.results import Result, Vector
from hfa_support.reporting.text import Table, shown_unit, shown_value

#: Time between two gains of a law that hands over gains, s, and the integration step.
TICK = 0.01
STEP = 1e-4


@dataclass(frozen=True, eq=False)
class Signals:
    """Signals of a flight in which a law learns, for the n states of the linear plant.

    initial: x(0), (n,)
    reference: command x_d
    disturbance: added to the rates of the states
    noise: added to the measured error z = x - x_d
    """

    initial: np.ndarray
    reference: Waveform
    disturbance: Waveform
    noise: Waveform


@dataclass(frozen=True, eq=False, repr=False)
class LearningFlight(Result, Reported):
    """Flight of the linear plant x' = A x + B u + d while a law learns, with z = x - x_d.

    flown: time history
    reference: command x_d
    names: names of the states
    """

    flown: Deviations
    reference: Waveform
    names: PlantNames

    @property
    def duration(self) -> float:
        """Duration of the flight, s."""
        return float(self.flown.times[-1])

    @property
    def late_rms_errors(self) -> Vector:
        """Root mean square of each error in the second half, (n,)."""
        late = self.flown.times >= 0.5 * self.duration
        return np.asarray(np.sqrt(np.mean(self.flown.errors[late] ** 2, axis=0)))

    @property
    def largest_errors(self) -> Vector:
        """Largest magnitude of each error, (n,)."""
        return np.asarray(np.abs(self.flown.errors).max(axis=0))

    def contents(self) -> dict[str, Any]:
        """Return the entries of the file, name -> value."""
        return {
            "duration": self.duration,
            "late_rms_errors": self.late_rms_errors,
            "largest_errors": self.largest_errors,
        }

    def report(self) -> Report:
        """Return a report of the errors."""
        size = np.abs(self.reference.sampled(self.flown.times)).max(axis=0)
        rows = []
        numbers = zip(size, self.late_rms_errors, self.largest_errors, strict=True)
        units = self.names.state_units
        for state, unit, values in zip(self.names.states, units, numbers, strict=True):
            shown = (shown_value(float(value), unit, ".3g") for value in values)
            rows.append((state, shown_unit(unit), *shown))
        return Report(
            title=f"Flight of the linear model while the law learns, {self.duration:g} s",
            parts=(Table(("error of", "unit", "command", "rms, 2nd half", "largest"), rows),),
            data=self.as_data(),
        )


@dataclass(frozen=True, eq=False)
class LearnedInFlight(Result):
    """Entry that the signals of a flight add to a training run.

    flight: the flight
    """

    flight: LearningFlight


def learned_in_flight(
    game: Game, law: str, seed: int, settings: Mapping[str, Any], signals: Signals
) -> tuple[TrainingRun, LearningFlight]:
    """Return the training run of a law that learns in a flight of the linear plant, and the flight.

    The law of Eq. (46) learns from the current state and its recorded samples. Another law learns
    from its recorded samples alone: its last certified gain flies, and a baseline gain before.

    law, seed, settings: as for `learn`

    Raises NoSolutionError if the numbers of the flight overflow, and as `learn` does.
    """
    progress = ProgressLine("learn")
    learner = learner_of(game, law, seed, **settings)
    if isinstance(learner, PublishedLaw):
        return _learning_by_flight(learner, signals, progress)
    run = learn(game, law, seed, progress=progress, **settings)
    gains, _ = certified_gains(game, run, TICK, baseline_gain(game), 1.0 / STEP)
    policy = GainPolicy(run.law, gains)
    scenario = _scenario(signals, float(run.time[-1]), STEP)
    flown = _flown(game, policy, scenario)
    if len(flown.times) <= scenario.ticks * scenario.steps_per_tick:
        raise NoSolutionError(
            f"the flight under the law {run.law!r} diverges at t = {flown.times[-1]:.3g} s; choose "
            "another law, or a smaller reference"
        )
    return run, LearningFlight(flown, signals.reference, game.names)


def _learning_by_flight(
    law: PublishedLaw, signals: Signals, progress: ProgressLine
) -> tuple[TrainingRun, LearningFlight]:
    """Return the training run of the law of Eq. (46), whose weights are a memory of the flight."""
    game = law.game
    told = zero(len(game.A))
    if law.settings.drift == "with reference":
        told = forcing(game.A, signals.reference)
    start = law.start()["weights"]
    policy = CriticPolicy(law.name, law, told, held=np.ones((1, 1)), start=start)
    step = law.settings.step
    flown = _flown(game, policy, _scenario(signals, law.settings.predefined_time, step), progress)
    last = law.steps_done(law.ticks)
    if len(flown.times) <= last:
        raise NoSolutionError(law.overflow(len(flown.times)))
    rows = [
        law.observe(tick, {"weights": flown.memory[law.steps_done(tick)]})
        for tick in range(law.ticks + 1)
    ]
    history = {name: np.array([row[name] for row in rows]) for name in rows[0]}
    run = law.conclude(Run({"weights": flown.memory[last]}, history))
    return run, LearningFlight(flown, signals.reference, game.names)


def _scenario(signals: Signals, duration: float, step: float) -> Scenario:
    """Return the scenario of a flight of whole ticks that lasts at least the duration."""
    tick = step * max(1, round(TICK / step))
    ticks = int(np.ceil(duration / tick - 1e-9))
    return Scenario(
        ticks * tick,
        step,
        tick,
        signals.initial,
        signals.reference,
        signals.disturbance,
        signals.noise,
    )


def _flown(
    game: Game, policy: Policy, scenario: Scenario, progress: ProgressLine | None = None
) -> Deviations:
    """Return the flight until a number is not finite."""

    def is_lost(rows: Deviations) -> np.ndarray:
        numbers = np.hstack([rows.states, rows.inputs, rows.memory])
        return np.asarray(~np.isfinite(numbers).all(axis=1))

    loop = CompiledLoop(ClosedLoop(LinearPlant(game.A, game.B), policy, scenario))
    with np.errstate(invalid="ignore", over="ignore"):
        flown = loop.fly(stop=is_lost, progress=progress)
    lost = is_lost(flown)
    if not lost.any():
        return flown
    kept = max(1, int(np.argmax(lost)))
    parts = {name: value[:kept] for name, value in vars(flown).items() if name != "winds"}
    return replace(flown, **parts)
