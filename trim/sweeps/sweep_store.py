"""A sweep that outgrows memory: its points in a store, under names and with units."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from hfa_support.jobs.store import Array, Layout, Store, Task, described, stream
from hfa_support.reporting.report import Report
from hfa_support.reporting.text import Table
from trim.sweeps.points import STATUS, is_square
from trim.sweeps.sweep import run_points
from trim.sweeps.sweep_plan import SweepPlan

#: Points of a chunk: half a second of work or more, about 90 MB of results.
CHUNK = 100_000
#: The same where each point is trimmed on its own: seconds of work.
SLOW_CHUNK = 1_000
_NAN = float("nan")


def arrays_of(plan: SweepPlan) -> dict[str, Array]:
    """What `run_points` makes of a plan: one row a point."""
    sizes = {
        "variable": len(plan.variables),
        "state": len(plan.model.states),
        "input": len(plan.model.inputs),
    }
    sizes |= {"rate": sizes["state"]}

    def numbers(meaning: str, units: str, *axes: str) -> Array:
        about = described(meaning, **{"units_of" if axes else "units": units})
        return Array(tuple(map(sizes.__getitem__, axes)), "float64", _NAN, axes, about)

    words = " ".join(each.replace(" ", "_") for each in STATUS)  # by the CF conventions
    flags = {"flag_values": list(range(len(STATUS))), "flag_meanings": words}
    status = described("how the trim came out") | flags
    poles = described("of A, fastest first", "1/s")
    kinks = described("entries of A and B whose one-sided slopes differ, -1 where not looked for")
    varied = zip(plan.variables, plan.units, strict=True)
    return {name: numbers("what is varied", unit) for name, unit in varied} | {
        "values": numbers("what is varied", "variable_unit", "variable"),
        "status": Array((), "int8", -1, (), status),
        "states": numbers("X0", "state_unit", "state"),
        "inputs": numbers("U0", "input_unit", "input"),
        "A": numbers("dx'/dx", "rate_unit / state_unit", "rate", "state"),
        "B": numbers("dx'/du", "rate_unit / input_unit", "rate", "input"),
        "eigenvalues": Array(
            (sizes["state"],), "complex128", complex(_NAN, _NAN), ("mode",), poles
        ),
        "kinks": Array((), "int16", -1, (), kinks),
    }


@dataclass(frozen=True, eq=False)
class SweepJob:
    """A plan as a job of `stream`."""

    plan: SweepPlan

    @cached_property
    def layout(self) -> Layout:
        """The arrays of `arrays_of`, the names on their axes and the units of these."""
        plan, model = self.plan, self.plan.model
        states, inputs = tuple(model.states), tuple(model.inputs)
        named = {
            "variable": (plan.variables, plan.units),
            "state": (states, model.units(states)),
            "rate": (states, tuple(map(model.rate_unit, states))),
            "input": (inputs, model.units(inputs)),
        }
        labels = {axis: (axis, names) for axis, (names, _) in named.items()}
        labels |= {f"{axis}_unit": (axis, units) for axis, (_, units) in named.items()}
        attributes = {
            "coordinates": " ".join((*plan.variables, *(f"{axis}_unit" for axis in named))),
            **plan.varied,
            **{"states": list(states), "state_units": list(model.units(states))},
            **{"inputs": list(inputs), "input_units": list(model.units(inputs))},
            **{"status": list(STATUS), "warnings": plan.warnings},
        }
        chunk = CHUNK if is_square(model, plan.variables, plan.condition) else SLOW_CHUNK
        data = plan.to_dict(), arrays_of(plan), labels, attributes
        return Layout("hfa.sweep-store/1", "sweep", plan.count, "point", chunk, *data)

    @property
    def function(self) -> Callable[..., Mapping[str, np.ndarray]]:
        """What workers run."""
        return run_points

    def task(self, start: int, stop: int) -> Task:
        """Its arguments for some rows."""
        return self.plan.task(start, stop)


def stream_sweep(plan: SweepPlan, path: Path, **options: Any) -> Store:
    """Every point of the plan in the store at `path`; options of `stream`."""
    return stream(SweepJob(plan), path, **options)


def stored_sweep_report(plan: SweepPlan, store: Store, path: Path) -> Report:
    """Points by status, "missing" for those not computed yet; how many lie at a kink."""
    totals, kinks, notes = np.zeros(len(STATUS) + 1, dtype=int), 0, plan.warnings
    for start in range(0, plan.count, store.chunk):
        rows = slice(start, start + store.chunk)
        totals += np.bincount(store.read("status", rows) + 1, minlength=len(totals))
        kinks += int(np.count_nonzero(store.read("kinks", rows) > 0))
    if kinks:
        notes.append(
            f"kinks at {kinks} points: one-sided slopes differ from A or B (the array kinks counts entries)"
        )
    counts = dict(zip(("missing", *STATUS), totals.tolist(), strict=True))
    data = {
        "schema": "hfa.sweep-summary/1",
        "store": str(path),
        "dynamics": plan.model.name,
        **plan.varied,
    }
    return Report(
        title=f"Sweep over {', '.join(plan.variables)}, {plan.model.title}, in {path}",
        parts=(
            Table(("status", "points"), [(status, str(count)) for status, count in counts.items()]),
        ),
        notes=notes,
        data=data | {"points": plan.count, "counts": counts, "warnings": notes},
    )
