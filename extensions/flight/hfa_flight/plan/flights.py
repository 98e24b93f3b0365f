"""Simulation of flights of a problem, and their costs."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields, replace
from functools import cached_property, partial
from typing import Any

import casadi as ca
import numpy as np

from controller.critic.critic import Critic
from controller.critic.features import symbols_for
from hfa_aircraft.batch_simulation import FAR, Cost, saturated
from hfa_flight.air.scenario import Scenario
from hfa_flight.plan.collocation import CandidateFlight
from hfa_flight.plan.problem import FlightProblem
from hfa_flight.plan.smooth import smooth_slopes
from hfa_flight.policies.filtered_policy import command_of
from hfa_flight.policies.given import policy_and_scenario
from hfa_flight.policies.policy import FunctionPolicy, GainPolicy, Measurements, Policy
from hfa_flight.policies.scheduled_gains import ScheduledGainPolicy
from hfa_flight.simulate.closed_loop import FlightLoop, NonlinearPlant
from hfa_flight.simulate.envelope import (
    FlightRow,
    departure,
    has_returned,
    outside,
    share_at_limits,
)
from hfa_flight.simulate.history import Deviations
from hfa_flight.simulate.simulation import CompiledLoop
from hfa_support.errors import NoSolutionError
from hfa_support.matrices import spectral_abscissa
from trim.linear.delays import step_count

#: Largest growth exponent of the linear costate equations in one step of the Riccati recursion.
_LARGEST_EXPONENT = 6.0
#: Name of the flight that follows a candidate.
FOLLOWING = "best flight found"
#: Integration steps in a tick. z* and v* are given at the ends of each step.
STEPS = 8


@dataclass(frozen=True, eq=False, repr=False)
class TrackingPolicy(Policy):
    """Policy v = v*(t) - K(t) (z - z*(t)), saturated at the input limits.

    z* and v* are the candidate, interpolated linearly in each integration step.

    held: one row per tick, as `tracking_rows` returns them: begin of the tick, s, then (z*, v*) at
        the ends of its integration steps, then the columns of K
    tick: duration of a tick, s
    moved: indices of the inputs in v
    count: number of all inputs
    lowest, highest: limits of v, (m,)
    """

    tick: float
    moved: list[int]
    count: int
    lowest: np.ndarray
    highest: np.ndarray

    def control(self, t: ca.SX, measurements: Measurements, held: ca.SX) -> ca.SX:
        """Return the deviations of all inputs as an expression. Inputs that do not move are 0."""
        k = measurements.error.numel()
        m = len(self.moved)
        size = (STEPS + 1) * (k + m)
        begin, proposed, K = ca.vertsplit(held, [0, 1, 1 + size, 1 + size + m * k])
        step = STEPS * (t - begin) / self.tick
        # Weights of the values at the ends of the steps in their linear interpolation.
        weights = [ca.fmax(0.0, 1.0 - ca.fabs(step - knot)) for knot in range(STEPS + 1)]
        interpolated = ca.mtimes(ca.reshape(proposed, k + m, STEPS + 1), ca.vertcat(*weights))
        z_proposed, v_proposed = interpolated[:k], interpolated[k:]
        v = v_proposed - ca.mtimes(ca.reshape(K, m, k), measurements.error - z_proposed)
        u = ca.SX.zeros(self.count)
        u[self.moved] = saturated(v, ca.DM(self.lowest), ca.DM(self.highest))
        return u


def tracking_rows(problem: FlightProblem, candidate: CandidateFlight, tick: float) -> np.ndarray:
    """Return the array `held` of the `TrackingPolicy` for a candidate, one row per tick.

    A last row contains the gain of the linear policy, which follows the candidate.

    tick: duration of a tick, s
    """
    seconds = float(candidate.lengths.sum())
    ticks = step_count(seconds, tick)
    z, v = candidate.at(tick / STEPS * np.arange(ticks * STEPS + 1))
    z_and_v = np.hstack([z[:, : len(problem.states)], v])
    # Numbers of the ends of the steps of each tick, of which the last is the first of the next one.
    knots = STEPS * np.arange(ticks)[:, None] + np.arange(STEPS + 1)
    begins = tick * np.arange(ticks)
    gains = tracking_gains(problem, candidate)
    # The gain of the interval in which a tick begins, its columns one after the other.
    interval = np.searchsorted(candidate.ends[1:], begins, side="right")
    K = gains[np.minimum(interval, len(gains) - 1)].transpose(0, 2, 1).reshape(ticks, -1)
    rows = np.hstack([begins[:, None], z_and_v[knots].reshape(ticks, -1), K])
    last = np.zeros(rows.shape[1])
    last[-K.shape[1] :] = problem.K.ravel(order="F")
    return np.vstack([rows, last])


def held_size(problem: FlightProblem) -> int:
    """Return the number of columns of the array that `tracking_rows` returns."""
    k, m = len(problem.states), len(problem.inputs)
    # Begin of the tick, (z*, v*) at both ends of each integration step, and the gain, (m, k).
    return 1 + (STEPS + 1) * (k + m) + m * k


def tracking_gains(problem: FlightProblem, candidate: CandidateFlight) -> np.ndarray:
    """Return the gains of the time-varying LQR along a candidate, (N, m, k).

    The final cost is z'Pz. In each interval, the equations are linearized at the middle of the
    interval.
    """
    from scipy.linalg import expm

    A, B = _slopes(problem, candidate)
    S = B @ np.linalg.solve(problem.R, B.transpose(0, 2, 1))
    # Rates of z and of its costate P z along the optimum: z' = A z - S P z, (P z)' = -Q z - A' P z.
    k = A.shape[1]
    hamiltonian = np.zeros((len(A), 2 * k, 2 * k))
    hamiltonian[:, :k, :k] = A
    hamiltonian[:, :k, k:] = -S
    hamiltonian[:, k:, :k] = -problem.Q
    hamiltonian[:, k:, k:] = -A.transpose(0, 2, 1)
    fastest = np.abs(np.linalg.eigvals(hamiltonian)).max(axis=1)
    steps = np.maximum(1, np.ceil(candidate.lengths * fastest / _LARGEST_EXPONENT)).astype(int)
    back = expm(-hamiltonian * (candidate.lengths / steps)[:, None, None])
    P = problem.P
    gains = np.empty((len(A), B.shape[2], k))
    for index in range(len(A) - 1, -1, -1):
        E = back[index]
        for _ in range(steps[index]):
            # (z; P z) before a step is E (z; P z) after it.
            P = np.linalg.solve((E[:k, :k] + E[:k, k:] @ P).T, (E[k:, :k] + E[k:, k:] @ P).T).T
            P = 0.5 * (P + P.T)
        gains[index] = np.linalg.solve(problem.R, B[index].T @ P)
    return gains


def _slopes(problem: FlightProblem, candidate: CandidateFlight) -> tuple[np.ndarray, np.ndarray]:
    """Return A, (N, k, k), and B, (N, k, m), at the middle of each interval."""
    nominal_states, nominal_inputs = problem.nominal
    z, v = candidate.at(candidate.ends[:-1] + 0.5 * candidate.lengths)
    middles = np.hstack([z / nominal_states, v / nominal_inputs])
    # One Jacobian (followed, followed + m) for each interval, beside the others.
    side_by_side = np.array(smooth_slopes(problem).map(len(middles))(middles.T))
    k, followed = len(problem.states), len(nominal_states)
    scaled = side_by_side.reshape(followed, len(middles), -1).transpose(1, 0, 2)
    slopes = scaled * nominal_states[:, None] / np.concatenate([nominal_states, nominal_inputs])
    return slopes[:, :k, :k], slopes[:, :k, followed:]


#: Largest integration step, s.
_LONGEST_STEP = 0.005
#: Typical number of ticks that are simulated for an initial condition and a policy, for the
#: decision on machine code: the search simulates candidates.
_TICKS_OF_A_SEARCH = 5000
#: Largest product of the integration step and the fastest mode of the linear loop.
_RESOLVED = 0.1
#: Number of time constants of the policy's slowest mode after which a flight has converged, and
#: longest flight that is extended for this reason, s.
_TIME_CONSTANTS = 6.0
_LONGEST_FLIGHT = 300.0
#: Linear cost after the first horizon, relative to the initial one.
_NEGLIGIBLE_TAIL = 3e-4
#: Step with which this time is searched, in time constants of the slowest mode, largest number of
#: steps, and factor of the first horizon on the time found.
_TAIL_STEP = 0.25
_TAIL_STEPS = 40
_LONGER_THAN_TAIL = 1.2
#: Duration of the linear policy after the horizon, relative to the horizon.
AFTER = 0.25


@dataclass(frozen=True, eq=False, kw_only=True)
class SimulatedFlight(FlightRow):
    """Row of a simulated flight with its time history.

    times: s, (N,)
    states: absolute states, (N, n)
    inputs: absolute inputs, (N, m)
    """

    times: np.ndarray
    states: np.ndarray
    inputs: np.ndarray

    def row(self, best: float | None) -> FlightRow:
        """Return the row of the flight without its history.

        best: cost of the best flight from the same initial condition, or None if none was found
        """
        kept = {field.name: getattr(self, field.name) for field in fields(FlightRow)}
        return FlightRow(**{**kept, "best": best})


@dataclass(frozen=True, eq=False)
class Flights:
    """Simulator of the flights of a problem.

    problem: aircraft, trim, weights and limits
    count: approximate number of flights. Machine code is used if the number is large.
    """

    problem: FlightProblem
    count: int = 1

    @cached_property
    def loop(self) -> np.ndarray:
        """State matrix A - B K of the linear closed loop."""
        linear = self.problem.linear
        return np.asarray(linear.A - linear.B @ self.problem.K)

    @cached_property
    def step(self) -> float:
        """Integration step, s, at most `_LONGEST_STEP`.

        The step resolves the fastest mode of the aircraft and of the linear loop.
        """
        matrices = (self.problem.linear.A, self.loop)
        modes = np.concatenate([np.linalg.eigvals(matrix) for matrix in matrices])
        return min(_LONGEST_STEP, _RESOLVED / float(np.abs(modes).max()))

    @cached_property
    def tick(self) -> float:
        """Duration of a tick, s: `STEPS` integration steps."""
        return STEPS * self.step

    def horizon(self, start: np.ndarray) -> float:
        """Return 1.2 times the time after which the linear loop's remaining cost is negligible, s.

        The result is at most 12 time constants of the slowest mode.

        start: initial deviations z, (k,)
        """
        from scipy.linalg import expm

        P = self.problem.P
        slowest = -spectral_abscissa(self.loop)
        step = _TAIL_STEP / slowest
        transition = expm(self.loop * step)
        negligible = _NEGLIGIBLE_TAIL * float(start @ P @ start)
        count, z = 1, transition @ start
        while z @ P @ z > negligible and count < _TAIL_STEPS:
            count, z = count + 1, transition @ z
        return _LONGER_THAN_TAIL * count * step

    @cached_property
    def _tracking(self) -> CompiledLoop:
        """Compiled loop of the policy that follows a candidate; `follow` gives it the candidate."""
        lowest, highest = self.problem.input_limits
        policy = TrackingPolicy(
            FOLLOWING,
            tick=self.tick,
            moved=self.problem.moved,
            count=len(self.problem.model.inputs),
            lowest=lowest,
            highest=highest,
            held=np.zeros((1, held_size(self.problem))),
        )
        return self.compiled(policy)

    @cached_property
    def linear_loop(self) -> CompiledLoop:
        """Compiled loop of the linear optimum, saturated at the limits of the inputs."""
        return self.of("linear optimum, saturated", self.problem.K)

    def of(self, name: str, given: Any) -> CompiledLoop:
        """Return the compiled loop of a policy, with its own sampling and delays.

        A gain or a critic is saturated at the limits of the inputs. It may move only the inputs of
        the problem; the others are constant.

        name: name of the policy in reports
        given: policy in any form that `hfa.fly` accepts
        """
        if isinstance(given, Critic) and not given.has_linear_policy:
            return self._of_function(name, given.policy)
        scenario = self.scenario(self.tick)
        policy, scenario = policy_and_scenario(given, self.problem.point, scenario)
        # A gain without a feedforward is a function of z alone, which is saturated here.
        is_gain = isinstance(policy, GainPolicy) and policy.feedforward is None
        if is_gain or isinstance(policy, ScheduledGainPolicy):
            z = ca.SX.sym("z", len(self.problem.states))
            u = command_of(policy, ca.SX(0.0), z, ca.DM(policy.held_inputs(0, 0.0)))
            return self._of_function(name, ca.Function("gain", [z], [u]))
        return self.compiled(replace(policy, name=name), scenario)

    def _of_function(self, name: str, function: ca.Function) -> CompiledLoop:
        """Return the compiled loop of a policy z (k,) -> inputs that move, (m,)."""
        problem = self.problem
        z = symbols_for([function], len(problem.states))
        u = type(z).zeros(len(problem.model.inputs))
        u[problem.moved] = function(z)
        lowest, highest = np.zeros((2, len(problem.model.inputs)))
        lowest[problem.moved], highest[problem.moved] = problem.input_limits
        policy = FunctionPolicy(name, ca.Function("policy", [z], [u]), lowest, highest)
        return self.compiled(policy)

    def compiled(self, policy: Policy, scenario: Scenario | None = None) -> CompiledLoop:
        """Return the compiled closed loop of a policy and the aircraft at the trim.

        scenario: scenario with the sampling and delays of the policy, or None for one without
            disturbance that is sampled at every `tick`
        """
        calm = scenario or self.scenario(self.tick)
        problem = self.problem
        R = np.zeros((len(problem.model.inputs),) * 2)
        R[np.ix_(problem.moved, problem.moved)] = problem.R
        plant = NonlinearPlant(problem.model, problem.point)
        loop = FlightLoop(plant, policy, calm, Cost(problem.Q, R))
        # The scenario here lasts one tick; flights are longer.
        return CompiledLoop(loop, flights=self.count * _TICKS_OF_A_SEARCH)

    def scenario(self, seconds: float) -> Scenario:
        """Return a scenario without disturbance. Its duration is `seconds`, rounded up to whole
        ticks.
        """
        ticks = step_count(seconds, self.tick)
        start = np.zeros(len(self.problem.model.states))
        return Scenario(ticks * self.tick, self.step, self.tick, initial=start)

    def follow(self, candidate: CandidateFlight, seconds: float) -> SimulatedFlight:
        """Return the simulated flight that follows a candidate, and then the linear policy.

        candidate: the proposed flight
        seconds: duration of the simulated flight, s
        """
        loop = self._tracking
        policy = replace(loop.loop.policy, held=tracking_rows(self.problem, candidate, self.tick))
        return self.fly(loop, candidate.start, seconds, policy)

    def linear(self, start: np.ndarray, seconds: float) -> SimulatedFlight:
        """Return the flight of the linear optimum, saturated at the limits of the inputs.

        start: initial deviations z, (k,)
        seconds: duration of the flight, s
        """
        return self.fly(self.linear_loop, start, seconds)

    def fly(
        self, loop: CompiledLoop, start: np.ndarray, seconds: float, policy: Policy | None = None
    ) -> SimulatedFlight:
        """Return the simulated flight of a closed loop from an initial condition.

        A flight inside that is not at the trim after `seconds` is repeated until the slowest mode
        of a sampled policy has decayed, at most for `_LONGEST_FLIGHT`. The simulation ends early if
        a state deviates by more than `FAR` nominal values.

        start: initial deviations z, (k,)
        seconds: duration of the flight, s, if it is then at the trim
        policy: policy of the loop with other tabulated inputs, or None for the loop's own policy
        """
        flight = self._flown(loop, start, seconds, policy)
        if flight.converges or flight.departure is not None:
            return flight
        longer = settling_time(policy or loop.loop.policy)
        return self._flown(loop, start, longer, policy) if longer > seconds else flight

    def _flown(
        self, loop: CompiledLoop, start: np.ndarray, seconds: float, policy: Policy | None
    ) -> SimulatedFlight:
        """Return the simulated flight of `fly`, with the given duration."""
        problem = self.problem
        initial = np.zeros(len(problem.model.states))
        initial[problem.places] = start
        scenario = loop.loop.scenario
        duration = scenario.tick * step_count(seconds, scenario.tick)
        scenario = replace(scenario, duration=duration, initial=initial)
        far = FAR * problem.model.nominal(problem.model.states)

        def diverges(states: np.ndarray) -> np.ndarray:
            near = np.abs(states - problem.point.x) <= far
            return np.asarray(~near.all(axis=1))  # a state that is not a number is not near

        # A flight that leaves the envelope is flown on until it diverges, if its modes are slow
        # enough there for the integration.
        with np.errstate(all="ignore"):
            try:
                rows = loop.fly(scenario, stop=diverges, policy=policy)
            except NoSolutionError:
                leaves = partial(outside, problem.envelope)
                rows = loop.fly(scenario, stop=leaves, policy=policy)
        return self.priced(loop.loop.policy, rows)

    def priced(self, policy: Policy, rows: Deviations) -> SimulatedFlight:
        """Return a simulated flight with its cost, first departure from the envelope and saturated
        inputs.

        The cost is inf if the flight left the envelope or has not returned (`has_returned`).

        policy: the simulated policy
        rows: deviations of the simulated states and inputs from the trim
        """
        problem = self.problem
        assert rows.cost is not None  # the loops of this class have a cost
        trim = problem.point.x
        z = rows.states[:, problem.places]
        inputs = rows.inputs + problem.point.u
        states = rows.states + trim
        first_departure = departure(problem.envelope, rows.times, states)
        with np.errstate(over="ignore", invalid="ignore"):  # the flight may diverge
            cost = float(rows.cost[-1]) + float(z[-1] @ problem.P @ z[-1])
        is_back = has_returned(problem.model, z, problem.P, float(rows.cost[-1]))
        if first_departure is not None or not is_back:
            cost = math.inf
        shares = share_at_limits(problem.model, inputs)
        return SimulatedFlight(
            policy=policy.name,
            cost=cost,
            departure=first_departure,
            saturated=tuple(name for name in problem.inputs if shares[name] > 0.0),
            seconds=float(rows.times[-1]),
            integration_error=rows.integration_error,
            times=rows.times,
            states=states,
            inputs=inputs,
        )


def settling_time(policy: Policy) -> float:
    """Return the time, s, in which the slowest mode of a sampled policy's loop decays.

    The time is at most `_LONGEST_FLIGHT`, and 0 if the loop is not sampled or not stable.
    """
    modes = policy.sampled_modes()
    if modes is None or not len(modes) or not (modes.real < 0.0).all():
        return 0.0
    return float(min(_LONGEST_FLIGHT, -_TIME_CONSTANTS / modes.real.max()))
