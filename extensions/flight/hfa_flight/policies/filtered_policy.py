"""Policies of the estimate of a Kalman filter."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from typing import Any, NamedTuple, Self

import casadi as ca
import numpy as np

from hfa_aircraft.batch_simulation import saturated
from hfa_aircraft.model import Model
from hfa_flight.air.scenario import Scenario
from hfa_flight.policies.deployment.policy import DeployedPolicy
from hfa_flight.policies.estimate import (
    Estimate,
    estimate_in,
    extended_step,
    known_start,
    memory_size,
    propagated,
    updated,
)
from hfa_flight.policies.filter_margins import (
    FilterLoop,
    FilterMargins,
    margins_of,
)
from hfa_flight.policies.kalman import KalmanFilter
from hfa_flight.policies.policy import (
    GainPolicy,
    Measurements,
    NextSample,
    OpenLoop,
    Policy,
    SampledPolicy,
    deviations_of,
    input_limits,
)
from hfa_support.errors import (
    BadInputError,
    is_finite,
    numbers_in,
    refuse_unknown,
    shown,
)
from hfa_support.native.bound import BoundFunction
from hfa_support.reporting.results import storable
from trim.linear.delays import acting_commands, in_samples
from trim.point.operating_point import OperatingPoint

#: Default time in which commands are faded in, s, and that of a fast gain: one with which the
#: filter alone, without the aircraft, is unstable. With a shorter time, such a gain leaves its
#: limits while the estimate still errs.
_FADE = 1.0
_FADE_OF_FAST_GAIN = 3.0
#: Function (number of the sample, deviations of all states, what is known of the next sample by a
#: law that plans) -> deviations of the inputs.
_Law = Callable[[int, np.ndarray, NextSample | None], np.ndarray]


@dataclass
class _Memory:
    """Memory of one flight.

    estimate: predicted states of the filter at the next sample, their covariance and counts
    waiting: commands that may act yet, the oldest first, (count, m)
    samples, unused: numbers of samples, and of samples of which a value was not used
    law: the policy behind the filter, or None before the first sample
    """

    estimate: np.ndarray
    waiting: np.ndarray
    samples: int = 0
    unused: int = 0
    law: _Law | None = None


class _Functions(NamedTuple):
    """Functions of the samples of a filter, with the memory of `Estimate` and the earlier commands
    that may act yet, the oldest first, one after the other.

    before: (memory, commands, y) -> (memory with the values, linear states that the law sees,
        whether a value is left out)
    after: (memory with the values, commands, command of the law) -> (command that acts, memory of
        the next sample)
    following: (memory with the values, commands) -> `NextSample`, of the linear states
    sensed: states of the filter -> measured values
    """

    before: BoundFunction
    after: BoundFunction
    following: BoundFunction
    sensed: BoundFunction


def _bound(name: str, arguments: list[ca.SX], results: list[ca.SX]) -> BoundFunction:
    """Return the function (symbols `arguments`) -> values of `results`, called with arrays."""
    dense = [ca.densify(result) for result in results]
    return BoundFunction(ca.Function(name, arguments, dense, {"cse": True}))


@dataclass(frozen=True, eq=False, repr=False)
class FilteredPolicy(SampledPolicy):
    """Policy U = sat(law(x̂)) of the estimate x̂ of a Kalman filter.

    The filter is extended: the nonlinear model predicts, with slopes at the estimate. A measured
    value that is not finite, that equals the last one to the bit (it is frozen), or with an
    innovation beyond 8 standard deviations is left out, and the covariance is predicted without
    it. Without any value the gains do not grow, because a fast policy leaves its limits if the
    estimate jumps by a large error.

    After `reset`, the filter is switched on in flight: the estimate begins at the measured values,
    with the air of stationary turbulence, and commands are faded in. The same happens if most
    values are impossible at the end of ten samples in a row with impossible values. After `begin`,
    and in flights of `hfa.fly`, the states at the first sample are known, and commands act at once.
    With a delay the law acts on the state predicted over the commands under way; a deployment with
    a delay of its own acts on the estimate of its sample.

    The law sees flow angles relative to the air, as a vane measures them, and the component of the
    speed over the ground along the path of the trim: without what an updraft adds. A law that plans
    is told how far the air along the path moves the states in a sample.

    filter: the filter
    law: the policy behind it
    fade: time in which commands are faded in where the estimate begins in flight, s
    ahead: time from a sample for which the state is predicted before the law, s
    """

    filter: KalmanFilter
    law: Policy
    fade: float
    ahead: float = field(default=0.0, kw_only=True)
    _memory: _Memory = field(init=False)

    @classmethod
    def behind(cls, kalman: KalmanFilter, law: Policy, fade: float | None = None) -> Self:
        """Return the policy of a filter's estimate. `fade` is that of `hfa.filter(...).policy`.

        Raises BadInputError for a policy without feedback, or with another sample time, and for a
        wrong fade.
        """
        if isinstance(law, FilteredPolicy):
            raise BadInputError(
                "the policy has a filter already; give the policy without its filter"
            )
        if isinstance(law, OpenLoop):
            raise BadInputError("a policy without feedback needs no filter; give a policy")
        law.refuse_other_sizes(kalman.point)
        is_default = fade is None
        fade = _FADE if fade is None else fade
        if not (is_finite(fade) and fade >= 0.0):
            raise BadInputError(f"fade is {shown(fade)}; give a time of at least 0 s")
        own = own_sample_time(law, kalman.dt)
        if not math.isclose(own, kalman.dt, rel_tol=1e-6):
            raise BadInputError(
                f"the filter has samples of {kalman.dt:g} s, the policy {law.name} of {own:g} s; "
                f"give the filter dt={own:g}"
            )
        if isinstance(law, SampledPolicy):
            law = replace(law, tick=kalman.dt)  # the filter calls it once a sample
        name = f"{law.name} behind a filter"
        policy = cls(name, kalman.point, kalman.dt, filter=kalman, law=law, fade=fade)
        K = policy.gain
        is_fast = K is not None and FilterLoop.of(kalman, K, 0.0).compensator_radius >= 1.0
        if is_default and is_fast:
            return replace(policy, fade=_FADE_OF_FAST_GAIN)
        return policy

    def __post_init__(self) -> None:
        """Begin at the trim."""
        super().__post_init__()
        self.reset()

    def reset(self) -> None:
        """Forget the samples before: the next one is the first of a filter begun in flight."""
        object.__setattr__(self, "_memory", self._memory_at_trim())

    def begin(self, X: Any, following: NextSample | None = None) -> None:
        """Begin a flight, and make the first plan of a law that plans before its first sample.

        X: all states that are expected at the first sample, absolute, (n,)
        following: not used, because this filter knows the next sample itself
        """
        self.reset()
        memory = self._memory
        memory.estimate = known_start(self.filter, deviations_of(self.point, X))
        memory.law = self._prepared_law()
        if isinstance(self.law, SampledPolicy):
            (expected,) = self._functions.sensed.at(memory.estimate[: len(self.filter.Phi)])
            _, x, known, _ = self._estimated(memory, expected)
            self.law.begin(self.point.x + x, known)

    def _prepared_law(self) -> _Law:
        """Return the law of a flight. All functions of a sample are made before the flight."""
        _ = self._functions
        return _law_of(self.law, self.point, self.dt)

    @property
    def under_way(self) -> int:
        """Number of earlier commands that may act at a sample or later."""
        return in_samples(self.delay, self.dt).whole + 1

    def _memory_at_trim(self) -> _Memory:
        """Return the memory before a flight: the estimate and the commands under way are trim."""
        waiting = np.zeros((self.under_way, len(self.point.u)))
        return _Memory(np.zeros(memory_size(self.filter)), waiting)

    def __call__(self, t: float, y: Any) -> np.ndarray:
        """Return the inputs U (m,) from the measured values of one sample, absolute.

        Samples follow each other every dt; t only tells them apart.

        t: time of the sample, s
        y: measured values, (p,) in the order of `filter.sensors`, or by name. A value that is not
          finite or equals the last one is missing, as is one without its name
        """
        sensors = tuple(self.filter.sensors)
        if isinstance(y, Mapping):
            for name in y:
                refuse_unknown("the unknown sensor", name, sensors)
            y = [y.get(name, math.nan) for name in sensors]
        measured = numbers_in("the measured values", y)
        if measured.shape != (len(sensors),):
            raise BadInputError(
                f"the policy received {measured.size} measured values; give {len(sensors)} "
                f"({', '.join(sensors)})"
            )
        deviations = measured - self.filter.at_trim
        return np.asarray(self.point.u + self._command(self._memory, deviations))

    @property
    def estimate(self) -> dict[str, float]:
        """Linear state -> predicted value at the next sample, absolute."""
        return {
            name: float(getattr(self.point.states, name) + value)
            # the states of the air follow in the memory
            for name, value in zip(self.filter.states, self._memory.estimate, strict=False)
        }

    @property
    def gain(self) -> np.ndarray | None:
        """Gain K (m, k) of the estimate, 0 for positions of servos that the law does not see."""
        K = self.law.gain
        return None if K is None else np.pad(K, [(0, 0), (0, len(self.filter.states) - K.shape[1])])

    @property
    def biases(self) -> dict[str, float]:
        """Sensor -> predicted bias at the next sample, of the sensors that have one."""
        count, biased = len(self.filter.Phi), self.filter.biased
        values = self._memory.estimate[count - len(biased) : count].tolist()
        return dict(zip(biased, values, strict=True))

    @property
    def unused(self) -> int:
        """Number of samples of the last flight of which a value was not used."""
        return self._memory.unused

    def sampler(self, initial: np.ndarray | None = None) -> Callable[[int, np.ndarray], np.ndarray]:
        """Return the function (tick, measured) -> inputs as deviations from trim, (m,)."""
        self._begin_flight(initial)
        memory = self._memory
        if memory.law is None:  # `begin` was not called
            memory.estimate = known_start(self.filter)
            memory.law = self._prepared_law()
        return self._held_between_samples(lambda _, measured: self._command(memory, measured))

    @property
    def sensors(self) -> tuple[str, ...]:
        """What the policy measures in a flight."""
        return tuple(self.filter.sensors)

    def _command(self, memory: _Memory, y: np.ndarray) -> np.ndarray:
        """Return the command of a sample, as deviations from trim, (m,), and advance the memory.

        y: measured deviations from trim, (p,)
        """
        if memory.law is None:
            memory.law = self._prepared_law()
        with_values, x, following, is_left_out = self._estimated(memory, y)
        command = memory.law(memory.samples, x, following)
        u, memory.estimate = self._functions.after.at(with_values, memory.waiting.ravel(), command)
        memory.waiting = np.vstack([memory.waiting[1:], u])
        memory.samples += 1
        memory.unused += is_left_out
        return u

    def _estimated(
        self, memory: _Memory, y: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, NextSample | None, bool]:
        """Return the memory of the filter with measured deviations y, (p,), the deviations of all
        states that the law sees when its command acts, (n,), what is known of the next sample, of a
        law that plans, and whether a value is left out.
        """
        under_way = memory.waiting.ravel()
        with_values, seen, left_out = self._functions.before.at(memory.estimate, under_way, y)
        following = None
        if isinstance(self.law, SampledPolicy) and self.law.plans:
            known = self._functions.following.at(with_values, under_way)
            following = NextSample(*map(self._of_all_states, known))
        return with_values, self._of_all_states(seen), following, bool(left_out[0])

    def _of_all_states(self, linear: np.ndarray) -> np.ndarray:
        """Return values of the linear states, (k,), among zeros of the other states."""
        values = np.zeros(len(self.point.x))
        values[self.point.model.state_places(self.filter.states)] = linear
        return values

    @cached_property
    def _functions(self) -> _Functions:
        """Functions of the filter, made at the first sample."""
        kalman, m = self.filter, len(self.point.u)
        memory, y = ca.SX.sym("memory", memory_size(kalman)), ca.SX.sym("y", len(kalman.sensors))
        waiting, u = ca.SX.sym("waiting", self.under_way * m), ca.SX.sym("u", m)
        under_way = ca.vertsplit(waiting, m)
        now = estimate_in(kalman, memory)
        with_values, seen, is_left_out = before_command(self, now, under_way, y)
        results = [with_values.packed(), seen, is_left_out]
        return _Functions(
            before=_bound("before", [memory, waiting, y], results),
            after=_bound("after", [memory, waiting, u], [*after_command(self, now, under_way, u)]),
            following=_bound("following", [memory, waiting], [*_following(self, now, under_way)]),
            sensed=_bound("sensed", [now.x], [kalman.sensed(now.x)]),
        )

    def in_scenario(self, scenario: Scenario) -> tuple[Self, Scenario]:
        """Return the policy and the scenario with ticks that divide samples and delays.

        The delay of a deployment is added to that of the scenario.
        """
        if isinstance(self.law, DeployedPolicy):
            return self._deployed_in_scenario(self.law, scenario)
        # A default fade is not refused, even in a flight that is shorter.
        if self.fade > max(scenario.duration, _FADE_OF_FAST_GAIN):
            raise BadInputError(
                f"commands are faded in over {self.fade:g} s, longer than the flight of "
                f"{scenario.duration:g} s; give a shorter fade or a longer flight"
            )
        policy, with_tick = super().in_scenario(scenario)
        policy = replace(policy, ahead=scenario.delay)
        if isinstance(self.law, SampledPolicy):
            # The filter predicts over the delay and calls the law once a sample, so the law has no
            # delay and one tick a sample, and the ticks of the flight are those of the filter.
            law, _ = self.law.in_scenario(replace(with_tick, delay=0.0))
            policy = replace(policy, law=replace(law, tick=self.dt))
        return policy, with_tick

    def _deployed_in_scenario(
        self, law: DeployedPolicy, scenario: Scenario
    ) -> tuple[Self, Scenario]:
        """Return the policy and the scenario, which has the delay of the deployment."""
        if self.tick:  # the policy is already in a scenario, which has the delay
            return self, scenario
        with_tick = scenario.with_tick(law.tick, scenario.step, self.dt)
        delay = scenario.delay + law.deployed.deployment.delay
        policy, late = super().in_scenario(replace(with_tick, delay=delay))
        return replace(policy, ahead=scenario.delay), late

    def loop(self) -> FilterLoop | None:
        """Return the linear loop, or None for a law without a gain, and where a sensor has no value
        in some samples.
        """
        K, unknown = None if self.filter.intermittent else self.gain, self.delay - self.ahead
        return None if K is None else FilterLoop.of(self.filter, K, self.ahead, unknown)

    def sampled_modes(self) -> np.ndarray | None:
        """Return the eigenvalues of the loop near the trim, 1/s, or None without a linear law."""
        loop = self.loop()
        return None if loop is None else loop.modes

    @cached_property
    def margins(self) -> FilterMargins | None:
        """Margins of the linear loop, or None without one, and for a law that acts before the delay
        of the loop.
        """
        K = self.gain
        if K is None or self.delay != self.ahead or self.filter.intermittent:
            return None
        return margins_of(partial(FilterLoop.of, self.filter, K, self.ahead))

    def tolerates(self) -> str:
        """Return the further delay that the linear loop tolerates, for a first line, or ""."""
        further = None if self.margins is None else self.margins.unknown_delay
        return "" if further is None else f"; {1e3 * further:.3g} ms more in the linear loop"

    def texts(self) -> list[str]:
        """Return sentences on the filter and on its loop."""
        margins = self.margins
        fading = f"Switched on in flight, commands are faded in over {self.fade:g} s (fade)."
        known = [text for text in (self.filter.text(), self.filter.text_of_biases()) if text]
        if margins is not None:
            known.append(margins.text())
        elif names := self.filter.intermittent:
            known.append(f"No margins: {', '.join(names)} has no value in some samples.")
        return [*known, fading]

    def data(self, model: Model) -> dict[str, Any]:
        """Return the JSON data on the policy: those of its law, and the filter."""
        of_filter = {"filter": storable(self.filter), "margins": self.margins}
        named = {**self.law.data(model), "name": self.name}
        return {**named, **of_filter, "unused_samples": self.unused}

    def notes(self) -> tuple[str, ...]:
        """Return the filter, and the number of samples that were not used."""
        lines = self.texts()
        if self.unused:
            lines.append(
                f"Of {self.unused} of {self._memory.samples} samples a value was not used."
            )
        return (*lines, *self.law.notes())

    def __getstate__(self) -> dict[str, Any]:
        """Return the fields, without functions that are made at the next sample."""
        memory = replace(self._memory, law=None, waiting=self._memory.waiting.copy())
        fields = {**self.__dict__, "_memory": memory}
        fields.pop("_functions", None)
        return fields


def own_sample_time(policy: Policy, otherwise: float) -> float:
    """Return the sample time of a policy, s, or `otherwise` for one without samples."""
    if isinstance(policy, SampledPolicy) or (isinstance(policy, GainPolicy) and policy.dt):
        return policy.dt or otherwise
    return policy.deployed.deployment.dt if isinstance(policy, DeployedPolicy) else otherwise


def _law_of(policy: Policy, point: OperatingPoint, dt: float) -> _Law:
    """Return the law (sample, deviations x of all states, what is known of the next sample) ->
    deviations of the inputs, which evaluates a policy.
    """
    if isinstance(policy, DeployedPolicy):
        commanded = policy.commander()
        return lambda sample, x, following: commanded(x)
    # A policy that plans acts on the estimate and on what is known of the next sample.
    if isinstance(policy, SampledPolicy) and policy.plans:
        policy.reset()

        def planned(sample: int, x: np.ndarray, following: NextSample | None) -> np.ndarray:
            assert following is not None  # of a law that plans
            return policy.of_estimate(sample * dt, point.x + x, following) - point.u

        return planned
    sampler = policy.sampler()
    if sampler is not None:
        return lambda sample, x, following: sampler(sample, x)

    # Other policies are expressions of time, linear states and held inputs.
    rows = point.model.state_places(point.model.linear)
    t, z = ca.SX.sym("t"), ca.SX.sym("z", len(rows))
    held = ca.SX.sym("held", policy.held.shape[1])
    command = command_of(policy, t, z, held)
    function = BoundFunction(ca.Function("law", [t, z, held], [ca.densify(command)]))

    def law(sample: int, x: np.ndarray, following: NextSample | None) -> np.ndarray:
        (u,) = function.at(sample * dt, x[rows], policy.held_inputs(sample, sample * dt))
        return np.array(u)

    return law


def command_of(policy: Policy, t: ca.SX, z: ca.SX, held: Any) -> ca.SX:
    """Return the command (m,) of a policy at z (k,), without a reference: z is error and state."""
    return policy.control(t, Measurements(z, z), held)


def before_command(
    policy: FilteredPolicy, before: Estimate, under_way: list[ca.SX], y: ca.SX
) -> tuple[Estimate, ca.SX, ca.SX]:
    """Return the estimate with measured deviations y, (p,), the linear states that the law sees at
    the state predicted over `policy.ahead`, (k,), and 1 if a value is left out.

    under_way: earlier commands that may act yet, (m,) each, the oldest first
    """
    now, is_left_out = updated(policy.filter, before, y, policy.fade)
    none_yet = ca.SX.zeros(len(policy.point.u))  # the command of this sample, which acts later
    ahead, _ = _predicted(policy, now.x, [*under_way, none_yet], policy.ahead)
    return now, policy.filter.seen(ahead), is_left_out


def after_command(
    policy: FilteredPolicy, now: Estimate, under_way: list[ca.SX], command: ca.SX
) -> tuple[ca.SX, ca.SX]:
    """Return what acts of the command of the law, faded in and within the control limits, (m,), and
    the memory of the next sample, which this command and those under way predict.
    """
    u = saturated(now.share * command, *map(ca.DM, input_limits(policy.point)))
    x, Phi = _predicted(policy, now.x, [*under_way, u], policy.dt)
    return u, propagated(policy.filter, now, x, Phi).packed()


def _predicted(
    policy: FilteredPolicy, x: ca.SX, commands: list[ca.SX], seconds: float
) -> tuple[ca.SX, ca.SX]:
    """Return the states of the filter some seconds after a sample, and their slopes by those at it.

    commands: of the samples until this one, (m,) each, the latest last
    """
    Phi = ca.SX.eye(x.numel())
    for samples_ago, duration in acting_commands(policy.delay, policy.dt, seconds):
        x, slopes = extended_step(policy.filter, duration)(x, commands[-1 - samples_ago])
        Phi = ca.mtimes(slopes, Phi)
    return x, Phi


def _following(
    policy: FilteredPolicy, now: Estimate, under_way: list[ca.SX]
) -> tuple[ca.SX, ca.SX]:
    """Return `NextSample`, of the linear states, if the last command is held."""
    kalman, commands = policy.filter, [*under_way, under_way[-1]]
    k, air = len(kalman.states), now.x.numel() - len(kalman.states)
    x, Phi = _predicted(policy, now.x, commands, policy.dt)
    # A plan flies on from what it sees now, in still air.
    in_still_air = ca.vertcat(kalman.seen(now.x), ca.SX.zeros(air))
    planned, _ = _predicted(policy, in_still_air, commands, policy.dt)
    variances = ca.diag(propagated(kalman, now, x, Phi).P)[:k]
    return kalman.seen(x) - planned[:k], ca.sqrt(variances)
