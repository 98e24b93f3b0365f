"""Receding horizon in nominal units: a plan at each sample, whose first inputs are applied.

Source: Rawlings, Mayne and Diehl, Model Predictive Control, 2nd edition, Chapters 2 and 8.
"""

from __future__ import annotations

import time
from dataclasses import dataclass, field

import numpy as np

from hfa_flight.hold import hold_of
from hfa_optimal.commands_under_way import CommandsUnderWay
from hfa_optimal.disturbance_estimate import DisturbanceEstimate
from hfa_optimal.end_law import EndLaw
from hfa_optimal.planner import Plan, Planner
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
#: Number of samples after which the linear policy is computed again at the estimated equilibrium.
_RENEWED = 10


@dataclass
class Samples:
    """Samples of a flight of a predictive policy.

    planned: number of samples with a plan
    refused: number of them at which the step of the quadratic program was refused
    linear: number of samples of the linear policy near the equilibrium
    first: the first plan, or None without one
    first_seconds: processor time of the first plan, s
    seconds: processor time of each later sample with a plan, s
    rise: largest rise of the cost so far plus that of the plan over the least such sum before it,
        relative to that sum. The plan counts with the flight of the linear policy after its end, or
        with z'Pz where that flight leaves the limits
    radius: largest spectral radius of the loop of the trim's held gain, linearized at the estimated
        equilibrium, or None without a disturbance of the model
    """

    planned: int = 0
    refused: int = 0
    linear: int = 0
    first: Plan | None = None
    first_seconds: float = 0.0
    seconds: list[float] = field(default_factory=list)
    rise: float = 0.0
    radius: float | None = None


class RecedingHorizon:
    """Policy v = controller(z) in nominal units, with a memory of the samples of one flight.

    planner: plans
    end: linear policy near the equilibrium
    estimates: whether constant disturbances are estimated
    samples: record of the flight since the last reset
    """

    def __init__(self, planner: Planner, end: EndLaw, *, estimates: bool) -> None:
        self.planner = planner
        self.estimate = DisturbanceEstimate(planner)
        self._estimates = estimates
        self._commands = CommandsUnderWay(planner.model)
        self._nominal = planner.P, end
        self.reset()

    def reset(self) -> None:
        """Begin a flight: forget its plans, commands, estimates and times."""
        self.planner.P, self._end = self._nominal
        self.estimate.clear()
        self._plan: Plan | None = None
        self._near = False
        self._spent, self._least = 0.0, 0.0
        self._commands.clear()
        self._count = 0
        self._before: tuple[np.ndarray, np.ndarray, np.ndarray] | None = None
        self.samples = Samples()

    @property
    def nominal_end(self) -> EndLaw:
        """Linear policy near the trim."""
        return self._nominal[1]

    def __call__(self, z: np.ndarray, delay: float = 0.0) -> np.ndarray:
        """Return the inputs v of the next sample, (m,), within their limits.

        z: measured deviations of the followed states, (n,)
        delay: time after which v acts, s
        """
        began = time.process_time()
        if self._estimates and self._before is not None:
            self.estimate.update(z, self._before)
            self._renew_end()
        planned = self.samples.planned
        v = self._input(self._commands.moved(z, delay, self.estimate.d))
        self._commands.append(v)
        self._remember(z, delay)
        self._count += 1
        if self.samples.planned > planned:
            self._time(time.process_time() - began)
        return v

    def _input(self, z: np.ndarray) -> np.ndarray:
        """Return the inputs from the states at the time at which they act, (m,)."""
        target = self.estimate.target
        inside = self._end.contains(z, target)
        if self._near and inside:
            self.samples.linear += 1
            self._plan = None
            return self._end.inputs(z, target)
        self._plan = self._planned(z)
        self.samples.planned += 1
        away = z - target.z
        value = away @ self.planner.P @ away
        agree = abs(self._plan.cost - value) <= _LINEAR * value
        self._near = bool(inside and agree and abs(self._linear_cost(z) - value) <= _LINEAR * value)
        return self._plan.v[0]

    def _linear_cost(self, z: np.ndarray) -> float:
        """Return the cost of the flight of the linear policy from z, inf beyond the limits."""
        return self.planner.cost_of_gain(self._end.K, z, self.estimate.d, self.estimate.target)

    def _value(self, plan: Plan) -> float:
        """Return the cost of a plan with the flight of the linear policy after its end, or with
        z'Pz where that flight leaves the limits.
        """
        away = plan.z[-1] - self.estimate.target.z
        at_end = float(away @ self.planner.P @ away)
        if at_end <= _SMALL_END * plan.cost:
            return plan.cost
        linear = self._linear_cost(plan.z[-1])
        return plan.cost - at_end + linear if np.isfinite(linear) else plan.cost

    def _time(self, seconds: float) -> None:
        """Add the processor time of a sample with a plan."""
        done = self.samples
        if done.first is None:
            done.first, done.first_seconds = self._plan, seconds
        else:
            done.seconds.append(seconds)

    def _planned(self, z: np.ndarray) -> Plan:
        """Return the plan from the states z: the last one, improved, or the better of two new."""
        planner, d, target = self.planner, self.estimate.d, self.estimate.target
        if self._plan is None:
            plans = [
                planner.improved(guess, d, target, _FIRST)[0]
                for guess in planner.guesses(z, d, target)
            ]
            plan = min(plans, key=lambda each: each.cost)
            self._spent, self._least = 0.0, self._value(plan)
            return plan
        promised = self._spent + self._plan.cost
        self._spent += planner.cost_of_sample(self._plan, target)
        plan = planner.later(self._plan, z, d, target)
        if not np.isfinite(plan.cost) or self._spent + plan.cost > _LOST * promised:
            plan = min(*planner.guesses(z, d, target), plan, key=lambda each: each.cost)
        for _ in range(_LATER):
            before = plan.cost
            plan, refused = planner.improved(plan, d, target, 1)
            total = self._spent + self._value(plan)
            if plan.cost > (1.0 - _WORTH) * before or total <= _RISE * self._least:
                break
        self.samples.refused += refused
        self.samples.rise = max(self.samples.rise, total / self._least - 1.0)
        self._least = min(total, self._least)
        return plan

    def _remember(self, z: np.ndarray, delay: float) -> None:
        """Store the states, the acting inputs, and the states predicted for the next sample."""
        acting = self._commands.acting(self._count, delay, self.planner.grid.dt)
        shares = [seconds / self.planner.grid.dt for _, seconds in acting]
        average = np.array(shares) @ np.array([v for v, _ in acting])
        self._before = z, average, self._commands.over(z, acting, self.estimate.d)

    def _renew_end(self) -> None:
        """Linearize the end of a plan at the target, if a disturbance of the model is estimated."""
        from scipy.linalg import LinAlgError, solve_continuous_are

        planner, target, d = self.planner, self.estimate.target, self.estimate.d
        k, n, _ = planner.scaled.sizes
        if len(d) == n or self._count % _RENEWED:
            return
        _, slopes, _ = planner.model.slopes(np.concatenate([target.z, target.v]), d[n:])
        by_both = np.array(slopes)[:k]
        linear = by_both[:, :k], by_both[:, n:], *planner.scaled.linear_states[2:]
        hold = hold_of(*linear, planner.grid.dt)
        radius = spectral_radius(hold.A - hold.B @ self._nominal[1].K)
        self.samples.radius = max(radius, self.samples.radius or 0.0)
        try:
            K, _ = hold.forever()
            P = solve_continuous_are(*linear)
        except (NoSolutionError, LinAlgError):
            return
        self._end = EndLaw(planner.scaled, hold, K)
        self.planner.P = np.pad(P, [(0, n - k)] * 2)
