"""Plans of a predictive policy: flights of the model that a quadratic program improves."""

from __future__ import annotations

import time
from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from hfa_flight.plan.held_model import HeldModel, NearestInputs
from hfa_flight.plan.plan_program import (
    AlongHolds,
    PlanCost,
    PlanProgram,
    ProgramSolution,
    Range,
    Room,
)
from hfa_flight.plan.scaled import Grid, Hold, ScaledProblem, gains_of
from hfa_flight.policies.policy import NextSample
from hfa_support.native.bound import BoundFunction
from hfa_support.native.row_code import machine_code

#: Factors on a step of the quadratic program that are tried until the flight is cheaper.
_SHARES_OF_STEP = (1.0, 0.35, 0.1225, 0.042875)
#: Cost above which a flight is taken as infinite.
_INFINITE = 1e20
#: A plan is not improved further if its cost falls by less than this fraction.
_LEAST_GAIN = 3e-5
#: Share of its cost that a program must promise for a second program of the same step.
_WORTH_A_SECOND = 1e-3
#: Part of the room of a state beyond which the quadratic program knows its limits.
_NEAR_LIMIT = 0.5
#: Penalty of a soft limit, in units of the largest slope of z'Pz over the usual box, per sample.
#: With a tenth of it, flights leave the limits where this is cheaper.
_STIFFNESS = 5.0
#: Least penalty of a soft limit, relative to the largest: z'Pz gives a state such as the altitude
#: none. It sets those of all states of the flexible aircraft but the speed. With a hundredth of it
#: and ten times of it, 15 flights about x(0) at 5, 10 and 15 deg stay inside and cost the same
#: within 0.3 %.
_LEAST_PENALTY = 0.02
#: Largest unit of a slack, nominal values.
_LARGEST_SLACK = 5.0
#: Factor on the gains of a first plan where those of the linear optimum lead to infinity.
_HARDER_GAIN = 2.0
#: Duration of the flight of a gain, in horizons.
_HORIZONS_OF_GAIN = 4
#: Number of standard deviations by which the limits of states are narrowed further, and the share
#: of the distances from trim to limits that always remains.
_STANDARD_DEVIATIONS = 4.0
_LEAST_ROOM = 0.5


class Plan(NamedTuple):
    """Flight of the model over the horizon.

    room: soft limits of its states
    z: states at the nodes, (N + 1, n)
    middle: states in the middle of the holds, (N, n)
    v: inputs during the holds, (N, m)
    cost: cost of the flight, with z'Pz at its end and the penalty of exceeded soft limits
    penalty: that penalty
    age: number of samples since the first plan, which decides the holds
    """

    room: Range
    z: np.ndarray
    middle: np.ndarray
    v: np.ndarray
    cost: float
    penalty: float
    age: int


class Improved(NamedTuple):
    """Plan after some steps of the quadratic program.

    is_refused: whether the last step was refused
    unsolved: number of programs that were ended before the tolerance
    """

    plan: Plan
    is_refused: bool
    unsolved: int


class Planner:
    """Plans over the holds of a grid, in nominal units.

    A plan is a flight of the smooth equations with held inputs. Its cost is the exact cost of the
    linear model over the holds, plus z'Pz at the end. The limits of the inputs are hard. Those of
    the states are soft at the samples and halfway between them, with an exact penalty, and narrowed
    by the margin and by what a filter predicts (`limits_left`). The quadratic program knows them at
    the ends of the holds, and those of fast states at the middles.

    scaled: the problem in nominal units
    grid: holds of a plan
    P: matrix of the cost z'Pz at the end of a plan, (n, n)
    margin: fraction of the distance from the trim by which the limits of the states are narrowed
    soft: indices of the states with soft limits, (S,)
    room: their limits, narrowed by the margin alone
    """

    def __init__(self, scaled: ScaledProblem, grid: Grid, P: np.ndarray, margin: float) -> None:
        self.scaled = scaled
        self.grid = grid
        self.P = P
        self.margin = margin
        lowest, highest = scaled.state_limits
        self.soft = np.flatnonzero(np.isfinite(lowest) | np.isfinite(highest))
        self.room = Range((1.0 - margin) * lowest[self.soft], (1.0 - margin) * highest[self.soft])
        # Largest number of samples of each hold, (N,), and of a whole plan.
        longest, count = grid.most_samples
        #: Indices in `soft` of the states that the inputs move fast.
        self._fast_limits = np.flatnonzero(scaled.reached(grid.dt)[self.soft])
        self._slack_slopes, self._slack_curvatures = self._slack_penalties(P)
        # For the last hold, whose inputs `later` must choose.
        self._nearest = NearestInputs(scaled, grid.dt * longest[-1], 1.0 - margin)
        self.model = HeldModel(scaled, grid.dt * longest)
        self._half_holds = HeldModel(scaled, 0.5 * grid.dt * longest)
        #: The model by half samples, for the flight of a plan.
        self._half_samples = HeldModel(scaled, np.full(2 * count, 0.5 * grid.dt))
        self._linear_gains, _ = gains_of(grid.at(0).linear, P)
        self._gain_flight = self._flight_of_gain()
        self._programs = self._all_programs()

    def __reduce__(self) -> tuple[type[Planner], tuple[Any, ...]]:
        """Return the constructor and its arguments, for copies and pickle."""
        return Planner, (self.scaled, self.grid, self.P, self.margin)

    def _slack_penalties(self, P: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return slope and curvature of the penalty of a slack that lasts a second, (S,) each."""
        k = self.scaled.counts.linear
        lowest, highest = self.scaled.state_limits
        slopes = 2.0 * np.abs(P[:, :k]) @ self.scaled.box  # largest ones of z'Pz over the box
        least = _LEAST_PENALTY * slopes.max()
        penalties = _STIFFNESS * np.maximum(slopes, least)[self.soft] / self.grid.dt
        # A slack of this size costs half as much again as by the slope alone.
        largest_slack = np.minimum(0.5 * (highest - lowest)[self.soft], _LARGEST_SLACK)
        return penalties, penalties / largest_slack

    def value(self, z: np.ndarray) -> float:
        """Return the linear cost z'Pz of some states, (n,)."""
        return float(z @ self.P @ z)

    def limits_left(self, following: NextSample) -> Range:
        """Return the soft limits for a plan, which knows no air, from what a filter predicts.

        They are moved against the shift of the states that the estimated air causes, and narrowed
        by the spread of the states, at most to `_LEAST_ROOM` of the distances from trim to limits.
        """
        shift, spread = (
            following.shift[self.soft],
            _STANDARD_DEVIATIONS * following.deviations[self.soft],
        )
        lowest, highest = (limit[self.soft] for limit in self.scaled.state_limits)
        return Range(
            np.minimum(self.room.least - shift + spread, _LEAST_ROOM * lowest),
            np.maximum(self.room.most - shift - spread, _LEAST_ROOM * highest),
        )

    def flown(self, z: np.ndarray, v: np.ndarray, room: Range, age: int = 0) -> Plan:
        """Return the plan with given inputs, with infinite cost if the flight is not finite.

        z: states now, (n,)
        v: inputs during the holds, (N, m)
        room: soft limits of the states
        age: number of samples since the first plan
        """
        holds = self.grid.at(age)
        halves = 2 * holds.samples  # number of half samples of each hold
        ends = np.cumsum(halves)
        # The half samples are those of the longest plan; those after this plan are not used.
        inputs = np.zeros((len(self._half_samples.holds), v.shape[1]))
        inputs[: ends[-1]] = np.repeat(v, halves, axis=0)
        states = self._half_samples.flown(z, inputs)[: ends[-1] + 1]
        nodes, middle = states[np.append(0, ends)], states[ends - halves // 2]
        with np.errstate(all="ignore"):
            z_and_v = np.hstack([nodes[:-1], v])
            cost = np.einsum("ki,kij,kj->", z_and_v, holds.weights, z_and_v) + self.value(nodes[-1])
            penalty = self._penalty(states[1:], room)
            cost = float(cost + penalty)
        return Plan(room, nodes, middle, v, cost if cost < _INFINITE else np.inf, penalty, age)

    def _penalty(self, states: np.ndarray, room: Range) -> float:
        """Return the penalty of exceeded soft limits at the ends of half samples, (K, n)."""
        soft = states[:, self.soft]
        slack = np.maximum(0.0, np.maximum(soft - room.most, room.least - soft))
        penalties = (slack * (self._slack_slopes + 0.5 * self._slack_curvatures * slack)).sum()
        return float(0.5 * self.grid.dt * penalties)

    def cost_of_gain(self, K: np.ndarray, z: np.ndarray) -> float:
        """Return the cost of the flight of v = -K z, within the limits of the inputs.

        It lasts four horizons, and z'Pz at its end is added. It is infinite if a sample exceeds the
        narrowed limits of the states.

        K: held gain, (m, k)
        z: initial states, (n,)
        """
        begin = np.concatenate([z, [0.0, 0.0]])
        (result,) = self._gain_flight.at(begin, K.ravel())
        after, (flown_cost, excess) = result[:-2], result[-2:]
        cost = float(flown_cost) + self.value(after) if excess == 0.0 else np.inf
        return cost if cost < _INFINITE else np.inf

    def _flight_of_gain(self) -> BoundFunction:
        """Return the machine code of ([z, cost, excess], K by rows) -> [z, cost, excess] after four
        horizons, with the inputs -K z of the first k states, saturated.

        excess: largest excess over the soft limits up to now
        """
        k, n, m = self.scaled.counts
        begin, K = ca.MX.sym("begin", n + 2), ca.MX.sym("K", m * k)
        arguments = [begin, K]
        z, cost, excess = begin[:n], begin[n], begin[n + 1]
        least, most = (ca.DM(limit) for limit in self.scaled.input_limits)
        v = ca.fmin(ca.fmax(-ca.reshape(K, k, m).T @ z[:k], least), most)
        z_and_v = ca.vertcat(z, v)
        after = self.model.sample(z, v, self.grid.dt)
        cost += ca.bilin(ca.DM(self.grid.at(0).weights[0]), z_and_v, z_and_v)
        soft = ca.vec(after[self.soft.tolist()])
        lows, highs = (ca.DM(limit) for limit in self.room)
        excess = ca.mmax(ca.vertcat(excess, soft - highs, lows - soft))
        step = ca.Function("step", arguments, [ca.vertcat(after, cost, excess)]).expand()
        samples = _HORIZONS_OF_GAIN * int(self.grid.samples(0).sum())
        flown = step.fold(samples)(begin, ca.repmat(K, 1, samples))
        return BoundFunction(machine_code(ca.Function("gain_flight", arguments, [flown])))

    def cost_of_sample(self, plan: Plan) -> float:
        """Return the cost of the first hold of a plan."""
        z_and_v = np.concatenate([plan.z[0], plan.v[0]])
        return float(z_and_v @ self.grid.at(plan.age).weights[0] @ z_and_v)

    def improved(self, plan: Plan, tries: int, until: float = np.inf) -> Improved:
        """Return a plan of at most the cost of the given one.

        A step of the quadratic program is shortened until the flight of the model is cheaper.
        Otherwise it is refused, and the plan stays.

        tries: largest number of steps
        until: processor time of the thread after which no further program begins, s
        """
        unsolved = 0
        for _ in range(tries):
            if not np.isfinite(plan.cost) or time.thread_time() >= until:
                break
            better, failed = self._step(plan, until)
            unsolved += failed
            if better is None:
                return Improved(plan, is_refused=True, unsolved=unsolved)
            gained = plan.cost - better.cost
            plan = better
            if gained < _LEAST_GAIN * plan.cost:
                break
        return Improved(plan, is_refused=False, unsolved=unsolved)

    def _step(self, plan: Plan, until: float) -> tuple[Plan | None, int]:
        """Return a cheaper plan by a step of the program, or None, and the unsolved programs."""
        # The plan itself is returned where the program promises less than _LEAST_GAIN of its cost.
        # If the full step is not cheaper, a second program has limits that are corrected by the
        # difference of the flight from its linear prediction. Shorter steps then follow a parabola
        # that begins along the first step and ends at that of the second program.
        slopes = self._slopes_along(plan)
        no_correction = np.zeros(plan.middle.shape)
        first = self._proposed(plan, slopes, AlongHolds(no_correction, no_correction))
        unsolved = int(not first.is_solved)
        if not np.isfinite(first.v).all():
            return None, unsolved
        # The program's change of cost contains the penalty after the step, but does not subtract
        # the penalty of the plan before it.
        promised = plan.penalty - first.cost
        if first.is_solved and promised < _LEAST_GAIN * plan.cost:
            return plan, 0
        full = self._changed(plan, first.v)
        if full.cost < plan.cost:
            return full, unsolved
        bend = np.zeros(first.v.shape)
        if (
            np.isfinite(full.cost)
            and promised > _WORTH_A_SECOND * plan.cost
            and time.thread_time() < until
        ):
            z_and_v = np.hstack([first.z[:-1], first.v])
            ends = full.z[1:] - plan.z[1:] - first.z[1:]
            middles = full.middle - plan.middle - np.einsum("nij,nj->ni", slopes.middles, z_and_v)
            second = self._proposed(plan, slopes, AlongHolds(ends, middles))
            unsolved += not second.is_solved
            bend = np.where(np.isfinite(second.v), second.v - first.v, 0.0)
        for share in (
            _SHARES_OF_STEP if bend.any() else _SHARES_OF_STEP[1:]
        ):  # the full step has been flown
            shorter = self._changed(plan, share * first.v + share**2 * bend)
            if shorter.cost < plan.cost:
                return shorter, unsolved
        return None, unsolved

    def _changed(self, plan: Plan, change: np.ndarray) -> Plan:
        """Return the plan with a change of its inputs, (N, m), within their limits."""
        v = np.clip(plan.v + change, *self.scaled.input_limits)
        return self.flown(plan.z[0], v, plan.room, plan.age)

    def _proposed(self, plan: Plan, slopes: AlongHolds, correction: AlongHolds) -> ProgramSolution:
        """Return the result of the quadratic program: changes of inputs, states and cost.

        slopes: derivatives of the states, as `_slopes_along` returns them
        correction: what is added to the states of the plan before their limits are applied
        """
        # Places in `soft` of the states with limits in the program, and of the fast ones of these.
        limited, program = self._program_for(plan)
        fast = limited[program.fast]

        states, fast_states = self.soft[limited], self.soft[fast]
        ends = (plan.z[1:] + correction.ends)[:, states]
        middles = (plan.middle + correction.middles)[:, fast_states]
        lows, highs = plan.room
        lowest, highest = self.scaled.input_limits
        holds = self.grid.at(plan.age)
        seconds = holds.seconds[:, None]  # the penalties are those of a slack for a second
        cost = PlanCost(
            z=plan.z,
            v=plan.v,
            weights=holds.weights,
            P=self.P,
            slack_slopes=seconds * self._slack_slopes[limited],
            slack_curvatures=seconds * self._slack_curvatures[limited],
            value=plan.cost,
        )
        room = Room(
            ends=Range(lows[limited] - ends, highs[limited] - ends),
            middles=Range(lows[fast] - middles, highs[fast] - middles),
            inputs=Range(lowest - plan.v, highest - plan.v),
        )
        of_fast = slopes.middles[:, fast_states]
        return program.step(cost, AlongHolds(slopes.ends, of_fast), room)

    def _program_for(self, plan: Plan) -> tuple[np.ndarray, PlanProgram]:
        """Return the smallest program with all limits that are near, and their places in `soft`."""
        lows, highs = plan.room
        states = plan.z[1:, self.soft]
        near = (states > _NEAR_LIMIT * highs) | (states < _NEAR_LIMIT * lows)
        needed = set(np.flatnonzero(near.any(axis=0)).tolist())
        # The smallest programs come first, and the last one has the limits of all states.
        places, program = next(known for known in self._programs if needed <= known[0])
        return np.array(sorted(places), dtype=int), program

    def _all_programs(self) -> list[tuple[set[int], PlanProgram]]:
        """Return the programs with the limits at some places in `soft`, the smallest first."""
        # They are built before a flight: with no limits, with those of the fast states, with these
        # and those of one other state, and with all.
        fast = set(self._fast_limits.tolist())
        every = set(range(len(self.soft)))
        wanted = [set[int](), fast, *(fast | {one} for one in sorted(every - fast)), every]
        _, n, m = self.scaled.counts
        programs = []
        for number, places in enumerate(wanted):
            if places in wanted[:number]:
                continue  # as where no state is fast, or one alone is not
            ordered = np.array(sorted(places), dtype=int)
            of_fast = np.flatnonzero(np.isin(ordered, self._fast_limits))
            program = PlanProgram(len(self.model.holds), n, m, self.soft[ordered], of_fast)
            programs.append((places, program))
        return programs

    def _slopes_along(self, plan: Plan) -> AlongHolds:
        """Return the derivatives of the states at the ends and middles of the holds."""
        holds = self.grid.at(plan.age)
        z, n = plan.z[:-1], plan.z.shape[1]
        if not len(self._fast_limits):
            ends = self.model.moved_along(z, plan.v, holds.seconds)[1]
            return AlongHolds(ends, ends)  # middles are used of fast states only: here, none
        half = 0.5 * holds.seconds
        middle, first_half = self._half_holds.moved_along(z, plan.v, half)
        _, second_half = self._half_holds.moved_along(middle, plan.v, half)
        # Chain rule: the inputs act in the first half, through the middle, and in the second.
        whole = second_half[:, :, :n] @ first_half
        whole[:, :, n:] += second_half[:, :, n:]
        return AlongHolds(whole, first_half)

    def guesses(self, z: np.ndarray, room: Range) -> list[Plan]:
        """Return two first plans: the saturated linear optimum, and the inputs of the trim.

        If neither flight is finite, that of the double gains follows.
        """
        holds = self.grid.at(0)
        constant = np.zeros((len(holds.samples), self.scaled.counts.inputs))
        inputs = [self._inputs_of_gains(z, 1.0), constant]
        plans = [self.flown(z, v, room) for v in inputs]
        if not any(np.isfinite(plan.cost) for plan in plans):
            plans.append(self.flown(z, self._inputs_of_gains(z, _HARDER_GAIN), room))
        return plans

    def _inputs_of_gains(self, z: np.ndarray, factor: float) -> np.ndarray:
        """Return the inputs of the linear optimum times a factor, within the limits, (N, m)."""
        inputs = []
        for gain, samples in zip(self._linear_gains, self.grid.at(0).samples, strict=True):
            inputs.append(np.clip(-factor * gain @ z, *self.scaled.input_limits))
            for _ in range(samples):
                z = self.model.after(z, inputs[-1], self.grid.dt)
        return np.array(inputs)

    def later(self, plan: Plan, z: np.ndarray, room: Range) -> Plan:
        """Return the plan one sample later: the same inputs at the same times.

        z: states now, (n,)
        """
        before, holds = self.grid.at(plan.age), self.grid.at(plan.age + 1)
        # Samples of `plan` at which the holds of the later plan begin, and then the numbers of the
        # holds of `plan` in which these samples are.
        begins = 1 + np.cumsum(holds.samples) - holds.samples
        number = np.searchsorted(np.cumsum(before.samples), begins, side="right")
        v = plan.v[np.minimum(number, len(plan.v) - 1)]
        beyond = number == len(plan.v)  # holds that begin after the end of the plan
        if beyond.any():
            v[beyond] = self._last_input(plan, holds.linear[-1], room)
        return self.flown(z, v, room, plan.age + 1)

    def _last_input(self, plan: Plan, hold: Hold, room: Range) -> np.ndarray:
        """Return the cheapest input of a hold after the end of a plan, (m,)."""
        z = plan.z[-1]
        gain, _ = hold.back(self.P)
        linear = np.clip(-gain @ z, *self.scaled.input_limits)
        # Of each proposal, the nearest input that keeps the limits of the rates.
        inputs = [self._nearest(z, v) for v in (linear, plan.v[-1], np.zeros(len(linear)))]
        costs = []
        for v in inputs:
            (after,), _ = self._nearest.model.moved_along(z[None], v[None])
            z_and_v = np.concatenate([z, v])
            penalty = self._penalty(after[None], room)
            costs.append(z_and_v @ hold.W @ z_and_v + self.value(after) + penalty)
        return inputs[int(np.argmin(costs))]
