"""Scenario of a flight and the random quantities of its members."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, replace
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.random import SeedSequence

from hfa_aircraft.model import Model
from hfa_aircraft.servos import positions_of_servos
from hfa_aircraft.waveform import Waveform
from hfa_flight.air.gust_equations import in_gusts, undeclared
from hfa_flight.air.gusts import Gust
from hfa_flight.air.sensors import (
    Sensor,
    drawn_errors,
    names_with_errors,
    sensors_of,
)
from hfa_flight.air.signals import TimeVector
from hfa_flight.air.turbulence import Turbulence
from hfa_support.errors import (
    BadInputError,
    is_finite,
    numbers_in,
    refuse_unknown,
    refuse_unless_positive,
    shown,
)
from hfa_support.public_arguments import Declared
from hfa_support.reporting.report import Reported
from trim.linear.delays import in_samples, step_count
from trim.point.operating_point import OperatingPoint

#: Keys of the independent random streams of a member, beside those of the sensors, 1 and 3.
_ERRORS = 0
_AIR = 2

#: Largest number of rows of a flight, limited by the memory of an ordinary computer.
MOST_STEPS = 10_000_000


@dataclass(frozen=True)
class Uncertainty:
    """Random quantities of the members of a simulation. By default there are none.

    errors: parameter -> relative standard deviation about the nominal value
    noise: what is measured, a linear state or an output -> `Sensor`, or the standard deviation of
        its noise. The noise is drawn every sample and constant during the sample; a bias has its
        size and a random sign
    turbulence: `Turbulence`, or None

    Errors, noise, biases and turbulence of member k = 0, 1, ... use independent streams from (seed,
    k), NumPy's `SeedSequence`. Adding one of them does not change the draws of the others.

    Raises BadInputError if a deviation is negative or `turbulence` has another type. `Scenario.on`
    checks the names.
    """

    errors: Mapping[str, float] = field(default_factory=dict)
    noise: Mapping[str, Any] = field(default_factory=dict)
    turbulence: Turbulence | None = None

    def __post_init__(self) -> None:
        """Raise BadInputError for an invalid standard deviation or another type of turbulence."""
        if not isinstance(self.turbulence, Turbulence | None):
            raise BadInputError(
                f"turbulence is {shown(self.turbulence)}; give hfa.Turbulence, such as "
                "hfa.Turbulence('light', 1000.0)"
            )
        object.__setattr__(self, "noise", sensors_of(self.noise))
        for name, value in self.errors.items():
            if not (is_finite(value) and value >= 0.0):
                raise BadInputError(
                    f"the standard deviation of {name} is {shown(value)}; give a number of at "
                    "least 0"
                )

    def factors(self, seed: int, member: int) -> np.ndarray:
        """Return drawn ratios of parameters to nominal values, (E,), in the order of `errors`.

          exp(σ ξ - σ²/2),  ξ ~ N(0, 1),  σ² = ln(1 + s²)

        The ratios are positive, with the mean 1 and the standard deviation s.
        """
        sigma = np.sqrt(np.log1p(np.array(list(self.errors.values()), dtype=float) ** 2))
        random = np.random.default_rng(SeedSequence(seed, spawn_key=(member, _ERRORS)))
        return np.asarray(np.exp(sigma * random.standard_normal(len(sigma)) - sigma**2 / 2))

    def samples(
        self, seed: int, member: int, count: int, model: Model, interval: float
    ) -> np.ndarray:
        """Return drawn errors of `names_with_errors`, (count, k), nan in samples without a value.

        interval: duration of a sample, s
        """
        drawn = drawn_errors(self.noise, model, seed, member)(count)
        for column, name in enumerate(names_with_errors(model, self.noise)):
            sensor = self.noise.get(name, Sensor(0.0))
            whole, rest = in_samples(sensor.every, interval)
            if rest:
                raise BadInputError(
                    f"the sensor of {name} has a value every {sensor.every:g} s; give a multiple "
                    f"of the sample time, {interval:g} s"
                )
            drawn[np.arange(count) % max(whole, 1) > 0, column] = np.nan
        return drawn


@dataclass(frozen=True, eq=False, repr=False)
class Scenario(Declared, Reported):
    """Initial condition, reference, disturbances, noise, gusts and timing of a flight.

    By default, nothing disturbs the flight.

    duration: s
    step: interval of the rows of the flight, s
    tick: interval at which the held inputs change, s, a whole number of steps
    initial: (n,), deviation from trim, or () for none
    reference, disturbance: signals (k,) for the states of the linear model, or None for 0
    errors: parameter -> factor on the parameter of the simulated aircraft only
    gust: motion of the air, or None
    uncertainty: random quantities, not yet drawn
    samples: errors of the linear states and then of the measured outputs, (N, k), constant during
        each sample, or None
    sensors: those whose errors are drawn, what they measure -> `Sensor`
    seed: seed of the drawn random quantities, or None if none are drawn
    air: disturbance of the model -> waveform, (1,)
    delay: delay of every command, s, a whole number of ticks
    sample: interval of the noise, of turbulence and of a filter or function that acts as the
        policy, s, a whole number of ticks. Default: a tick

    Raises BadInputError if times are not multiples of each other or are too long, a factor is not
    positive, the delay or the sample is not a whole number of ticks, or there are both a gust and
    turbulence.

    >>> from hfa_flight import OneMinusCosine, Scenario
    >>> gust = OneMinusCosine(length=400.0, peak=5.0, speed=68.0)
    >>> Scenario(duration=12.0, gust=gust).ticks
    1200
    """

    duration: float = 20.0
    step: float = 0.001
    tick: float = 0.01
    initial: np.ndarray = field(default_factory=lambda: np.zeros(0))
    reference: TimeVector | None = None
    disturbance: TimeVector | None = None
    errors: Mapping[str, float] = field(default_factory=dict)
    gust: Gust | None = None
    uncertainty: Uncertainty = field(default_factory=Uncertainty)
    samples: np.ndarray | None = None
    sensors: Mapping[str, Sensor] = field(default_factory=dict)
    seed: int | None = None
    air: Mapping[str, Waveform] = field(default_factory=dict)
    delay: float = 0.0
    sample: float | None = None

    def __post_init__(self) -> None:
        """Raise BadInputError if times do not fit each other, or for an invalid factor or delay."""
        self._refuse_wrong_times()
        for name, factor in self.errors.items():
            refuse_unless_positive(f"the factor on {name}", factor)
        if not isinstance(self.gust, Gust | None):
            example = "hfa_flight.OneMinusCosine(length=400.0, peak=5.0, speed=68.0)"
            raise BadInputError(f"gust is {shown(self.gust)}; give a gust such as {example}")
        if self.samples is not None:
            shape = numbers_in("samples", self.samples).shape
            if len(shape) != 2 or shape[0] < self.sample_count:
                raise BadInputError(
                    f"samples has shape {shape}; give noise (N, k) for {self.sample_count} samples"
                )
        if self.gust is not None and self.uncertainty.turbulence is not None:
            raise BadInputError(
                "the scenario has both a gust and random turbulence; remove one of the two"
            )

    def _refuse_wrong_times(self) -> None:
        """Raise BadInputError if times do not fit each other, or are too long or not positive."""
        times = {"duration": self.duration, "tick": self.tick, "step": self.step}
        for name, value in times.items():
            refuse_unless_positive(name, value, " s")
        # The duration is a whole number of ticks, and the tick of steps.
        for (name, time), (part, part_time) in pairwise(times.items()):
            count = time / part_time
            if round(count) < 1 or abs(count - round(count)) > 1e-6 * count:
                raise BadInputError(
                    f"{name} is {time:g} s, not a whole number of {part}s of {part_time:g} s;"
                    f" change {name} or {part}"
                )
        if self.duration > MOST_STEPS * self.step * (1 + 1e-9):
            most = f"give at most {MOST_STEPS * self.step:g} s with a step of {self.step:g} s"
            raise BadInputError(f"duration is {self.duration:g} s; {most}")
        if not 0.0 <= self.delay < math.inf:
            raise BadInputError(f"delay is {self.delay:g} s; give a finite time of at least 0 s")
        if not 0.0 < self.interval < math.inf:
            raise BadInputError(f"sample is {self.interval:g} s; give a finite time above 0 s")
        for name, time in (("delay", self.delay), ("sample", self.interval)):
            if in_samples(time, self.tick).rest:
                raise BadInputError(
                    f"{name} is {time:g} s; give a multiple of the tick, {self.tick:g} s"
                )

    @property
    def interval(self) -> float:
        """Duration of a sample, s."""
        return self.tick if self.sample is None else self.sample

    @property
    def ticks(self) -> int:
        """Number of ticks of the flight."""
        return round(self.duration / self.tick)

    @property
    def steps_per_tick(self) -> int:
        """Number of rows in a tick."""
        return round(self.tick / self.step)

    @property
    def ticks_per_sample(self) -> int:
        """Number of ticks in a sample."""
        return round(self.interval / self.tick)

    @property
    def sample_count(self) -> int:
        """Number of samples of the flight."""
        return step_count(self.duration, self.interval)

    @property
    def delayed_ticks(self) -> int:
        """Number of ticks by which every command is delayed."""
        return in_samples(self.delay, self.tick).whole

    @property
    def moving_air(self) -> bool:
        """True if there is a gust, turbulence or another disturbance of the model.

        Turbulence that is not yet drawn counts too.
        """
        return self.gust is not None or self.uncertainty.turbulence is not None or bool(self.air)

    @property
    def is_random(self) -> bool:
        """True if noise or turbulence is drawn."""
        return self.samples is not None or (self.gust is not None and self.gust.rises)

    @property
    def is_calm(self) -> bool:
        """True if nothing disturbs the flight but the policy."""
        given = (self.reference, self.disturbance, self.gust, self.samples)
        return (
            all(value is None for value in given)
            and not np.any(self.initial)
            and not (self.air or self.errors)
            and self.uncertainty == Uncertainty()
        )

    @property
    def driven_until(self) -> float:
        """Time at which the last signal, gust or noise ends, s, or inf if one never ends."""
        if self.samples is not None:  # sensor noise lasts to the end of the flight
            return math.inf
        sources = (self.reference, self.disturbance, self.gust, *self.air.values())
        # A source without `until`, such as turbulence, never ends.
        ends = [getattr(source, "until", math.inf) for source in sources if source is not None]
        return max(ends, default=0.0)

    def text(self, model: Model) -> str:
        """Return the latency, the sensors and the biases of flights with noise or turbulence."""
        return conditions_text(model, self.delay, self.sensors or self.uncertainty.noise)

    def on(self, model: Model) -> Scenario:
        """Return this scenario with a missing initial condition of 0, checked for a model.

        Raises BadInputError if the scenario names an unknown parameter, state or disturbance, if
        its gust needs a disturbance that the model neither declares nor receives from `in_gusts`,
        or if `initial` does not have one number for each state.
        """
        for name in (*self.errors, *self.uncertainty.errors):
            refuse_unknown("unknown parameter", name, tuple(model.parameters))
        sensors_of(self.uncertainty.noise, model)
        for name in self.air:
            refuse_unknown("unknown disturbance", name, tuple(model.disturbances))
        gusts = () if self.gust is None else self.gust.names
        for name in gusts:
            if name not in in_gusts(model).disturbances:
                raise BadInputError(undeclared(model, name, "a gust"))
        n = len(model.states)
        initial = self.initial if np.size(self.initial) else np.zeros(n)
        if np.shape(initial) != (n,):
            raise BadInputError(
                f"initial has shape {np.shape(initial)}; give {n} numbers, one for each state of"
                f" {model.name}"
            )
        return replace(self, initial=initial)

    def following(self, reference: TimeVector, policy: str) -> Scenario:
        """Return the scenario with the reference of a policy.

        policy: name of the policy

        Raises BadInputError if the scenario has another reference.
        """
        if self.reference not in (None, reference):
            raise BadInputError(
                f"the policy {policy} follows a reference of its own; remove the reference of the "
                "scenario"
            )
        return replace(self, reference=reference)

    def with_tick(self, tick: float, longest_step: float, sample: float | None = None) -> Scenario:
        """Return the scenario with another tick, s, and its duration rounded to whole ticks, at
        least one.

        longest_step: upper bound of the new step, s
        sample: duration of a sample, s, or None for samples of one tick
        """
        count = max(1, round(self.duration / tick))
        step = tick / step_count(tick, longest_step)
        return replace(self, duration=count * tick, tick=tick, step=step, sample=sample)

    def drawn(self, seed: int, member: int, point: OperatingPoint) -> Scenario:
        """Return the scenario of a member, with its random quantities drawn.

        point: trim at whose speed gusts are computed
        """
        uncertain = self.uncertainty
        errors = dict(self.errors)
        if uncertain.errors:
            factors = uncertain.factors(seed, member).tolist()
            for name, factor in zip(uncertain.errors, factors, strict=True):
                errors[name] = errors.get(name, 1.0) * factor
        samples = None
        if any(sensor != Sensor(0.0) for sensor in uncertain.noise.values()):
            count = self.sample_count
            samples = uncertain.samples(seed, member, count, point.model, self.interval)
        gust = self.gust
        if uncertain.turbulence is not None:
            air = SeedSequence(seed, spawn_key=(member, _AIR)).generate_state(1, np.uint64)
            gust = uncertain.turbulence.air(point, self.interval, self.sample_count, int(air[0]))
        drawn = replace(
            self,
            errors=errors,
            gust=gust,
            uncertainty=Uncertainty(),
            samples=samples,
            sensors=uncertain.noise,
        )
        return replace(drawn, seed=seed) if drawn.is_random else drawn

    def to_dict(self) -> dict[str, Any]:
        """Return the scenario for JSON, without the uncertainty; of drawn noise its deviations.

        A signal without a formula is represented by the name of its class.
        """
        plain = ("duration", "step", "tick", "initial", "errors")
        data = {name: getattr(self, name) for name in plain}
        for name in ("reference", "disturbance"):
            if (signal := getattr(self, name)) is not None:
                has_formula = hasattr(signal, "to_dict")
                data[name] = signal.to_dict() if has_formula else type(signal).__name__
        gust: Any = self.gust
        if self.samples is not None:
            data["drawn_noise"] = self.samples.std(axis=0)
        data["gust"] = None if gust is None else {"kind": type(gust).__name__, **asdict(gust)}
        if self.air:
            data["air"] = {name: waveform.to_dict() for name, waveform in self.air.items()}
        if self.delay:
            data["delay"] = self.delay
        if self.ticks_per_sample > 1:
            data["sample"] = self.interval
        return data


def conditions_text(model: Model, delay: float, sensors: Mapping[str, Sensor]) -> str:
    """Return the latency, the sensors and the biases of flights of a model.

    delay: delay of the commands, s
    """
    words = [f"commands {1e3 * delay:.4g} ms late"] if delay else []
    if servos := positions_of_servos(model):
        lags = {1e3 * model.parameters[f"{name}_lag"].start for name in servos}
        words.append(f"servos of {' and '.join(f'{lag:.4g}' for lag in sorted(lags))} ms")
    missing = [] if words else ["latency"]
    words += [f"{name} measured" for name in sensors if name not in model.states]
    biased = sum(sensor.bias > 0.0 for sensor in sensors.values())
    words += [f"{biased} {'bias' if biased == 1 else 'biases'}"] if biased else []
    missing += [] if biased else ["bias"]
    return ", ".join([*words, *([f"without {' and '.join(missing)}"] if missing else [])])


def with_errors(model: Model, scenario: Scenario) -> Model:
    """Return the model with its nominal parameters times the factors in `scenario.errors`."""
    parameters = {
        name: model.parameters[name].start * factor for name, factor in scenario.errors.items()
    }
    return model.with_parameters(**parameters) if parameters else model
