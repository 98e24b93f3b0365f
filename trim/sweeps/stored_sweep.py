"""A sweep of any size in a store: what its columns are, and what it says in short."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from hfa_model.aircraft import Aircraft
from hfa_support.jobs.store import Array, Layout, Store, described
from hfa_support.jobs.stream import stream
from hfa_support.jobs.workers import Task
from hfa_support.model import Model
from hfa_support.reporting.report import Report
from hfa_support.reporting.text import Table
from trim.point.condition import TrimCondition
from trim.point.operating_point import OperatingPoint
from trim.sweeps.points import COMPILE_FROM, STATUS, is_square, trim_points
from trim.sweeps.sweep_plan import SweepPlan, plan_warnings

SCHEMA = "hfa.sweep-store/1"
#: Points of a chunk: half a second of work or more, about 90 MB of results.
CHUNK = 100_000
#: The same where each point is trimmed on its own: seconds of work.
SLOW_CHUNK = 1_000

_NAN = float("nan")
SUMMARY_SCHEMA = "hfa.sweep-summary/1"


@dataclass(frozen=True, eq=False)
class SweepJob:
    """A plan as a job of `stream`."""

    plan: SweepPlan

    @cached_property
    def layout(self) -> Layout:
        """One row a point: its values of what varies, the arrays of its `Points`, its eigenvalues."""
        plan, model = self.plan, self.plan.aircraft.model
        states, inputs = tuple(model.states), tuple(model.inputs)
        state_units, input_units = model.units(states), model.units(inputs)
        named = {"states": list(states), "state_units": list(state_units)}
        named |= {"inputs": list(inputs), "input_units": list(input_units)}
        varied = zip(plan.variables, plan.units, strict=True)
        arrays = {name: _numbers((), described("what is varied", unit)) for name, unit in varied} | {
            "values": _numbers(("variable",), described("what is varied", units_of="variable_unit"), plan.variables),
            "status": Array((), "int8", -1, (), _coded("how the trim came out", STATUS)),
            "limiting": Array((), "int8", -1, (), _coded("what lies beyond its limit", states + inputs)),
            "states": _numbers(("state",), described("X0", units_of="state_unit"), states),
            "inputs": _numbers(("input",), described("U0", units_of="input_unit"), inputs),
            "A": _numbers(("rate", "state"), described("dx'/dx", units_of="rate_unit / state_unit"), states, states),
            "B": _numbers(("rate", "input"), described("dx'/du", units_of="rate_unit / input_unit"), states, inputs),
            "eigenvalues": Array(
                (len(states),), "complex128", complex(_NAN, _NAN), ("mode",), described("of A, fastest first", "1/s")
            ),
        }
        labels = {
            "variable": ("variable", plan.variables),
            "variable_unit": ("variable", plan.units),
            "state": ("state", states),
            "state_unit": ("state", state_units),
            "rate": ("rate", states),
            "rate_unit": ("rate", tuple(map(model.rate_unit, states))),
            "input": ("input", inputs),
            "input_unit": ("input", input_units),
        }
        attributes = {
            "coordinates": " ".join((*plan.variables, *(name for name in labels if name.endswith("_unit")))),
            **plan.varied,
            **named,
            "status": list(STATUS),
            "limiting": list(states + inputs),
            "warnings": plan_warnings(plan),
        }
        chunk = CHUNK if is_square(model, plan.variables, plan.condition) else SLOW_CHUNK
        identity = plan.to_dict(), plan.identity
        return Layout(SCHEMA, "sweep", plan.count, "point", chunk, *identity, arrays, labels, attributes)

    @property
    def function(self) -> Callable[..., Mapping[str, np.ndarray]]:
        """What workers run."""
        return run_points

    def task(self, start: int, stop: int) -> Task:
        """Values of the points, not the plan: a worker would make the whole of a Latin hypercube for its part."""
        plan = self.plan
        compiled = plan.count >= COMPILE_FROM
        values = plan.values(start, stop)
        return plan.aircraft, plan.variables, values, plan.condition, plan.start, compiled


def run_points(
    aircraft: Aircraft | Model,
    variables: tuple[str, ...],
    values: np.ndarray,
    condition: TrimCondition,
    start: OperatingPoint | None,
    compile_code: bool,
) -> Mapping[str, np.ndarray]:
    """The points of a task, by name of the array in the store: its `Points`, the values that it was given, and the
    eigenvalues of A (N, n), fastest first, 1/s. What a worker runs."""
    points = trim_points(aircraft, variables, values, condition, start=start, compile_code=compile_code)
    rows = points._asdict() | {"values": values, "eigenvalues": _eigenvalues(points.A)}
    rows |= {name: values[:, column] for column, name in enumerate(variables)}
    del rows["failures"]  # words have no place in an array
    return rows


def _numbers(axes: tuple[str, ...], about: Mapping[str, Any], *names: Sequence[str]) -> Array:
    """An array of numbers whose axes have these names."""
    return Array(tuple(map(len, names)), "float64", _NAN, axes, about)


def _coded(what: str, words: Sequence[str]) -> dict[str, Any]:
    """Attributes of an array of numbers that encode words, by the CF conventions."""
    meanings = " ".join(word.replace(" ", "_") for word in words)
    return described(what) | {"flag_values": list(range(len(words))), "flag_meanings": meanings}


def _eigenvalues(A: np.ndarray) -> np.ndarray:
    """(N, n), fastest first, positive imaginary part first; nan where A is."""
    known = ~np.isnan(A[:, 0, 0])
    found = np.full(A.shape[:2], np.nan, dtype=complex)
    found[known] = np.linalg.eigvals(A[known])
    return np.take_along_axis(found, np.lexsort((-found.imag, -np.round(np.abs(found), 9))), axis=1)


def stream_sweep(plan: SweepPlan, path: Path, **options: Any) -> Store:
    """Every point of the plan in the store at `path`; options of `stream`."""
    return stream(SweepJob(plan), path, **options)


def status_counts(store: Store, points: int) -> dict[str, int]:
    """Status -> number of points of a sweep's store, and "missing" for those not computed yet."""
    totals = np.zeros(len(STATUS) + 1, dtype=int)
    for start in range(0, points, store.chunk):
        totals += np.bincount(store.read("status", slice(start, start + store.chunk)) + 1, minlength=len(totals))
    return dict(zip(("missing", *STATUS), totals.tolist(), strict=True))


def stored_sweep_report(plan: SweepPlan, store: Store, path: Path) -> Report:
    """Points by status, and where they are."""
    counts, notes = status_counts(store, plan.count), plan_warnings(plan)
    return Report(
        title=f"Sweep over {', '.join(plan.variables)}, {plan.aircraft.model.title}, in {path}",
        parts=(Table(("status", "points"), [(status, str(count)) for status, count in counts.items()]),),
        notes=notes,
        data={
            "schema": SUMMARY_SCHEMA,
            "store": str(path),
            "dynamics": plan.dynamics_name,
            **plan.varied,
            "points": plan.count,
            "counts": counts,
            "warnings": notes,
        },
    )
