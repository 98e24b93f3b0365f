"""A sweep that outgrows memory: its points in a Zarr store, under names and with units."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from hfa_stores.zarr_store import RowJob, array_of_rows, fill_store
from hfa_support.reporting.report import Report
from hfa_support.reporting.results import Result
from hfa_support.reporting.text import Table
from trim.sweeps.points import STATUS, is_square
from trim.sweeps.sweep import run_points, slow_note
from trim.sweeps.sweep_arrays import ARRAYS, labels_of
from trim.sweeps.sweep_plan import SweepPlan

#: Points of a chunk: half a second of work or more, about 90 MB of results.
CHUNK = 100_000
#: The same where each point is trimmed on its own: seconds of work.
SLOW_CHUNK = 1_000
#: Value of `status` at a point that is not computed yet.
MISSING = -1
_POINT = "point"


@dataclass(frozen=True, kw_only=True, eq=False)
class StoredSweepData(Result):
    """What a store holds.

    store: where it is.
    dynamics: published or newton, or the name of another model.
    variables: what is varied.
    variable_units: unit of each.
    grid: variable -> its unit and its values, listed, or start, step and count.
    condition: what else the trim imposes.
    points: number of points.
    counts: points by status, "missing" for those not computed yet.
    warnings: what to know before trusting the result."""

    schema = "hfa.sweep-summary/1"
    made_by = "hfa sweep -o FILE.zarr"

    store: str
    dynamics: str
    variables: Sequence[str]
    variable_units: Sequence[str]
    grid: Mapping[str, Any]
    condition: Mapping[str, Any]
    points: int
    counts: Mapping[str, int]
    warnings: Sequence[str]


def stream_sweep(plan: SweepPlan, path: Path, **options: Any) -> Any:
    """Every point of the plan in the store at `path`, as `xarray.Dataset`; options of
    `fill_store`."""
    job = RowJob("sweep", _POINT, _template(plan), run_points, plan.task)
    return fill_store(job, path, **options)


def reported_sweep(plan: SweepPlan, path: Path, **options: Any) -> Report:
    """The report on `stream_sweep`, the part "sweep.zarr" of `hfa sweep`."""
    return stored_sweep_report(plan, stream_sweep(plan, path, **options), path)


def _template(plan: SweepPlan) -> Any:
    """The `xarray.Dataset` of a store that holds nothing yet."""
    model = plan.model
    states = tuple(model.states)
    inputs = tuple(model.inputs)
    chunk = CHUNK if is_square(model, plan.variables, plan.condition) else SLOW_CHUNK
    chunk = min(chunk, plan.count)
    sizes = {"state": len(states), "rate": len(states), "mode": len(states), "input": len(inputs)}

    arrays = {}
    for name, array in ARRAYS.items():
        shape = (plan.count, *(sizes[axis] for axis in array.axes))
        fill = complex(np.nan, np.nan) if name == "eigenvalues" else np.nan
        axes = (_POINT, *array.axes)
        if 0 not in shape:  # a model without inputs has no B
            arrays[name] = array_of_rows(axes, shape, fill, chunk, array.attributes)
    status = {
        "long_name": "how the trim came out",
        "flag_values": list(range(len(STATUS))),
        "flag_meanings": " ".join(word.replace(" ", "_") for word in STATUS),
    }
    kinks = {"long_name": "entries of A and B at a kink, -1 where not looked for"}
    slow = {"long_name": "1 where the point was trimmed on its own, a thousand times slower"}
    fill_status = np.int8(MISSING)
    arrays["status"] = array_of_rows((_POINT,), (plan.count,), fill_status, chunk, status)
    arrays["kinks"] = array_of_rows((_POINT,), (plan.count,), np.int16(-1), chunk, kinks)
    arrays["one_by_one"] = array_of_rows((_POINT,), (plan.count,), np.int8(0), chunk, slow)

    coordinates: dict[str, Any] = dict(labels_of(model, rates=states))
    for name, unit in zip(plan.variables, plan.units, strict=True):
        varied = {"long_name": "what is varied", "units": unit}
        coordinates[name] = array_of_rows((_POINT,), (plan.count,), np.nan, chunk, varied)
    attributes = {
        "schema": "hfa.sweep-store/3",
        **plan.varied,
        "states": list(states),
        "state_units": list(model.units(states)),
        "inputs": list(inputs),
        "input_units": list(model.units(inputs)),
        "status": [str(word) for word in STATUS],
        "warnings": plan.warnings,
        "plan": plan.text,
    }

    import xarray

    return xarray.Dataset(arrays, coordinates, attributes)


def stored_sweep_report(plan: SweepPlan, dataset: Any, path: Path) -> Report:
    """Points by status, "missing" for those not computed yet; how many lie at a kink.

    dataset: what `stream_sweep` returned for the plan, from the store at `path`.
    """
    totals = np.zeros(len(STATUS) + 1, dtype=int)
    kinks = 0
    one_by_one = 0
    for start in range(0, plan.count, CHUNK):
        part = dataset.isel({_POINT: slice(start, start + CHUNK)})
        totals += np.bincount(part.status.values - MISSING, minlength=len(totals))
        kinks += int(np.count_nonzero(part.kinks.values > 0))
        one_by_one += int(np.count_nonzero(part.one_by_one.values))
    notes = [*plan.warnings, *slow_note(one_by_one, plan.count)]
    if kinks:
        notes.append(
            f"kinks at {kinks} points: entries of A and B there are means of two slopes (the array "
            "kinks counts them)"
        )
    counts = dict(zip(("missing", *STATUS), totals.tolist(), strict=True))
    rows = [(status, str(count)) for status, count in counts.items()]
    data = StoredSweepData(
        store=str(path),
        dynamics=plan.model.name,
        **plan.varied,
        points=plan.count,
        counts=counts,
        warnings=notes,
    )
    return Report(
        title=f"Sweep over {', '.join(plan.variables)}, {plan.model.title}, in {path}",
        parts=(Table(("status", "points"), rows),),
        notes=notes,
        data=data.to_dict(),
    )
