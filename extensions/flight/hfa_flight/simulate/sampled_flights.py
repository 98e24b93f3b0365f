"""Simulation of many flights of a deployed policy, sampled and held as deployed.

The state of a flight is [X; memory; extremes]. The memory contains the commands
u_{k-1} ... u_{k-d-1} that act now or later. The extremes are the lowest and the highest X of the
integration steps of the last sample.

During a sample, [raw; trim; push; view] is held: the outputs of the network, the trim (X0; U0; p),
the rates added to those of the linear states, followed by the disturbances of the aircraft, and the
disturbances and errors with which sensors measure at the sample.
"""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from controller.critic.network.operations import RowNetwork
from hfa_aircraft.batch_simulation import History, Over, Stepper, is_within, simulate_batch
from hfa_flight.air.held_step import held_step, slices_of
from hfa_flight.air.sensors import (
    Errors,
    Sensor,
    drawn_errors,
    names_with_errors,
    values_in_air,
)
from hfa_flight.policies.deployment.deployed import Deployed
from hfa_support.native.bound import RowFunction
from hfa_support.native.row_code import row_code
from trim.linear.delays import Delay, in_samples, step_count

#: Number of samples from which on compilation to machine code is faster.
COMPILE_FROM = 50_000
#: Interval at which flights are checked, s.
WINDOW = 1.0
#: Largest number of stored values of the flights that one thread simulates together.
_MOST_STORED = 10_000_000


class Ticks:
    """Stepper of many flights by one compiled function, of which a tick is one step.

    after: (state, held) -> state at the end of the tick
    is_long: whether compilation to machine code saves time
    """

    steps = 1

    def __init__(self, after: ca.Function, step: float, *, is_long: bool) -> None:
        self.step = step
        self._after = row_code(after) if is_long else RowFunction(after)

    def __call__(self, state: np.ndarray, held: np.ndarray) -> np.ndarray:
        """Return the states at the end of the tick, (N, 1, n)."""
        (after,) = self._after(state, held)
        return after[:, None]


class SampledState(NamedTuple):
    """Parts of the state of a sampled flight, or their sizes or slices, in their order.

    X: absolute states of the aircraft, (n,)
    memory: last commands, the latest first, (m (whole samples of the delay + 1),). The last of
        them acts at the sample.
    extremes: lowest and highest X in the sample before, (2 n,)
    """

    X: Any
    memory: Any
    extremes: Any


class HeldInSample(NamedTuple):
    """Parts of what is held during a sample, or their sizes or slices, in their order.

    raw: outputs of the network, (r,)
    trim: (X0; U0; p)
    push: rates added to those of the linear states, then the disturbances
    view: disturbances at the sample, then errors of the sensors; empty without sensors
    """

    raw: Any
    trim: Any
    push: Any
    view: Any


@dataclass(frozen=True, eq=False)
class SampledFlight:
    """Aircraft of a deployment over a sample, as a function of the state and of what is held.

    The state of a flight is [X; memory; extremes]: the states of the aircraft, the last commands,
    the latest first, and the lowest and highest X in the sample before. Held are the parts of
    `HeldInSample`.

    deployed: the policy on its aircraft.
    dt, delay: sample time and delay, s.
    steps_per_sample: number of integration steps in a sample.
    commands_of: (raw, seen, U before, trim) -> U, or None for those of the deployment.
    winds: disturbances of the aircraft. They follow the push.
    sensors: what is measured -> `Sensor`. The policy sees the other states without errors.
    """

    deployed: Deployed
    dt: float
    delay: float
    steps_per_sample: int
    commands_of: ca.Function | None = None
    winds: tuple[str, ...] = ()
    sensors: Mapping[str, Sensor] = field(default_factory=dict)
    _compiled: dict[bool, CompiledSamples] = field(default_factory=dict, init=False)

    @property
    def delay_in_samples(self) -> Delay:
        """The delay in samples, after whose rest the later of two delayed commands acts."""
        return in_samples(self.delay, self.dt)

    @cached_property
    def sizes(self) -> SampledState:
        """Numbers of entries of the parts of the state."""
        model = self.deployed.model
        n = len(model.states)
        memory = len(model.inputs) * (self.delay_in_samples.whole + 1)
        return SampledState(X=n, memory=memory, extremes=2 * n)

    @cached_property
    def slices(self) -> SampledState:
        """Slices of the parts of the state."""
        return SampledState(*slices_of(self.sizes))

    @cached_property
    def held_sizes(self) -> HeldInSample:
        """Numbers of entries of the parts of what is held."""
        model = self.deployed.model
        trim = len(model.states) + len(model.inputs) + len(model.parameters)
        push = len(model.linear) + len(self.winds)
        view = len(self.winds) + len(names_with_errors(model, self.sensors)) if self.sensors else 0
        return HeldInSample(raw=len(self.deployed.commanded), trim=trim, push=push, view=view)

    @cached_property
    def sensing(self) -> Deployed:
        """The deployment that sees what the sensors measure."""
        return self.deployed.sensing(self.sensors)

    @cached_property
    def seen(self) -> ca.Function:
        """Function (X, U before, trim, view) -> states and outputs that the deployment sees."""
        model, sensed = self.deployed.model, self.sensing.sensed
        X, U, trim = self.deployed.symbols()
        view = ca.SX.sym("view", self.held_sizes.view)
        if not self.sensors:
            return ca.Function("seen", [X, U, trim, view], [X])
        at = X, U, trim[len(model.states) + len(model.inputs) :]
        winds = dict(zip(self.winds, ca.vertsplit(view), strict=False))
        seen = values_in_air(model, (*model.states, *sensed), at, winds)
        after_states = range(len(model.states), seen.numel())
        seen[[*model.state_places(model.linear), *after_states]] += view[len(winds) :]
        return ca.Function("seen", [X, U, trim, view], [ca.densify(seen)])

    def drawn_errors(self, seed: int, flights: int) -> list[Errors]:
        """Return the errors of the sensors in so many flights, or [] without sensors."""
        if not self.sensors:
            return []
        model = self.deployed.model
        return [drawn_errors(self.sensors, model, seed, flight) for flight in range(flights)]

    @cached_property
    def held_slices(self) -> HeldInSample:
        """Slices of the parts of what is held."""
        return HeldInSample(*slices_of(self.held_sizes))

    @cached_property
    def samples_in_window(self) -> int:
        """Number of samples in a window of `WINDOW` s, at least one."""
        return max(1, round(WINDOW / self.dt))

    def windows(self, seconds: float) -> int:
        """Return the number of whole windows in a time, at least one."""
        return max(1, round(seconds / (self.samples_in_window * self.dt)))

    def tick(self) -> ca.Function:
        """Return the function (state, held) -> state one sample later.

        The command that acts at the sample keeps acting for the rest of the delay, then the next.
        """
        model = self.deployed.model
        n, m = len(model.states), len(model.inputs)
        state, held = ca.MX.sym("state", sum(self.sizes)), ca.MX.sym("held", sum(self.held_sizes))
        X, memory, _ = (state[part] for part in self.slices)
        raw, trim, push, view = (held[part] for part in self.held_slices)
        before = memory[-m:]  # the oldest command acts now
        commands_of = (
            commands_of_network(self.sensing) if self.commands_of is None else self.commands_of
        )
        U = commands_of(raw, self.seen(X, before, trim, view), before, trim)
        p = trim[n + m :]
        whole, rest = self.delay_in_samples
        # After the rest of the delay acts the command of `whole` samples ago.
        acting = U if whole == 0 else memory[(whole - 1) * m : whole * m]
        step_late = self._step(self.dt - rest)
        if rest:
            between, extremes_early = self._step(rest)(X, before, push, p)
            after, extremes_late = step_late(between, acting, push, p)
            extremes = _extremes_of_both(extremes_early, extremes_late)
        else:
            after, extremes = step_late(X, acting, push, p)
        # The oldest command has acted; those of the whole samples of the delay remain.
        still_to_act, _ = ca.vertsplit(memory, [0, m * whole, m * (whole + 1)])
        later = ca.densify(ca.vertcat(after, U, still_to_act, extremes))
        return ca.Function("tick", [state, held], [later])

    def _step(self, seconds: float) -> ca.Function:
        """Return `held_step` over a part of a sample."""
        count = step_count(seconds, self.dt / self.steps_per_sample)
        return held_step(self.deployed.model, seconds, count, self.winds)

    def observing(self) -> ca.Function:
        """Return the function (state, held) -> observations."""
        state, held = ca.MX.sym("state", sum(self.sizes)), ca.MX.sym("held", sum(self.held_sizes))
        X, memory, _ = (state[part] for part in self.slices)
        _, trim, _, view = (held[part] for part in self.held_slices)
        acting = memory[-len(self.deployed.model.inputs) :]  # the oldest command acts now
        o = self.sensing.observe(self.seen(X, acting, trim, view), acting, trim)
        return ca.Function("observing", [state, held], [o])

    def entering(self) -> ca.Function:
        """Return the function (state, held) -> inputs of the policy's network."""
        observing = self.observing()
        state_and_held = observing.mx_in()
        _, network_inputs = self.deployed.normalized(observing(*state_and_held))
        return ca.Function("entering", state_and_held, [ca.densify(network_inputs)])

    def start(self, states: np.ndarray, trims: np.ndarray) -> np.ndarray:
        """Return the initial states [X; memory; extremes] of flights.

        The inputs have their trim values.

        states: X, (N, n)
        trims: (X0; U0; p) of each flight's trim
        """
        model = self.deployed.model
        n, m = len(model.states), len(model.inputs)
        trim_inputs = trims[:, n : n + m]
        memory = np.tile(trim_inputs, (1, self.delay_in_samples.whole + 1))
        return np.hstack([states, memory, states, states])

    def stays(self, states: np.ndarray, least: np.ndarray, most: np.ndarray) -> np.ndarray:
        """Return whether the extremes of samples are within limits (..., n), (...).

        A sample whose last states are not all finite is not within limits.
        """
        lowest, highest = self.extremes(states)
        is_finite = np.isfinite(states[..., self.slices.X]).all(axis=-1)
        return is_within(lowest, least, most) & is_within(highest, least, most) & is_finite

    def extremes(self, states: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the lowest and the highest X of a sample from states of flights, (..., n) each."""
        extremes = states[..., self.slices.extremes]
        n = self.sizes.X
        return extremes[..., :n], extremes[..., n:]

    def compiled(self, flights: int, seconds: float) -> CompiledSamples:
        """Return the policy and the aircraft, compiled if flights * seconds / dt >= `COMPILE_FROM`.

        Machine code that exists is used for any number of flights.

        flights: number of flights
        seconds: duration of a flight, s
        """
        is_long = flights * seconds / self.dt >= COMPILE_FROM or True in self._compiled
        if is_long not in self._compiled:
            on_rows = row_code if is_long else RowFunction
            actor = self.deployed.deployment.actor
            outputs = on_rows(actor.function)
            # Some actors have a version of their function for many rows.
            network = actor.rows or (lambda rows: outputs(rows)[0])
            stepper = Ticks(self.tick(), self.dt, is_long=is_long)
            entering = on_rows(self.entering())
            self._compiled[is_long] = CompiledSamples(self, entering, network, stepper)
        return self._compiled[is_long]


def commands_of_network(deployed: Deployed) -> ca.Function:
    """Return the function (outputs of the network, X, U before, trim) -> U of a deployment."""
    arguments = deployed.symbols()
    raw = ca.SX.sym("raw", len(deployed.commanded))
    U = deployed.inputs(deployed.action(raw), *arguments)
    return ca.Function("commands", [raw, *arguments], [ca.densify(U)])


@dataclass(frozen=True, eq=False)
class CompiledSamples:
    """Policy and aircraft for many flights.

    flight: layout of the states.
    entering: (states, held) -> inputs of the network.
    network: inputs (N, k) -> outputs (N, m).
    stepper: advances the flights by a sample.
    """

    flight: SampledFlight
    entering: Callable[..., list[np.ndarray]]
    network: RowNetwork
    stepper: Stepper

    def fly(
        self,
        states: np.ndarray,
        trims: np.ndarray,
        ticks: int,
        *,
        pushes: np.ndarray | None = None,
        pulse: float = 0.0,
        errors: Sequence[Errors] = (),
        over: Over | None = None,
        keep: bool = True,
    ) -> tuple[History, np.ndarray]:
        """Return the result of `simulate_batch` for flights of at most `ticks` samples.

        `over` decides after each window of `WINDOW` s which flights end. Without `keep`, the
        history has only the final states. The other arguments are those of `SampledRows`.
        """
        loop = SampledRows(self, states, trims, pushes, pulse, errors)
        window = self.flight.samples_in_window
        with np.errstate(all="ignore"):  # a flight may diverge
            return simulate_batch(loop, ticks, over=over, window=window, keep=keep)


class SampledRows:
    """Flights of a deployed policy as a loop of `simulate_batch`, of which a tick is a sample.

    samples: policy and aircraft
    states: initial states, (N, s)
    trims: (X0; U0; p) of each flight, (N, t)
    pushes: disturbance pulse of each flight, (N, p), or None
    pulse: duration of the disturbance pulse, s
    errors: those of the sensors of each flight, or () without sensors
    """

    def __init__(
        self,
        samples: CompiledSamples,
        states: np.ndarray,
        trims: np.ndarray,
        pushes: np.ndarray | None,
        pulse: float,
        errors: Sequence[Errors] = (),
    ) -> None:
        self.stepper: Stepper = samples.stepper
        self._samples = samples
        self._states = states
        self._trims = trims
        self._pushes = pushes
        self._calm_from = round(pulse / samples.flight.dt)
        self._errors = errors
        self._errors_in_window = np.zeros((0, 0, 0))
        self._flying = np.zeros(0, dtype=int)
        self._held = np.zeros((0, 0))

    def start(self) -> np.ndarray:
        """Return the initial states, (N, s)."""
        return self._states

    def hold(self, tick: int, state: np.ndarray, flying: np.ndarray) -> np.ndarray:
        """Return the outputs of the network at a sample, with the trim and the pulse, (F, h).

        Trim and pulse are written when flights have ended, and the pulse is removed at its end.
        """
        raw, trim, push, view = self._samples.flight.held_slices
        window = self._samples.flight.samples_in_window
        # `simulate_batch` passes the same array `flying` until a flight ends.
        if tick == 0 or flying is not self._flying:
            self._flying = flying
            self._held = np.zeros((len(flying), view.stop))
            self._held[:, trim] = self._trims[flying]
            if self._pushes is not None and tick < self._calm_from:
                self._held[:, push] = self._pushes[flying]
        if tick == self._calm_from:
            self._held[:, push] = 0.0
        if self._errors:
            if tick % window == 0:  # only then may flights have ended
                drawn = [self._errors[flight](window) for flight in flying]
                self._errors_in_window = np.stack(drawn, axis=1)
            self._held[:, view] = self._errors_in_window[tick % window]
        (entering,) = self._samples.entering(state, self._held)
        self._held[:, raw] = self._samples.network(entering)
        return self._held


def _extremes_of_both(early: ca.MX, late: ca.MX) -> ca.MX:
    """Return [lowest X; highest X] of two parts of a sample from those of each."""
    lowest_early, highest_early = ca.vertsplit_n(early, 2)
    lowest_late, highest_late = ca.vertsplit_n(late, 2)
    lowest = ca.fmin(lowest_early, lowest_late)
    return ca.vertcat(lowest, ca.fmax(highest_early, highest_late))


def in_threads(work: Callable[[np.ndarray], None], count: int, stored: int) -> None:
    """Call a function with disjoint sets of flights, in several threads if there are many.

    work: the function of the numbers of some flights
    count: number of flights
    stored: number of values that are stored for a flight
    """
    threads = max(1, min(os.cpu_count() or 1, count // 100))
    sets = max(threads, math.ceil(count * stored / _MOST_STORED))
    # Each set has flights of all trims, so that the sets take about as long.
    dealt = [np.arange(first, count, sets) for first in range(min(sets, max(count, 1)))]
    with ThreadPoolExecutor(threads) as pool:
        list(pool.map(work, dealt))  # raises what a thread raises
