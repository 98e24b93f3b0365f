"""Trims and linear models over many points: one function makes the named arrays of a sweep in memory or in a store."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from hfa_model.aircraft import Aircraft
from hfa_support.errors import BadInputError
from hfa_support.jobs.store import Array, Layout, Store, Task, described, stream
from hfa_support.model import Model
from hfa_support.progress import Progress
from hfa_support.reporting.fields import ByValue
from hfa_support.reporting.report import Picture, Report, Reported
from hfa_support.reporting.text import RowsMade, Table, eigenvalue_text, shown_unit, shown_value
from trim.linear.kinks import kinks_in
from trim.linear.modes import fastest_first, modes_of, track_modes
from trim.point.condition import TrimCondition
from trim.point.operating_point import OperatingPoint, Status
from trim.point.solve import beyond_limits
from trim.sweeps.points import (
    BEYOND_LIMITS,
    COMPILE_FROM,
    STATUS,
    TRIMMED,
    condition_at,
    is_square,
    model_at,
    parameters_at,
    trim_points,
)
from trim.sweeps.root_locus import RootLocus
from trim.sweeps.sweep_plan import SweepPlan

SCHEMA, STORE_SCHEMA, SUMMARY_SCHEMA = "hfa.sweep/1", "hfa.sweep-store/1", "hfa.sweep-summary/1"
#: Of a sweep in memory.
MOST_POINTS = 1_000_000
#: Points of a chunk: half a second of work or more, about 90 MB of results.
CHUNK = 100_000
#: The same where each point is trimmed on its own: seconds of work.
SLOW_CHUNK = 1_000
#: Points of a chunk in which kinks are looked for where the sweep runs as machine code.
LOOKED_AT = 2_000
_NAN = float("nan")


def task_of(plan: SweepPlan, start: int, stop: int) -> Task:
    """Arguments of `run_points` for rows start .. stop - 1."""
    compiled = plan.count >= COMPILE_FROM
    return plan.aircraft, plan.variables, plan.values(start, stop), plan.condition, plan.start, compiled


def run_points(
    aircraft: Aircraft | Model,
    variables: tuple[str, ...],
    values: np.ndarray,
    condition: TrimCondition,
    start: OperatingPoint | None,
    compile_code: bool,
    progress: Progress | None = None,
) -> dict[str, Any]:
    """The points of a task: the arrays of `arrays_of` by name, and `failures` and `kinked`, words by point. What a
    worker runs."""
    options: Any = {"start": start, "compile_code": compile_code, "progress": progress}
    points, model = trim_points(aircraft, variables, values, condition, **options), aircraft.model
    known = points.status == TRIMMED
    eigenvalues = np.full(points.states.shape, np.nan, dtype=complex)
    eigenvalues[known] = fastest_first(np.linalg.eigvals(points.A[known]))
    few = slice(0, LOOKED_AT if compile_code else None)  # machine code trims a point in the time that a look takes
    constants, exact = parameters_at(model, variables, values[few]), np.concatenate([points.A, points.B], axis=2)[few]
    kinked, kinks = kinks_in(model, points.states[few], points.inputs[few], constants, exact), np.full(len(values), -1)
    kinks[few] = 0
    for i, words in kinked.items():
        kinks[i] = len(words)
    columns = dict(zip(variables, values.T, strict=True))
    found = {"values": values, "eigenvalues": eigenvalues, "kinks": kinks, "kinked": kinked}
    return points._asdict() | columns | found


def arrays_of(plan: SweepPlan) -> dict[str, Array]:
    """What `run_points` makes of a plan: one row a point."""
    states, inputs, variables = tuple(plan.model.states), tuple(plan.model.inputs), plan.variables

    def numbers(meaning: str, units: str, *axes: tuple[str, Sequence[str]], of: str = "units_of") -> Array:
        shape, kind = tuple(len(names) for _, names in axes), "float64"
        return Array(shape, kind, _NAN, tuple(axis for axis, _ in axes), described(meaning, **{of: units}))

    def coded(meaning: str, words: Sequence[str]) -> Array:  # by the CF conventions
        flags = {"flag_values": list(range(len(words)))}
        meanings = " ".join(word.replace(" ", "_") for word in words)
        return Array((), "int8", -1, (), described(meaning) | flags | {"flag_meanings": meanings})

    varied = zip(variables, plan.units, strict=True)
    state, control, rate = ("state", states), ("input", inputs), ("rate", states)
    poles = described("of A, fastest first", "1/s")
    return {name: numbers("what is varied", unit, of="units") for name, unit in varied} | {
        "values": numbers("what is varied", "variable_unit", ("variable", variables)),
        "status": coded("how the trim came out", STATUS),
        "limiting": coded("what lies beyond its limit", states + inputs),
        "states": numbers("X0", "state_unit", state),
        "inputs": numbers("U0", "input_unit", control),
        "A": numbers("dx'/dx", "rate_unit / state_unit", rate, state),
        "B": numbers("dx'/du", "rate_unit / input_unit", rate, control),
        "eigenvalues": Array((len(states),), "complex128", complex(_NAN, _NAN), ("mode",), poles),
        "kinks": Array(
            (), "int16", -1, (), described("entries of A and B whose one-sided slopes differ, -1 where not looked for")
        ),
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
        state_units, input_units = model.units(states), model.units(inputs)
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
            **{"states": list(states), "state_units": list(state_units)},
            **{"inputs": list(inputs), "input_units": list(input_units)},
            "status": list(STATUS),
            "limiting": list(states + inputs),
            "warnings": plan.warnings,
        }
        chunk = CHUNK if is_square(model, plan.variables, plan.condition) else SLOW_CHUNK
        arrays = arrays_of(plan)
        return Layout(STORE_SCHEMA, "sweep", plan.count, "point", chunk, plan.to_dict(), arrays, labels, attributes)

    @property
    def function(self) -> Callable[..., Mapping[str, np.ndarray]]:
        """What workers run."""
        return run_points

    def task(self, start: int, stop: int) -> Task:
        """Its arguments for some rows."""
        return task_of(self.plan, start, stop)


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
        notes.append(f"kinks at {kinks} points: one-sided slopes differ from A or B (the array kinks counts entries)")
    counts = dict(zip(("missing", *STATUS), totals.tolist(), strict=True))
    return Report(
        title=f"Sweep over {', '.join(plan.variables)}, {plan.model.title}, in {path}",
        parts=(Table(("status", "points"), [(status, str(count)) for status, count in counts.items()]),),
        notes=notes,
        data={
            "schema": SUMMARY_SCHEMA,
            "store": str(path),
            "dynamics": plan.model.name,
            **plan.varied,
            "points": plan.count,
            "counts": counts,
            "warnings": notes,
        },
    )


@dataclass(frozen=True, eq=False, repr=False)
class Sweep(ByValue, Reported):
    """N points in the order of the grid, the last variable running fastest.

    plan: what was swept. values: (N, variables), all combinations of its values. reasons: "" where trimmed, else
    why not. states: (N, n), inputs: (N, m), A: (N, k, k), B: (N, k, m), eigenvalues: (N, k), a column following one
    mode through the sweep, of the k states of the model; nan where the trim failed. mode_names: name of each column at
    the first trimmed point. kinks: point -> entries of A and B whose one-sided slopes differ, in words.
    Units: the model's, eigenvalues 1/s.
    """

    plan: SweepPlan
    values: np.ndarray
    reasons: tuple[str, ...]
    states: np.ndarray
    inputs: np.ndarray
    A: np.ndarray
    B: np.ndarray
    eigenvalues: np.ndarray
    model_states: tuple[str, ...]
    mode_names: tuple[str, ...]
    kinks: dict[int, tuple[str, ...]] = field(default_factory=dict)

    @property
    def dynamics(self) -> str:
        """Name of the dynamics."""
        return self.model.name

    @property
    def model(self) -> Model:
        """Whose trims these are."""
        return self.plan.model

    @property
    def variables(self) -> tuple[str, ...]:
        """Names of what varies, in order."""
        return self.plan.variables

    @property
    def units(self) -> tuple[str, ...]:
        """Unit of each variable, in order."""
        return self.plan.units

    @property
    def trimmed(self) -> np.ndarray:
        """(N,) true where a trim was found."""
        return np.array([reason == "" for reason in self.reasons])

    @property
    def root_locus(self) -> RootLocus:
        """The eigenvalues over the last variable."""
        variable, unit = self.variables[-1], self.units[-1]
        return RootLocus(variable, unit, self.values[:, -1], self.eigenvalues, self.mode_names, self.model.title)

    def report(self) -> Report:
        """One line a point: the varied values and the eigenvalues of each mode, or why there is no trim.

        A conjugate pair has one column; where it splits into two real eigenvalues, it has both. Where the modes of
        two columns meet in a conjugate pair, each column has one of its members.
        """
        modes = tuple(dict.fromkeys(self.mode_names))
        members = [[i for i, each in enumerate(self.mode_names) if each == name] for name in modes]

        def varied(i: int) -> tuple[str, ...]:
            return tuple(map(shown_value, self.values[i], self.units))

        def row(i: int) -> tuple[str, ...]:
            if self.reasons[i]:
                return *varied(i), *("-" for _ in modes)
            return *varied(i), *(_mode_text(self.eigenvalues[i, columns]) for columns in members)

        count, warnings = len(self.reasons), self.plan.warnings
        if self.kinks:
            first, words = next(iter(self.kinks.items()))
            where = f"{len(self.kinks)} of {count} points, the first at {', '.join(varied(first))}"
            warnings.append(f"{words[0]} ({where})")
        header = (
            *(f"{name} {shown_unit(unit)}" for name, unit in zip(self.variables, self.units, strict=True)),
            *(f"{name} 1/s" for name in modes),
        )
        failures = [f"{', '.join(varied(i))}: {reason}" for i, reason in enumerate(self.reasons) if reason]
        pictures, moving = tuple[Picture, ...](), np.ptp(self.values, axis=0) > 0
        if self.mode_names and moving.sum() == 1 and moving[-1]:
            text = f"Eigenvalues over {self.variables[-1]}"
            pictures = (Picture("root_locus.png", text, self.root_locus.figure),)
        return Report(
            title=f"Sweep, {self.model.title}: {int(self.trimmed.sum())} of {count} points trimmed",
            parts=((Table(header, RowsMade(count, row)), *failures), *pictures),
            notes=warnings,
            data=self.to_dict() | {"warnings": warnings},
            records=self.records(),
        )

    def records(self) -> Table:
        """One row a point: the varied values, status, reason, operating point, eigenvalues, entries of A and B."""
        n, model = len(self.model_states), self.model
        header = (
            *(f"{name} [{unit}]" for name, unit in zip(self.variables, self.units, strict=True)),
            *("status", "reason"),
            *(f"state {name} [{each.unit}]" for name, each in model.states.items()),
            *(f"input {name} [{each.unit}]" for name, each in model.inputs.items()),
            *(f"{part} eigenvalue {i + 1} [1/s]" for i in range(n) for part in ("real", "imaginary")),
            *(
                f"{matrix}({row}, {column}) [{model.entry_unit(row, column)}]"
                for matrix, names in (("A", self.model_states), ("B", tuple(model.inputs)))
                for row in self.model_states
                for column in names
            ),
        )

        def row(i: int) -> tuple[Any, ...]:
            status = str(Status.FAILED if self.reasons[i] else Status.TRIMMED)
            roots = self.eigenvalues[i].view(float)
            numbers = self.states[i], self.inputs[i], roots, self.A[i].ravel(), self.B[i].ravel()
            return *self.values[i], status, self.reasons[i], *np.concatenate(numbers)

        return Table(header, RowsMade(len(self.reasons), row))

    def to_xarray(self) -> Any:
        """The sweep as an `xarray.Dataset`: states, inputs, A, B and eigenvalues over the axes of the grid, or over the
        points of a list, with names, units and reasons. Needs xarray."""
        import xarray

        plan, model = self.plan, self.model
        place, shape = (("point",), (plan.count,)) if plan.listed else (plan.variables, tuple(plan.sizes))
        names = {"state": tuple(model.states), "input": tuple(model.inputs), "mode": self.mode_names}
        names |= {"rate": self.model_states, "linear_state": self.model_states}
        coordinates: dict[str, Any] = {name: list(each) for name, each in names.items() if each}
        coordinates |= {f"{name}_unit": (name, list(model.units(names[name]))) for name in ("state", "input")}
        for i, (name, unit) in enumerate(zip(plan.variables, plan.units, strict=True)):
            steps = 1 if plan.listed else int(np.prod(shape[i + 1 :]))
            along = self.values[::steps, i][: shape[0 if plan.listed else i]]
            coordinates[name] = (place[0] if plan.listed else name, along, {"units": unit})
        data: dict[str, Any] = {"reason": (place, np.array(self.reasons).reshape(shape))}
        for name in ("states", "inputs", "A", "B", "eigenvalues"):
            array, about = getattr(self, name), arrays_of(plan)[name]
            axes = ("rate", "linear_state") if name == "A" else about.axes
            data[name] = ((*place, *axes), array.reshape(*shape, *array.shape[1:]), about.about)
        return xarray.Dataset(data, coordinates, {"model": model.title})

    def to_dict(self) -> dict[str, Any]:
        """Names, units and arrays; complex eigenvalues as [real, imaginary]."""
        inputs = tuple(self.model.inputs)
        return {
            "schema": SCHEMA,
            "dynamics": self.dynamics,
            **self.plan.varied,
            "values": self.values,
            "reasons": list(self.reasons),
            "states": list(self.model_states),
            "state_units": list(self.model.units(self.model_states)),
            "inputs": list(inputs),
            "input_units": list(self.model.units(inputs)),
            "operating_states": self.states,
            "operating_inputs": self.inputs,
            "A": self.A,
            "B": self.B,
            "mode_names": list(self.mode_names),
            "eigenvalues": np.stack([self.eigenvalues.real, self.eigenvalues.imag], axis=-1),
        }


def _mode_text(eigenvalues: np.ndarray) -> str:
    """The eigenvalues of a mode; the two members of a pair at once, one of them alone with its own sign."""
    pairs = {value for value in eigenvalues if value.imag > 0 and value.conjugate() in eigenvalues}
    shown = (each for each in eigenvalues if each.conjugate() not in pairs)
    return ", ".join(
        f"{each.real:.4f} {each.imag:+.4f}i" if each.imag and each not in pairs else eigenvalue_text(each)
        for each in shown
    )


def sweep(
    aircraft: Aircraft | Model,
    grid: Mapping[str, Sequence[float] | np.ndarray],
    *,
    condition: TrimCondition | None = None,
    start: OperatingPoint | None = None,
    listed: bool = False,
    full: bool = False,
    progress: Progress | None = None,
) -> Sweep:
    """Trim and linearize at every point of the product of the given values, or, when `listed`, at every row of these
    columns: a `SweepPlan` run in memory.

    grid: trim variable or parameter of the aircraft -> values that are held (rad, ft/s, ft). condition: what the other
    variables do, by default the model's own trim, of the HFA the paper's level flight with a flat wing; the grid
    overrides it. start: where the search begins at each point. A point that has no trim becomes a row with its
    reason. progress is called with (points done, points in all). BadInputError when a name is unknown, a value lies
    outside its limits, or the grid is empty or has more than `MOST_POINTS` points.
    """
    plan = SweepPlan(grid, aircraft, condition, start=start, listed=listed)  # type: ignore[arg-type]
    return run_plan(plan, full=full, progress=progress)


def run_plan(plan: SweepPlan, *, full: bool = False, progress: Progress | None = None) -> Sweep:
    """Every point of a plan with a grid, in memory; full: all states, not the linear ones alone."""
    if plan.count > MOST_POINTS:
        raise BadInputError(f"the sweep has {plan.count:,} points; a grid of at most {MOST_POINTS:,} fits in memory")
    task, model = task_of(plan, 0, plan.count), plan.model
    rows = run_points(*task, progress)  # type: ignore[call-arg]
    trimmed = rows["status"] == TRIMMED
    reasons = [rows["failures"].get(i, "") for i in range(plan.count)]
    for i in np.flatnonzero(rows["status"] == BEYOND_LIMITS).tolist():
        balancing = dict(zip(model.inputs, rows["inputs"][i].tolist(), strict=True))
        at = condition_at(plan.condition, plan.variables, rows["values"][i])
        reasons[i] = beyond_limits(model_at(model, plan.variables, rows["values"][i]), at, balancing)
    states, inputs = (np.where(trimmed[:, None], rows[name], np.nan) for name in ("states", "inputs"))
    model_states = tuple(model.states) if full else model.linear
    chosen = [list(model.states).index(name) for name in model_states]
    A, B = rows["A"][:, chosen][:, :, chosen], rows["B"][:, chosen]
    eigenvalues, names = np.full((plan.count, len(chosen)), np.nan, dtype=complex), tuple[str, ...]()
    if trimmed.any():
        eigenvalues[trimmed] = track_modes(A[trimmed], model_states, _neighbours(plan.sizes, trimmed), model)
        first = int(np.argmax(trimmed))
        modes = modes_of(A[first], model_states, model.modes)
        up = [complex(value.real, abs(value.imag)) for value in eigenvalues[first]]
        names = tuple(min(modes, key=lambda mode: abs(mode.eigenvalue - value)).name for value in up)
    return Sweep(
        plan, rows["values"], tuple(reasons), states, inputs, A, B, eigenvalues, model_states, names, rows["kinked"]
    )


def _neighbours(sizes: list[int], trimmed: np.ndarray) -> np.ndarray:
    """(M, 2) numbers, among the trimmed points, of those that follow one another along a line of the grid."""
    numbers, index = np.cumsum(trimmed) - 1, np.arange(trimmed.size).reshape(sizes)
    pairs = []
    for axis, size in enumerate(sizes):
        along = np.moveaxis(index, axis, -1).ravel()
        line = np.arange(trimmed.size) // size
        along, line = along[trimmed[along]], line[trimmed[along]]
        same = line[1:] == line[:-1]
        pairs.append(np.stack([along[:-1][same], along[1:][same]], axis=-1))
    return np.asarray(numbers[np.concatenate(pairs)])
