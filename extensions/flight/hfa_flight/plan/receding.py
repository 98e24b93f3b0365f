"""Receding horizon in nominal units: a plan at each sample, whose first inputs are applied.

Source: Rawlings, Mayne and Diehl, Model Predictive Control, 2nd edition, Chapters 2 and 8.
"""

from __future__ import annotations

import time
from dataclasses import dataclass, field
from operator import attrgetter

import numpy as np

from hfa_flight.plan.held_model import Measured
from hfa_flight.plan.plan_program import Range
from hfa_flight.plan.planner import Plan, Planner
from hfa_flight.plan.scaled import EndPolicy
from hfa_flight.policies.policy import NextSample

#: Largest number of steps of the quadratic program for the first plan. Each later one has a single
#: step: six steps save .1 % in flights from x(0) with noise, and take four times as long. A plan
#: that exceeds its limits, so that their penalty is over a share of its cost, has further steps:
#: with a single one, noise and gusts that throw the plan beyond them lose some flights.
_FIRST_STEPS = 30
_FURTHER_STEPS = 9
_LARGE_PENALTY = 0.05
#: Factor by which a plan may cost more than the plan one sample earlier, with the cost so far.
#: Beyond it, new first plans are tried: an open-loop flight of an unstable aircraft may diverge.
_LARGEST_RISE_OF_COST = 1.05
#: The linear policy takes over where the costs of the plan and of its own flight are within this
#: fraction of z'Pz.
_AGREEMENT = 0.01
_cost = attrgetter("cost")
#: Cost below which a flight is at its target, relative to z'Pz at a corner of the usual box.
_AT_TARGET = 1e-12


@dataclass
class FlownSamples:
    """Samples of a flight of a predictive policy.

    planned: number of samples with a plan
    refused: number of them at which the step of the quadratic program was refused
    unsolved: number of quadratic programs that HPIPM ended before its tolerance
    late: number of samples at which the budget of time ended the programs
    linear: number of samples of the linear policy near the equilibrium
    first: the first plan, or None without one
    is_before: whether it was made before the flight
    first_seconds: processor time of the first plan, s
    seconds: processor time of each later sample with a plan, s
    """

    planned: int = 0
    refused: int = 0
    unsolved: int = 0
    late: int = 0
    linear: int = 0
    first: Plan | None = None
    is_before: bool = False
    first_seconds: float = 0.0
    seconds: list[float] = field(default_factory=list)


@dataclass
class _Memory:
    """What the samples of a flight leave for the next one."""

    room: Range  # soft limits of the states of a plan at this sample
    plan: Plan | None = None  # None where none is to be continued
    is_before_first: bool = False  # whether the plan was made before the flight's first sample
    linear_agrees: bool = False  # whether the linear policy takes over in its region
    spent: float = 0.0  # cost since the plan began
    samples: FlownSamples = field(default_factory=FlownSamples)


class RecedingHorizon:
    """Policy v = controller(z) in nominal units, with a memory of the samples of one flight.

    planner: plans
    end: linear policy near the target
    budget: processor time of a sample after which no further program begins, s
    """

    def __init__(self, planner: Planner, end: EndPolicy, budget: float) -> None:
        k, n, _ = planner.scaled.counts  # k states of the linear model among n followed ones
        self.planner = planner
        self.end = end
        self.budget = budget
        #: Cost below which a flight is at its target. The box is that of the states of the linear
        #: model, which are the first of the followed ones.
        self.cost_at_target = _AT_TARGET * planner.value(np.pad(planner.scaled.box, (0, n - k)))
        self.reset(delay=0.0)

    def reset(self, delay: float) -> None:
        """Begin a flight: forget the plans, commands and times of the one before.

        delay: time after which inputs act, s
        """
        self._memory = _Memory(self.planner.room)
        self.measured = Measured(self.planner.model, delay)

    @property
    def samples(self) -> FlownSamples:
        """Record of the flight since the last reset."""
        return self._memory.samples

    def begin(self, z: np.ndarray, delay: float, following: NextSample | None) -> None:
        """Begin a flight with a first plan that is made before its first sample.

        z: expected states at the first sample, (n,)
        delay: time after which inputs act, s
        following: what a filter knows of the next sample, or None without one
        """
        self.reset(delay)
        if following is not None:
            self._memory.room = self.planner.limits_left(following)
        self._begin_plan(self.measured.when_acting(z))
        self._memory.is_before_first = self.samples.is_before = True

    def rehearse(self) -> None:
        """Fly samples with all lengths of holds, so that no function is loaded in a flight."""
        k, n, _ = self.planner.scaled.counts
        z = np.pad(self.planner.scaled.box, (0, n - k))
        longest_hold = self.planner.grid.most_samples[0].max()
        for _ in range(1 + longest_hold):
            self._memory.linear_agrees = False  # plan also where the linear policy would act
            self(z)
        self.reset(delay=0.0)

    def __call__(self, z: np.ndarray, following: NextSample | None = None) -> np.ndarray:
        """Return the inputs v of the next sample, (m,), within their limits.

        z: measured deviations of the followed states, (n,), or the estimate of a filter
        following: what the filter knows of the next sample, or None without one
        """
        began = time.thread_time()
        memory = self._memory
        z_now: np.ndarray | None = z
        if following is None:
            z_now = self.measured.checked(z)
        else:
            memory.room = self.planner.limits_left(following)
        planned_before, first_plan = memory.samples.planned, memory.samples.first
        v = np.zeros(self.planner.scaled.counts.inputs)  # trim, if nothing is known of the states
        if z_now is not None:
            with np.errstate(over="ignore", invalid="ignore"):  # the flight may diverge
                z_when_acting = self.measured.when_acting(z_now)
                v = self._input(z_when_acting, began + self.budget)
        self.measured.command(v)
        # The time of the sample with the first plan is recorded apart, as `first_seconds`.
        if memory.samples.planned > planned_before and first_plan is not None:
            memory.samples.seconds.append(time.thread_time() - began)
        return v

    def _input(self, z: np.ndarray, until: float) -> np.ndarray:
        """Return the inputs from the states at the time at which they act, (m,)."""
        # The linear policy acts once it agreed and z is in its region. It agrees if z is in its
        # region, and the plan, the flight of the linear policy and z'Pz cost the same.
        memory = self._memory
        inside = self.end.contains(z)
        if memory.linear_agrees and inside:
            memory.samples.linear += 1
            memory.plan = None
            return self.end.inputs(z)
        plan = memory.plan = self._planned(z, until)
        memory.samples.planned += 1
        value = self.planner.value(z)
        within = _AGREEMENT * value
        memory.linear_agrees = bool(
            inside
            and abs(plan.cost - value) <= within
            and abs(self.planner.cost_of_gain(self.end.K, z) - value) <= within
        )
        return plan.v[0]

    def _planned(self, z: np.ndarray, until: float) -> Plan:
        """Return the plan from the states z: the last one, improved, or a new one if none exists or
        the last one has become far dearer.
        """
        memory = self._memory
        last = memory.plan
        if last is None:
            return self._begin_plan(z, until)
        if memory.is_before_first:  # `begin` has made the plan of this first sample already
            memory.is_before_first = False
            if np.array_equal(z, last.z[0]):
                return last
            return self._continued(self.planner.flown(z, last.v, memory.room), last.cost, until)
        # The last plan from the states one sample later, with the same inputs at the same times.
        # Costs are compared from the begin of the first plan on: flown samples and the plan's rest.
        promised = memory.spent + last.cost
        memory.spent += self.planner.cost_of_sample(last)
        return self._continued(self.planner.later(last, z, memory.room), promised, until)

    def _continued(self, plan: Plan, promised: float, until: float) -> Plan:
        """Return the plan, improved, or a new one if it costs far more than was promised.

        promised: cost from the begin of the first plan on, as it was expected one sample earlier.
            The present one is the part already flown, `spent`, and the cost of the plan
        """
        improved = self._improved(plan, until)
        is_late = np.isfinite(improved.cost) and time.thread_time() >= until
        if is_late or self._memory.spent + improved.cost <= _LARGEST_RISE_OF_COST * promised:
            return improved
        guess = min(self.planner.guesses(plan.z[0], plan.room), key=_cost)
        return min(self._improved(guess, until), improved, key=_cost)

    def _begin_plan(self, z: np.ndarray, until: float = np.inf) -> Plan:
        """Return the better of two new plans from the states z."""
        memory = self._memory
        began = time.thread_time()
        if memory.samples.first is None:
            until = np.inf  # the first plan of a flight may take longer than a sample
        guesses = sorted(self.planner.guesses(z, memory.room), key=_cost)
        results = [self.planner.improved(guess, _FIRST_STEPS, until) for guess in guesses]
        memory.samples.unsolved += sum(result.unsolved for result in results)
        plan = min((result.plan for result in results), key=_cost)
        memory.plan = plan
        memory.spent = 0.0
        if memory.samples.first is None:
            memory.samples.first = plan
            memory.samples.first_seconds = time.thread_time() - began
        return plan

    def _improved(self, plan: Plan, until: float) -> Plan:
        """Return a plan improved by a step of the program, or more while it exceeds limits."""
        if time.thread_time() >= until:
            self.samples.late += 1
        for steps in (1, _FURTHER_STEPS):
            plan, is_refused, unsolved = self.planner.improved(plan, steps, until)
            self.samples.unsolved += unsolved
            self.samples.refused += is_refused
            if is_refused or plan.penalty <= _LARGE_PENALTY * plan.cost:
                break
        return plan
