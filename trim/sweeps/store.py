"""Sweeps in a Zarr store, for results that exceed memory."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from hfa_aircraft.model import Model
from hfa_aircraft.signals import StatesAndInputs
from hfa_support.reporting.report import Report, Reported
from hfa_support.reporting.results import Result, storable
from hfa_support.reporting.text import Table
from hfa_support.rows.store import RowJob, fill_store, template_variable
from trim.linear.modes import fastest_first
from trim.point.condition import TrimCondition
from trim.point.margins import stalled
from trim.point.operating_point import OperatingPoint
from trim.point.system import TrimSystem, parameters_at
from trim.sweeps.points import CHUNK, STATUS, TRIMMED
from trim.sweeps.result import slow_note, trimmed_words
from trim.sweeps.sweep import run_points
from trim.sweeps.sweep_plan import SweepPlan, arrays_of, at_limit, coordinates_of, limited

#: Number of points in a chunk if each point is trimmed separately: seconds of work.
SLOW_CHUNK = 1_000
#: Value of `status` for a point that is not computed yet.
MISSING = -1
_POINT = "point"


@dataclass(frozen=True, eq=False)
class SweepAttributes(StatesAndInputs, Result):
    """Attributes of the store of a sweep.

    plan: the swept variables and values.
    """

    schema = "hfa.sweep-store/4"

    plan: SweepPlan

    @property
    def model(self) -> Model:
        """The aircraft of the sweep."""
        return self.plan.model

    @property
    def status(self) -> tuple[str, ...]:
        """Meanings of the numbers 0, 1, ... in the array `status`."""
        return tuple(map(str, STATUS))

    def _entries(self) -> dict[str, Any]:
        """Return the attributes of the store, name -> value."""
        return {
            **self.plan.entries(),
            "warnings": self.plan.warnings,
            "plan": self.plan.fingerprint,
            "states": self.state_names,
            "state_units": self.state_units,
            "inputs": self.input_names,
            "input_units": self.input_units,
            "status": self.status,
        }


@dataclass(frozen=True, eq=False, repr=False)
class StoredSweep(Result, Reported):
    """Summary of the store of a sweep.

    plan: the swept variables and values.
    store: path of the store.
    counts: status -> number of points; "missing" counts points that are not computed yet.
    warnings: limits of the result.
    stalled: number of trimmed points beyond the largest lift.
    """

    schema = "hfa.sweep-summary/1"

    plan: SweepPlan
    store: str
    counts: Mapping[str, int]
    warnings: Sequence[str]
    stalled: int = 0

    def _entries(self) -> dict[str, Any]:
        """Return the entries of the file, name -> value."""
        return {
            "dynamics": self.plan.model.name,
            **self.plan.entries(),
            "points": self.plan.count,
            "store": self.store,
            "counts": self.counts,
            "warnings": self.warnings,
        } | ({"stalled": self.stalled} if self.stalled else {})

    def report(self) -> Report:
        """Return the report with the number of points of each status."""
        rows = [(status, str(count)) for status, count in self.counts.items()]
        return Report(
            title=f"Sweep over {', '.join(self.plan.variables)}, {self.plan.model.title}: "
            f"{trimmed_words(self.counts['trimmed'], self.stalled, self.plan.count)}, "
            f"in {self.store}",
            parts=(Table(("status", "points"), rows),),
            notes=self.warnings,
            data=storable(self),
        )


def _stored_points(
    model: Model,
    variables: tuple[str, ...],
    values: np.ndarray,
    condition: TrimCondition,
    start: OperatingPoint | None,
) -> dict[str, Any]:
    """Return the results of `run_points`, with eigenvalues, limits reached and stalls."""
    rows = run_points(model, variables, values, condition, start)
    trimmed = rows["status"] == TRIMMED  # other points may have states, from beyond their limits
    eigenvalues = np.full(rows["A"].shape[:2], complex(np.nan, np.nan))
    eigenvalues[trimmed] = fastest_first(np.linalg.eigvals(rows["A"][trimmed]))
    reached = at_limit(condition, rows["states"], rows["inputs"])
    columns = dict(zip(variables, values.T, strict=True))
    parameters = parameters_at(model, len(values), columns)
    stalls = stalled(model, rows["states"], rows["inputs"], parameters) & trimmed
    return rows | {
        "eigenvalues": eigenvalues,
        "at_limit": reached * trimmed[:, None],
        "stalled": stalls.astype(np.int8),
    }


def reported_sweep(plan: SweepPlan, path: Path, **options: Any) -> Report:
    """Compute a sweep in a store and return its report.

    options: keyword arguments of `fill_store`
    """
    job = RowJob(
        what="sweep",
        row=_POINT,
        template=_template(plan),
        function=_stored_points,
        arguments=plan.task,
    )
    return stored_sweep(plan, fill_store(job, path, **options), path).report()


def _template(plan: SweepPlan) -> Any:
    """Return the `xarray.Dataset` of an empty store."""
    model = plan.model
    states = tuple(model.states)
    inputs = tuple(model.inputs)
    system = TrimSystem(model, plan.condition.freed_for(plan.variables), plan.variables)
    # Newton's method solves many points at once if there are as many equations as unknowns.
    chunk = CHUNK if system.equations.square else SLOW_CHUNK
    chunk = min(chunk, plan.count)
    sizes = dict.fromkeys(("linear_state", "rate", "mode"), len(model.linear))
    sizes |= {"state": len(states), "input": len(inputs)}
    sizes["limited"] = len(limited(plan.condition))

    arrays = {}
    for name, array in arrays_of(model).items():
        shape = (plan.count, *(sizes[axis] for axis in array.axes))
        axes = (_POINT, *array.axes)
        if 0 not in shape:  # a model without inputs has no B
            arrays[name] = template_variable(axes, shape, array.fill, chunk, array.attributes)
    status = {
        "long_name": "outcome of the trim",
        "flag_values": list(range(len(STATUS))),
        "flag_meanings": " ".join(word.replace(" ", "_") for word in STATUS),
    }
    nonsmooth = {"long_name": "entries of A and B at a nonsmooth point"}
    one_by_one = {
        "long_name": "1 where the point was trimmed separately, which is a thousand times slower"
    }
    fill_status = np.int8(MISSING)
    arrays["status"] = template_variable((_POINT,), (plan.count,), fill_status, chunk, status)
    arrays["nonsmooth_points"] = template_variable(
        (_POINT,), (plan.count,), np.int16(-1), chunk, nonsmooth
    )
    arrays["one_by_one"] = template_variable(
        (_POINT,), (plan.count,), np.int8(0), chunk, one_by_one
    )

    coordinates: dict[str, Any] = dict(coordinates_of(plan.condition))
    for name, unit in zip(plan.variables, plan.units, strict=True):
        varied = {"long_name": "what is varied", "units": unit}
        coordinates[name] = template_variable((_POINT,), (plan.count,), np.nan, chunk, varied)
    import xarray

    return xarray.Dataset(arrays, coordinates, storable(SweepAttributes(plan)))


def stored_sweep(plan: SweepPlan, dataset: Any, path: Path) -> StoredSweep:
    """Return the summary of a store: points by status, and warnings.

    dataset: the store at `path`, from `fill_store`
    """
    totals = np.zeros(len(STATUS) + 1, dtype=int)
    changed_points = 0
    one_by_one = 0
    stalls = 0
    for start in range(0, plan.count, CHUNK):
        part = dataset.isel({_POINT: slice(start, start + CHUNK)})
        # The first total is that of MISSING, the lowest status.
        totals += np.bincount(part.status.values - MISSING, minlength=len(totals))
        changed_points += int(np.count_nonzero(part.nonsmooth_points.values > 0))
        one_by_one += int(np.count_nonzero(part.one_by_one.values))
        stalls += int(np.count_nonzero(part.stalled.values))
    notes = [*plan.warnings, *slow_note(one_by_one, plan.count)]
    if changed_points:
        notes.append(
            f"nonsmooth points at {changed_points} points: entries of A and B are means (array "
            "nonsmooth_points contains their numbers)"
        )
    counts = dict(zip(("missing", *STATUS), totals.tolist(), strict=True))
    return StoredSweep(plan, str(path), counts, notes, stalls)
