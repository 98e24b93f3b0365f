"""Receding horizon in nominal units: a plan at each sample, whose first inputs are applied.

Source: Rawlings, Mayne and Diehl, Model Predictive Control, 2nd edition, Chapters 2 and 8.
"""

from __future__ import annotations

import time
from dataclasses import dataclass, field

import numpy as np

from hfa_flight.plan.commands_under_way import CommandsUnderWay
from hfa_flight.plan.disturbance_estimate import DisturbanceEstimate, LastSample
from hfa_flight.plan.end_law import EndLaw
from hfa_flight.plan.hold import hold_of
from hfa_flight.plan.planner import Plan, Planner, Target
from hfa_flight.plan.sample_gate import SampleGate
from hfa_support.errors import NoSolutionError
from hfa_support.matrices import spectral_radius

#: Largest numbers of steps of the quadratic program at the first sample, and at each later one. A
#: later sample takes a further step only while the cost so far plus that of its plan exceeds the
#: least such sum so far by the factor _RISE, and the last step saved the share _WORTH of its cost.
_FIRST = 30
_LATER = 6
_RISE = 1.01
_WORTH = 0.01
#: Factor by which a plan may cost more than the plan one sample earlier, with the cost so far.
#: Beyond it, new first plans are tried: an open-loop flight of an unstable aircraft may get lost.
_LOST = 1.05
#: The linear policy takes over where the costs of the plan and of its own flight are within this
#: fraction of z'Pz.
_LINEAR = 0.01
#: Share of a plan's cost above which z'Pz at its end is replaced by a flight of the linear policy.
_SMALL_END = 0.002
#: Cost below which a flight is at its target, relative to z'Pz at a corner of the usual box.
_NOTHING = 1e-12
#: Number of samples after which the linear policy is computed again at the estimated equilibrium.
_RENEWED = 10


@dataclass
class Samples:
    """Samples of a flight of a predictive policy.

    planned: number of samples with a plan
    refused: number of them at which the step of the quadratic program was refused
    unsolved: number of quadratic programs that HPIPM ended before its tolerance
    late: number of samples at which the budget of time ended the programs
    linear: number of samples of the linear policy near the equilibrium
    first: the first plan, or None without one
    first_seconds: processor time of the first plan, s
    seconds: processor time of each later sample with a plan, s
    rise: largest rise of the cost so far plus that of the plan over the least such sum before it,
        relative to that sum. The plan counts with the flight of the linear policy after its end, or
        with z'Pz where that flight leaves the limits. A change by what was not predicted is no rise
    radius: largest spectral radius of the loop of the trim's held gain, linearized at the estimated
        equilibrium, or None without a disturbance of the model
    """

    planned: int = 0
    refused: int = 0
    unsolved: int = 0
    late: int = 0
    linear: int = 0
    first: Plan | None = None
    first_seconds: float = 0.0
    seconds: list[float] = field(default_factory=list)
    rise: float = 0.0
    radius: float | None = None


@dataclass
class _Memory:
    """What the samples of a flight leave for the next one.

    target: equilibrium at which the flight ends, and the known disturbances
    end: linear policy near it
    last: last sample that was used or replaced by its prediction, or None before the first one
    plan: last plan, or None where none is to be continued
    waits: whether the plan was made before the flight, and waits for its first sample
    near: whether the linear policy has taken over
    spent: cost since the plan began
    least: least sum of this cost and that of a plan
    """

    target: Target
    end: EndLaw
    last: LastSample | None = None
    plan: Plan | None = None
    waits: bool = False
    near: bool = False
    spent: float = 0.0
    least: float = 0.0
    samples: Samples = field(default_factory=Samples)


class RecedingHorizon:
    """Policy v = controller(z) in nominal units, with a memory of the samples of one flight.

    planner: plans
    nominal_end: linear policy near the trim
    estimates: whether constant disturbances are estimated
    budget: processor time of a sample after which no further program begins, s
    """

    def __init__(
        self, planner: Planner, nominal_end: EndLaw, *, estimates: bool, budget: float
    ) -> None:
        k, n, _ = planner.scaled.sizes
        self.planner = planner
        self.nominal_end = nominal_end
        self._estimate = DisturbanceEstimate(planner)
        self._estimates = estimates
        self.budget = budget
        self._commands = CommandsUnderWay(planner.model)
        #: Cost below which a flight is at its target.
        self.nothing = _NOTHING * planner.trim.value(np.pad(planner.scaled.box, (0, n - k)))
        self._gate = SampleGate(planner.scaled, self._commands, planner.grid.dt)
        self.reset()

    def reset(self) -> None:
        """Begin a flight: forget its plans, commands, estimates and times."""
        self._memory = _Memory(self.planner.trim, self.nominal_end)
        self._commands.clear()
        self._gate.clear()

    @property
    def wrong(self) -> int:
        """Number of samples since the last reset in whose place the prediction was used."""
        return self._gate.wrong

    @property
    def samples(self) -> Samples:
        """Record of the flight since the last reset."""
        return self._memory.samples

    @property
    def d(self) -> np.ndarray:
        """Known disturbances: constants of the rates, then that of the model."""
        return self._memory.target.d

    def begin(self, z: np.ndarray, delay: float = 0.0) -> None:
        """Begin a flight with a first plan that is made before its first sample.

        z: expected states at the first sample, (n,)
        delay: time after which inputs act, s
        """
        self.reset()
        self._begin_plan(self._commands.moved(z, delay, self.d))
        self._memory.waits = True

    def rehearse(self) -> None:
        """Fly samples with all lengths of holds, so that no function is loaded in a flight."""
        k, n, _ = self.planner.scaled.sizes
        z = np.pad(self.planner.scaled.box, (0, n - k))
        for _ in range(1 + self.planner.grid.most_samples[0].max()):
            self._memory.near = False
            self(z)
        self.reset()

    def __call__(
        self, z: np.ndarray, delay: float = 0.0, d: np.ndarray | None = None
    ) -> np.ndarray:
        """Return the inputs v of the next sample, (m,), within their limits.

        z: measured deviations of the followed states, (n,), or with d their estimate
        delay: time after which v acts, s
        d: disturbances that others have estimated, or None for the own estimate
        """
        began = time.thread_time()
        memory = self._memory
        if d is None:
            used = self._used(z)
        else:
            used = z
            self._know(d)
        if used is None:  # nothing is known about the states yet
            v = np.zeros(self.planner.scaled.sizes[2])
            self._commands.append(v)
            return v
        planned, first = memory.samples.planned, memory.samples.first
        with np.errstate(over="ignore", invalid="ignore"):  # the flight may be lost
            v = self._input(self._commands.moved(used, delay, self.d), began + self.budget)
        self._commands.append(v)
        self._remember(used, z, delay)
        if memory.samples.planned > planned and first is not None:
            memory.samples.seconds.append(time.thread_time() - began)
        return v

    def _used(self, z: np.ndarray) -> np.ndarray | None:
        """Return the states of a sample, or their prediction if it is wrong, None without one."""
        last = self._memory.last
        after_a_wrong_one = self._gate.follows_a_wrong_one
        used = self._gate.used(z)
        if self._estimates and last is not None and used is z and not after_a_wrong_one:
            self._know(self._estimate.updated(self.d, z, last))
        return used

    def _know(self, d: np.ndarray) -> None:
        """Plan with some disturbances from now on."""
        self._memory.target = self._estimate.target(d, self._memory.target)
        self._renew_end()

    def _input(self, z: np.ndarray, until: float) -> np.ndarray:
        """Return the inputs from the states at the time at which they act, (m,).

        until: processor time after which no further program begins, s
        """
        memory = self._memory
        target = memory.target
        inside = memory.end.contains(z, target)
        if memory.near and inside:
            memory.samples.linear += 1
            memory.plan = None
            return memory.end.inputs(z, target)
        plan = memory.plan = self._planned(z, until)
        memory.samples.planned += 1
        value = target.value(z)
        agree = abs(plan.cost - value) <= _LINEAR * value
        memory.near = bool(
            inside and agree and abs(self._linear_cost(z) - value) <= _LINEAR * value
        )
        return plan.v[0]

    def _linear_cost(self, z: np.ndarray) -> float:
        """Return the cost of the flight of the linear policy from z, inf beyond the limits."""
        return self.planner.cost_of_gain(self._memory.end.K, z, self._memory.target)

    def _value(self, plan: Plan) -> float:
        """Return the cost of a plan with the flight of the linear policy after its end, or with
        z'Pz where that flight leaves the limits.
        """
        at_end = plan.target.value(plan.z[-1])
        if at_end <= _SMALL_END * plan.cost:
            return plan.cost
        linear = self._linear_cost(plan.z[-1])
        return plan.cost - at_end + linear if np.isfinite(linear) else plan.cost

    def _planned(self, z: np.ndarray, until: float) -> Plan:
        """Return the plan from the states z: the last one, improved, or the better of two new."""
        memory = self._memory
        last = memory.plan
        if last is None:
            return self._begin_plan(z, until)
        if memory.waits:
            memory.waits = False
            plan = self.planner.flown(z, last.v, memory.target)
            if not plan.cost <= _LOST * last.cost:
                return self._begin_plan(z, until)
            return last if np.array_equal(z, last.z[0]) else self._improved(plan, until)
        return self._later(last, z, until)

    def _begin_plan(self, z: np.ndarray, until: float = np.inf) -> Plan:
        """Return the better of two new plans from the states z.

        until: processor time after which no further program begins, s. The first plan of a flight
            has no such limit
        """
        memory = self._memory
        began = time.thread_time()
        if memory.samples.first is None:
            until = np.inf
        guesses = sorted(self.planner.guesses(z, memory.target), key=lambda each: each.cost)
        improved = [self.planner.improved(guess, _FIRST, until) for guess in guesses]
        memory.samples.unsolved += sum(each.unsolved for each in improved)
        plan = min((each.plan for each in improved), key=lambda each: each.cost)
        memory.plan = plan
        memory.spent, memory.least = 0.0, self._value(plan)
        if memory.samples.first is None:
            memory.samples.first = plan
            memory.samples.first_seconds = time.thread_time() - began
        return plan

    def _later(self, last: Plan, z: np.ndarray, until: float) -> Plan:
        """Return the last plan one sample later, improved."""
        planner, memory = self.planner, self._memory
        target = memory.target
        promised = memory.spent + last.cost
        memory.spent += planner.cost_of_sample(last)
        plan = planner.later(last, z, target)
        unpredicted = plan.cost - planner.later(last, last.z[1], last.target).cost
        memory.least = memory.least + unpredicted if np.isfinite(unpredicted) else np.inf
        if not np.isfinite(plan.cost) or memory.spent + plan.cost > _LOST * promised:
            plan = min(*planner.guesses(z, target), plan, key=lambda each: each.cost)
        return self._improved(plan, until)

    def _improved(self, plan: Plan, until: float) -> Plan:
        """Return a plan improved by a program, and by further ones where they are worth it."""
        samples, memory = self.samples, self._memory
        total = memory.spent + self._value(plan)
        is_refused = False
        for _ in range(_LATER):
            if time.thread_time() >= until:
                samples.late += 1
                break
            before = plan.cost
            plan, is_refused, unsolved = self.planner.improved(plan, 1, until)
            samples.unsolved += unsolved
            total = memory.spent + self._value(plan)
            if plan.cost > (1.0 - _WORTH) * before or total <= _RISE * memory.least:
                break
        samples.refused += is_refused
        samples.rise = max(samples.rise, (total - memory.least) / max(memory.least, self.nothing))
        memory.least = min(total, memory.least)
        return plan

    def _remember(self, z: np.ndarray, measured: np.ndarray, delay: float) -> None:
        """Store the states, the acting inputs, and the states predicted for the next sample.

        z: states of the sample, or their prediction, (n,)
        measured: the sample itself, (n,)
        """
        dt = self.planner.grid.dt
        acting = self._commands.acting(self._commands.count - 1, delay, dt)
        shares = [seconds / dt for _, seconds in acting]
        average = np.array(shares) @ np.array([v for v, _ in acting])
        predicted = self._gate.predict(z, measured, delay, self.d)
        self._memory.last = LastSample(z, average, predicted)

    def _renew_end(self) -> None:
        """Linearize the end of a plan at the target, if a disturbance of the model is known."""
        from scipy.linalg import LinAlgError, solve_continuous_are

        planner, target = self.planner, self._memory.target
        k, n, _ = planner.scaled.sizes
        if len(target.d) == n or self._commands.count % _RENEWED:
            return
        _, slopes, _ = planner.model.slopes(np.concatenate([target.z, target.v]), target.d[n:])
        by_both = np.array(slopes)[:k]
        linear = by_both[:, :k], by_both[:, n:], *planner.scaled.linear_states[2:]
        hold = hold_of(*linear, planner.grid.dt)
        radius = spectral_radius(hold.A - hold.B @ self.nominal_end.K)
        self.samples.radius = max(radius, self.samples.radius or 0.0)
        try:
            K, _ = hold.forever()
            P = solve_continuous_are(*linear)
        except (NoSolutionError, LinAlgError):
            return
        self._memory.end = EndLaw(planner.scaled, hold, K)
        self._memory.target = target._replace(P=np.pad(P, [(0, n - k)] * 2))
