"""Policies that are computed once a sample, in Python, with a memory between samples."""

from __future__ import annotations

from collections.abc import Callable
from copy import deepcopy
from dataclasses import dataclass, field, replace
from typing import Any, ClassVar, NamedTuple, Self

import numpy as np

from hfa_flight.air.delay import in_samples
from hfa_flight.air.scenario import Scenario
from hfa_flight.policies.policy import Policy
from hfa_support.errors import BadInputError, numbers_in
from hfa_support.reporting.report import Report
from trim.point.operating_point import OperatingPoint


class NextSample(NamedTuple):
    """What a filter knows of the states of the next sample, and a plan in still air does not.

    shift: how far the air along the path moves the states within a sample, (n,)
    deviations: standard deviations of the errors of the predicted states, (n,)
    """

    shift: np.ndarray
    deviations: np.ndarray


@dataclass(frozen=True, eq=False, repr=False)
class SampledPolicy(Policy):
    """Policy U = policy(t, X), computed every dt seconds and held.

    A flight calls `reset` before its first sample.

    point: trim from which deviations are measured
    dt: sample time, s
    tick: tick of the flight, s, or 0 before the policy has a flight: a tick is then a sample
    delay: time from a sample until its command acts, s
    initial: states at which a flight begins, deviations from the trim, (n,), or None if unknown
    """

    predicts = False
    #: Whether the policy plans on the nonlinear model.
    plans: ClassVar[bool] = False

    point: OperatingPoint
    dt: float
    tick: float = field(default=0.0, kw_only=True)
    delay: float = field(default=0.0, kw_only=True)
    initial: np.ndarray | None = field(default=None, kw_only=True)

    def __post_init__(self) -> None:
        """Hold the inputs of a sample."""
        object.__setattr__(self, "held", np.zeros((1, len(self.point.u))))

    def __copy__(self) -> Self:
        """Return a policy that flies another flight, with its own memory."""
        return deepcopy(self)

    def __call__(self, t: float, X: Any) -> np.ndarray:
        """Return the inputs U (m,) from the time of the sample, s, and all states X (n,).

        X and U are absolute values.
        """
        raise NotImplementedError

    def of_estimate(self, t: float, X: np.ndarray, following: NextSample) -> np.ndarray:
        """Return the inputs U (m,) from an estimate of all states, which is used as it is.

        following: what is known of the next sample
        """
        return self(t, X)

    def reset(self) -> None:
        """Forget the samples of an earlier flight."""

    def begin(self, X: Any, following: NextSample | None = None) -> None:
        """Begin a flight from expected states, (n,): a policy that plans makes its first plan.

        following: as in `of_estimate`, or None without an estimate
        """
        self.reset()

    def _begin_flight(self) -> None:
        """Begin a flight from its initial states, or forget the one before if they are unknown."""
        if self.initial is None:
            self.reset()
        else:
            self.begin(self.point.x + self.initial)

    def report(self) -> Report:
        """Return a report of the policy and of what the samples of its last flight needed."""
        return Report(f"Policy: {self.name}", self.notes(), data=self.data(self.point.model))

    def sampler(self) -> Callable[[int, np.ndarray], np.ndarray]:
        """Return the function (tick, measured) -> inputs as deviations from trim, (m,).

        A flight begins. The policy is computed at the ticks that are samples.
        """
        self._begin_flight()
        states, inputs = self.point.x, self.point.u
        return self._held_between_samples(
            lambda t, measured: np.asarray(self(t, states + measured)) - inputs
        )

    def _held_between_samples(
        self, computed: Callable[[float, np.ndarray], np.ndarray]
    ) -> Callable[[int, np.ndarray], np.ndarray]:
        """Return (tick, measured) -> the result of `computed(t, measured)` at the last sample."""
        seconds_per_tick = self.tick or self.dt
        ticks_per_sample = round(self.dt / seconds_per_tick)
        held = np.zeros(len(self.point.u))

        def sample(tick: int, measured: np.ndarray) -> np.ndarray:
            nonlocal held
            if tick % ticks_per_sample == 0:
                held = computed(tick * seconds_per_tick, measured)
            return held

        return sample

    def in_scenario(self, scenario: Scenario) -> tuple[Self, Scenario]:
        """Return the policy and the scenario with ticks that divide samples and delays.

        Raises BadInputError if the delay is not a whole number of the ticks.
        """
        tick = scenario.tick
        if not in_samples(self.dt, tick).is_whole:
            tick = self.dt
            if not in_samples(scenario.delay, tick).is_whole:
                raise BadInputError(
                    f"the delay is {scenario.delay:g} s; give a multiple of the sample time "
                    f"{self.dt:g} s, or a tick that divides both"
                )
            scenario = scenario.with_tick(tick, scenario.step)
        initial = scenario.initial if np.size(scenario.initial) else None
        return replace(self, tick=tick, delay=scenario.delay, initial=initial), scenario


def deviations_of(point: OperatingPoint, X: Any) -> np.ndarray:
    """Return the states of one sample as deviations from a trim, (n,).

    X: all states, absolute, (n,) or by name in their order

    Raises BadInputError for another number of states, and for rows of several samples.
    """
    states, trim = numbers_in("X", X), point.x
    if states.shape != trim.shape:
        raise BadInputError(
            f"X has shape {states.shape}; give the {len(trim)} states of one sample: "
            f"{', '.join(point.model.states)}"
        )
    return np.asarray(states - trim)
