"""Monte Carlo of closed-loop flights: members in chunks, on workers, into a store."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from controller.flight.closed_loop import ClosedLoop
from controller.flight.envelope import limited_names
from controller.flight.integrator import COMPILE_FROM_STEPS
from controller.flight.scenario import Scenario, loop_of
from controller.flight.watched_loop import Summary, WatchedLoop
from controller.monte_carlo.monte_carlo_plan import MonteCarlo
from hfa_model.vectors import INPUT_UNITS, INPUTS, LINEAR_STATES, LINEAR_UNITS, NAMES_AND_UNITS, STATE_UNITS, STATES
from hfa_support.jobs.store import Array, Layout, Store, described
from hfa_support.jobs.stream import stream
from hfa_support.native.bound import cached_per_thread

SCHEMA = "hfa.monte-carlo-store/1"
#: Steps of a chunk: at 0.8 µs a step and more, half a second of work or more.
CHUNK_STEPS = 1_000_000

_NAN = float("nan")


@cached_per_thread(maxsize=4)
def member_loop(plan: MonteCarlo) -> WatchedLoop:
    """The loop of a plan, compiled at the first call in a thread."""
    scenario = plan.scenario
    return WatchedLoop(
        _loop(plan, plan.member(0)),
        plan.point,
        plan.envelope,
        step=scenario.step,
        steps_per_tick=scenario.steps_per_tick,
        stops=True,
        compile_code=plan.members * scenario.ticks * scenario.steps_per_tick >= COMPILE_FROM_STEPS,
    )


def fly_member(plan: MonteCarlo, member: int) -> tuple[Scenario, Summary]:
    """Draw and simulate one member."""
    scenario = plan.member(member)
    loop = _loop(plan, scenario)
    constants = loop.constants(plan.law.constants, plan.uncertain_plant.constants(plan.parameters_of(scenario)))
    start = loop.start(scenario.initial, plan.law.memory)
    return scenario, member_loop(plan).fly(start, constants, scenario.duration)


def _loop(plan: MonteCarlo, scenario: Scenario) -> ClosedLoop:
    return loop_of(plan.uncertain_plant, plan.law.policy, scenario, plan.point)


def fly_members(plan: MonteCarlo, start: int, stop: int) -> Mapping[str, np.ndarray]:
    """Members start .. stop - 1, stacked: their `Summary`, final states absolute, and the factors drawn.

    What a worker runs.
    """
    members = [fly_member(plan, member) for member in range(start, stop)]
    factors = [[scenario.errors[name] for name in plan.scenario.uncertainty.errors] for scenario, _ in members]
    rows = {name: np.array([getattr(summary, name) for _, summary in members]) for name in Summary._fields}
    return {"factors": np.array(factors), **rows, "final": rows["final"] + np.array(plan.point.states)}


@dataclass(frozen=True, eq=False)
class MonteCarloJob:
    """A plan as a job of `stream`."""

    plan: MonteCarlo

    @cached_property
    def layout(self) -> Layout:
        """One row a member: the fields of `Summary` and the factors drawn."""
        plan = self.plan
        errors, memory = tuple(plan.scenario.uncertainty.errors), len(plan.law.memory)

        def numbers(size: int, axis: str, meaning: str, units_of: str = "") -> Array:
            return Array((size,), "float64", _NAN, (axis,), described(meaning, units_of=units_of))

        def number(meaning: str, units: str) -> Array:
            return Array((), "float64", _NAN, (), described(meaning, units))

        n, seen = len(STATES), len(LINEAR_STATES)
        arrays = {
            "factors": numbers(len(errors), "error", "factor on a parameter"),
            "left": Array((), "int8", -1, (), described("number in the attribute left; -1: stayed inside")),
            "flown": number("time inside the envelope", "s"),
            "rms_error": numbers(seen, "error_state", "root mean square error", "error_state_unit"),
            "peak_error": numbers(seen, "error_state", "largest error", "error_state_unit"),
            "peak_angle_of_attack": number("largest angle of attack through the air, from trim", "rad"),
            "effort": numbers(len(INPUTS), "input", "root mean square from trim", "input_unit"),
            "final": numbers(n, "state", "at the end", "state_unit"),
            "memory": numbers(memory, "memory_state", "states of the law at the end"),
        }
        labels = {
            "error": ("error", errors),
            "error_state": ("error_state", LINEAR_STATES),
            "error_state_unit": ("error_state", LINEAR_UNITS),
            "state": ("state", STATES),
            "state_unit": ("state", STATE_UNITS),
            "input": ("input", INPUTS),
            "input_unit": ("input", INPUT_UNITS),
        }
        attributes = {
            "coordinates": "error_state_unit state_unit input_unit",
            "errors": list(errors),
            "left": list(limited_names(plan.scenario.moving_air)),
            "error_states": list(LINEAR_STATES),
            "error_units": list(LINEAR_UNITS),
            **NAMES_AND_UNITS,
        }
        steps = plan.scenario.ticks * plan.scenario.steps_per_tick
        chunk = -(-CHUNK_STEPS // steps)
        identity = plan.to_dict(), plan.identity
        return Layout(SCHEMA, "Monte Carlo", plan.members, "member", chunk, *identity, arrays, labels, attributes)

    @property
    def function(self) -> Callable[..., Mapping[str, np.ndarray]]:
        """What workers run."""
        return fly_members

    def task(self, start: int, stop: int) -> tuple[MonteCarlo, int, int]:
        """The plan and the numbers of the members."""
        return self.plan, start, stop


def stream_monte_carlo(plan: MonteCarlo, path: Path, **options: Any) -> Store:
    """Every member of the plan in the store at `path`; options of `hfa_support.jobs.stream.stream`."""
    return stream(MonteCarloJob(plan), path, **options)
