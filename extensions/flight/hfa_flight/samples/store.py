"""Simulation of the members of a Monte Carlo plan, with results in memory or in a Zarr store."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from hfa_flight.air.names import limited_names
from hfa_flight.samples.monte_carlo import STORED, MonteCarlo, fly_members
from hfa_support.progress import Progress
from hfa_support.rows.store import RowJob, fill_store, template_variable
from hfa_support.rows.workers import open_workers

#: Steps in a chunk. At 0.8 µs or more a step, a chunk takes at least half a second.
CHUNK_STEPS = 1_000_000
#: Overhead of a member, expressed in steps: 0.6 to 1.2 ms for drawing it and making its model.
MEMBER_STEPS = 1_000
_MEMBER = "member"


def chunk_of(plan: MonteCarlo) -> int:
    """Return the number of flights of a Monte Carlo plan that one task simulates."""
    steps = MEMBER_STEPS + plan.scenario.ticks * plan.scenario.steps_per_tick
    return min(-(-CHUNK_STEPS // steps), plan.members)


def run_monte_carlo(
    plan: MonteCarlo, workers: int | str = 1, progress: Progress | None = None
) -> Mapping[str, np.ndarray]:
    """Return the results of all members: name -> array, one row for each member.

    The names are those in `STORED`. The results are kept in memory.

    workers: as for `open_workers`. The number has no effect on the results
    progress: called with (chunks done, number of chunks), first at the start
    """
    starts = range(0, plan.members, chunk_of(plan))
    ends = (*starts[1:], plan.members)
    tasks = [(number, (plan, *ends)) for number, ends in enumerate(zip(starts, ends, strict=True))]
    chunks = {}
    if progress is not None:
        progress(0, len(tasks))  # the first chunk may take long because code is compiled
    with open_workers(workers) as run:
        for number, rows in run(fly_members, tasks):
            chunks[number] = rows
            if progress is not None:
                progress(len(chunks), len(tasks))
    in_order = [chunks[number] for number in sorted(chunks)]
    return {name: np.concatenate([rows[name] for rows in in_order]) for name in STORED}


def stream_members(plan: MonteCarlo, path: Path, **options: Any) -> Any:
    """Simulate all members of a plan into the store at `path` and return it as `xarray.Dataset`.

    options: arguments of `fill_store`
    """

    def task(start: int, stop: int) -> tuple[MonteCarlo, int, int]:
        return plan, start, stop

    job = RowJob("Monte Carlo", _MEMBER, _template(plan), fly_members, task)
    return fill_store(job, path, **options)


def _template(plan: MonteCarlo) -> Any:
    """Return the `xarray.Dataset` of an empty store for the results of a plan."""
    model = plan.model
    errors = tuple(plan.scenario.uncertainty.errors)
    states = tuple(model.states)
    inputs = tuple(model.inputs)
    names = {"error": errors, "error_state": model.linear, "state": states, "input": inputs}
    lengths = {_MEMBER: plan.members} | {axis: len(signals) for axis, signals in names.items()}

    coordinates: dict[str, Any] = {}
    for axis, signals in names.items():
        if signals:
            coordinates[axis] = (axis, np.array(signals, dtype=object))
        if signals and axis != "error":  # factors have no unit
            units = np.array(model.units(signals), dtype=object)
            coordinates[f"{axis}_unit"] = (axis, units)

    arrays = {}
    for name, result in STORED.items():
        if result.axis and not names[result.axis]:
            continue  # no parameter is drawn
        fill: Any = np.int8(-1) if name in ("left", "cycle") else np.nan
        attributes = {"long_name": result.meaning}
        if result.unit:
            attributes["units"] = result.unit
        if f"{result.axis}_unit" in coordinates:
            attributes["units_of"] = f"{result.axis}_unit"
        axes = (_MEMBER, result.axis) if result.axis else (_MEMBER,)
        shape = tuple(lengths[axis] for axis in axes)
        arrays[name] = template_variable(axes, shape, fill, chunk_of(plan), attributes)

    import xarray

    about = {
        "schema": "hfa.monte-carlo-store/3",
        "errors": list(errors),
        "left": list(limited_names(model, plan.scenario.moving_air)),
        "error_states": list(model.linear),
        "error_units": list(model.units(model.linear)),
        "states": list(states),
        "state_units": list(model.units(states)),
        "inputs": list(inputs),
        "input_units": list(model.units(inputs)),
        "plan": plan.identity,
    }
    return xarray.Dataset(arrays, coordinates, about)
