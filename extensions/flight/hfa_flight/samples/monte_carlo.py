"""Monte Carlo simulation of flights: the plan of random scenarios, and the results of each."""

from __future__ import annotations

import math
import threading
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property, lru_cache
from typing import Any

import casadi as ca
import numpy as np

from hfa_aircraft.limits import Limits
from hfa_aircraft.model import Model
from hfa_aircraft.uncertain import ParameterSpread
from hfa_flight.air.scenario import Scenario, Uncertainty, with_errors
from hfa_flight.air.sensors import at_trim, values_in_air
from hfa_flight.needs import ALL, refuse_share
from hfa_flight.policies.policy import Policy
from hfa_flight.simulate.closed_loop import FlightLoop, NonlinearPlant
from hfa_flight.simulate.envelope import refuse_start, share_at_limits
from hfa_flight.simulate.flight import Flight, fly_within
from hfa_flight.simulate.simulation import CompiledLoop
from hfa_support.errors import BadInputError, refuse_unless_whole
from hfa_support.native.bound import MAKING
from hfa_support.origin import Identified
from hfa_support.progress import Progress
from hfa_support.reporting.report import Reported
from hfa_support.rows.workers import open_workers
from trim.point.operating_point import OperatingPoint

#: Compiled loops of each thread. Threads must not share a loop, whose memory each call overwrites.
_THREAD = threading.local()


@dataclass(frozen=True, eq=False, repr=False)
class MonteCarlo(Identified, Reported):
    """Plan of N flights (members), each with its own draw of one scenario.

    Plans with the same results compare equal. A member depends only on the seed and its number, so
    members can be simulated in any order and on any machine.

    members: N
    seed: seed of all random quantities
    model: model with its nominal parameters
    point: trim in which each member begins
    policy: policy of all members
    scenario: scenario with the random quantities to be drawn
    envelope: limits of states and outputs. A flight ends at the first tick outside
    spread: distribution of the members' parameters, or None for the parameters of the model
    share: share of the members that must stay within their limits for a PASS, by default all

    Raises BadInputError if nothing is random, a number is wrong, the flight does not begin inside
    its envelope, a relative error is given for a parameter of value 0, a signal has no formula, or
    the random quantities are already drawn.
    """

    members: int
    seed: int
    model: Model
    point: OperatingPoint
    policy: Policy
    scenario: Scenario
    envelope: Limits
    spread: ParameterSpread | None = None
    share: float = field(default=ALL, compare=False)

    def __post_init__(self) -> None:
        """Raise BadInputError if the plan cannot be simulated."""
        refuse_unless_whole("members", self.members, 1)
        refuse_unless_whole("seed", self.seed, 0)
        refuse_share(self.share)
        if self.scenario.uncertainty == Uncertainty() and self.spread is None:
            raise BadInputError(
                "all flights are the same; give errors of parameters, noise or turbulence, or fly "
                "once"
            )
        object.__setattr__(self, "scenario", self.scenario.on(self.model))
        for name in ("reference", "disturbance"):
            signal = getattr(self.scenario, name)
            if signal is not None and not hasattr(signal, "to_dict"):
                raise BadInputError(
                    f"the {name} of a Monte Carlo simulation is not a Waveform; give a Waveform"
                )
        if self.scenario.samples is not None:
            raise BadInputError(
                "the random quantities of the scenario are already drawn; give the scenario "
                "without drawn()"
            )
        for name in self.scenario.uncertainty.errors:
            if self.model.parameters[name].start == 0.0:
                raise BadInputError(
                    f"{name} is 0, so a relative error has no effect; remove the error of {name}"
                )
        # refuses here what a worker could not simulate
        at = self.point.x + self.scenario.initial, self.point.u, self.model.p
        begin = ca.evalf(values_in_air(self.model, self.limits.names, at, {}))
        refuse_start(self.limits, begin.full().ravel())

    def member(self, number: int) -> Scenario:
        """Return the drawn scenario of one member, with turbulence at the trim speed."""
        return self.scenario.drawn(self.seed, number, self.point)

    def loop(self) -> FlightLoop:
        """Return the closed loop of the first member.

        The loops of other members have the same equations and differ in parameters and random
        values.
        """
        plant = NonlinearPlant(self.model, self.point, uncertain=True)
        return FlightLoop(plant, self.policy, self.member(0), envelope=self.envelope)

    @cached_property
    def limits(self) -> Limits:
        """The envelope, in moving air relative to it."""
        return self.loop().limits

    @cached_property
    def aircraft(self) -> list[Model]:
        """The drawn aircraft of each member, or an empty list if all members use `model`."""
        if self.spread is None:
            return []
        return self.spread.aircraft(self.model, self.members, self.seed)


def member_loop(plan: MonteCarlo) -> CompiledLoop:
    """Return the compiled closed loop of a plan, cached for each thread because its calls overwrite
    its memory.
    """
    if not hasattr(_THREAD, "loops"):
        _THREAD.loops = lru_cache(maxsize=4)(_compiled)
    loop: CompiledLoop = _THREAD.loops(plan)
    return loop


def _compiled(plan: MonteCarlo) -> CompiledLoop:
    """Return the compiled closed loop of a plan; threads compile one after the other."""
    with MAKING:
        return CompiledLoop(plan.loop(), plan.members)


def fly_member(plan: MonteCarlo, member: int) -> Flight:
    """Draw the member with this number and return its flight."""
    scenario = plan.member(member)
    aircraft = plan.aircraft[member] if plan.aircraft else plan.model
    parameters = with_errors(aircraft, scenario).p
    return fly_within(member_loop(plan), scenario, parameters)


def fly_members(plan: MonteCarlo, start: int, stop: int) -> Mapping[str, np.ndarray]:
    """Return the results of members `start` to `stop` - 1: name -> array, one row for each member.

    The names are those of `member_row`.
    """
    rows = [member_row(plan, fly_member(plan, member)) for member in range(start, stop)]
    return {name: np.array([row[name] for row in rows]) for name in rows[0]}


def member_row(plan: MonteCarlo, result: Flight) -> dict[str, Any]:
    """Return the results of one member's flight: name -> number or array.

    left, cycle: number, in the limited variables and in inputs and states, of the one that leaves
        or oscillates at the end; -1: none
    factors: on the parameters of --error, (E,)
    flown: time inside the envelope, s
    rms_error, effort: root mean squares of errors (k,) and inputs from the trim (m,) over that
        time, in turbulence over its second half, because it begins in calm
    peak_error, peak_deviation: largest ones from the trim, the latter of outputs with limits
    at_limit, lowest_input, highest_input: share of that time at a control limit, and range, (m,)
    final: states where it ends, (n,)
    """
    scenario = result.loop.scenario
    deviations = result.deviations
    states = list(plan.model.states)
    inputs_at_trim = plan.point.u
    end = len(deviations.times) - 1  # 0 if turbulence exceeds the envelope at the start
    # first row of the root mean squares
    begin = end // 2 if scenario.gust is not None and scenario.gust.rises else 0
    errors = deviations.errors[:end]
    inputs = deviations.inputs[:end]
    outputs = np.reshape([*result.outputs.values()], (-1, end + 1)).T[:end]
    away = outputs - at_trim(plan.point, (*result.outputs,))
    left = cycle = -1  # neither a departure nor a limit cycle
    if result.departure is not None:
        left = result.envelope.names.index(result.departure.state)
    if result.cycle is not None:
        cycle = [*plan.model.inputs, *states].index(result.cycle.name)
    return {
        "left": left,
        "cycle": cycle,
        "factors": [scenario.errors[name] for name in plan.scenario.uncertainty.errors],
        "flown": result.flown,
        "rms_error": _rms(errors[begin:]),
        "peak_error": np.abs(errors).max(axis=0, initial=0.0),
        "peak_deviation": np.abs(away).max(axis=0, initial=0.0),
        "effort": _rms(inputs[begin:]),
        "at_limit": list(share_at_limits(plan.model, inputs + inputs_at_trim).values()),
        "lowest_input": inputs.min(axis=0, initial=np.inf) + inputs_at_trim,
        "highest_input": inputs.max(axis=0, initial=-np.inf) + inputs_at_trim,
        "final": result.states[end],
    }


def _rms(rows: np.ndarray) -> np.ndarray:
    """Return the root mean square of each column of (N, k), (k,), which is 0 if N is 0."""
    return np.asarray(np.sqrt(np.square(rows).sum(axis=0) / max(len(rows), 1)))


#: Steps in a chunk. At 0.8 µs or more a step, a chunk takes at least half a second.
CHUNK_STEPS = 1_000_000
#: Overhead of a member, expressed in steps: 0.6 to 1.2 ms for drawing it and making its model.
MEMBER_STEPS = 1_000


def chunk_of(plan: MonteCarlo) -> int:
    """Return the number of flights of a Monte Carlo plan that one task simulates."""
    # the overhead of a member, as steps, and its steps
    steps = MEMBER_STEPS + plan.scenario.ticks * plan.scenario.steps_per_tick
    return min(math.ceil(CHUNK_STEPS / steps), plan.members)


def run_monte_carlo(
    plan: MonteCarlo, workers: int | str = 1, progress: Progress | None = None
) -> Mapping[str, np.ndarray]:
    """Return the results of all members: name -> array, one row for each member.

    The names are those of `member_row`.

    workers: as for `open_workers`. The number has no effect on the results
    progress: called with (chunks done, number of chunks), first at the start
    """
    size = chunk_of(plan)
    tasks = [
        (number, (plan, start, min(start + size, plan.members)))
        for number, start in enumerate(range(0, plan.members, size))
    ]
    chunks = {}
    if progress is not None:
        progress(0, len(tasks))  # the first chunk may take long because code is compiled
    with open_workers(workers) as run:
        for number, rows in run(fly_members, tasks):
            chunks[number] = rows
            if progress is not None:
                progress(len(chunks), len(tasks))
    in_order = [chunks[number] for number in sorted(chunks)]
    return {name: np.concatenate([rows[name] for rows in in_order]) for name in in_order[0]}
