"""Trims and linear models over many points: the function that makes their arrays, and a sweep in
memory."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from hfa_aircraft.model import Model
from hfa_support.errors import BadInputError
from hfa_support.progress import Progress
from hfa_support.reporting.fields import ByValue
from hfa_support.reporting.figure import new_figure
from hfa_support.reporting.report import Picture, Report, Reported
from hfa_support.reporting.text import RowsMade, Table, eigenvalue_text, shown_unit, shown_value
from trim.linear.kinks import with_means_at_kinks
from trim.linear.modes import fastest_first, modes_of
from trim.point.condition import TrimCondition
from trim.point.diagnosis import beyond_limits
from trim.point.operating_point import OperatingPoint, Status
from trim.sweeps.mode_tracking import track_modes
from trim.sweeps.points import (
    BEYOND_LIMITS,
    TRIMMED,
    condition_at,
    model_at,
    parameters_at,
    trim_points,
)
from trim.sweeps.sweep_arrays import ARRAYS, labels_of
from trim.sweeps.sweep_plan import SweepPlan

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

#: Of a sweep in memory.
MOST_POINTS = 1_000_000
#: Points of a chunk in which kinks are looked for where the sweep runs as machine code.
LOOKED_AT = 2_000
#: A mode is slow when it never has a larger share of the fastest eigenvalue.
_SLOW = 0.15


def run_points(
    aircraft: Model,
    variables: tuple[str, ...],
    values: np.ndarray,
    condition: TrimCondition,
    start: OperatingPoint | None,
    compile_code: bool,
    progress: Progress | None = None,
) -> dict[str, Any]:
    """The points of a task: the arrays of a store by name, and `failures` and `kinked`, words by
    point. What a worker runs."""
    model = aircraft
    points = trim_points(
        aircraft,
        variables,
        values,
        condition,
        start=start,
        compile_code=compile_code,
        progress=progress,
    )
    # Machine code trims a point in the time that a look for kinks takes.
    looked_at = LOOKED_AT if compile_code else len(values)
    few = slice(0, looked_at)
    smoothed = with_means_at_kinks(
        model,
        points.states[few],
        points.inputs[few],
        parameters_at(model, variables, values[few]),
        points.A[few],
        points.B[few],
    )
    points.A[few] = smoothed.A
    points.B[few] = smoothed.B
    kinks = np.full(len(values), -1)
    kinks[few] = 0
    for point, notes in smoothed.notes.items():
        kinks[point] = len(notes)
    trimmed = points.status == TRIMMED
    eigenvalues = np.full(points.states.shape, np.nan, dtype=complex)
    eigenvalues[trimmed] = fastest_first(np.linalg.eigvals(points.A[trimmed]))
    columns = dict(zip(variables, values.T, strict=True))
    return {
        **points._asdict(),
        **columns,
        "values": values,
        "eigenvalues": eigenvalues,
        "kinks": kinks,
        "kinked": smoothed.notes,
    }


@dataclass(frozen=True, eq=False, repr=False)
class Sweep(ByValue, Reported):
    """N points in the order of the grid, the last variable running fastest.

    plan: what was swept. values: (N, variables), all combinations of its values. reasons: "" where
    trimmed, else why not. states: (N, n), inputs: (N, m), A: (N, k, k), B: (N, k, m), eigenvalues:
    (N, k), a column following one mode through the sweep, of the k linear states of the model; nan
    where the trim failed. mode_names: name of each column at the first trimmed point. kinks: point
    -> entries of A and B whose one-sided slopes differ, in words. Units: the model's, eigenvalues
    1/s."""

    plan: SweepPlan
    values: np.ndarray
    reasons: tuple[str, ...]
    states: np.ndarray
    inputs: np.ndarray
    A: np.ndarray
    B: np.ndarray
    eigenvalues: np.ndarray
    mode_names: tuple[str, ...]
    kinks: dict[int, tuple[str, ...]] = field(default_factory=dict)

    @property
    def model(self) -> Model:
        """Whose trims these are."""
        return self.plan.model

    @property
    def variables(self) -> tuple[str, ...]:
        """Names of what varies, in order."""
        return self.plan.variables

    @property
    def trimmed(self) -> np.ndarray:
        """(N,) true where a trim was found."""
        return np.array([reason == "" for reason in self.reasons])

    @property
    def slow(self) -> np.ndarray:
        """(n,) which eigenvalues stay slow: below a share of the fastest everywhere."""
        size = np.nanmax(np.abs(self.eigenvalues), axis=0)
        return np.asarray(size < _SLOW * size.max())

    def figure(self) -> Figure:
        """The root locus over the last variable: one color a mode, the slow ones enlarged; both
        ends marked.

        BadInputError when no point has a trim: there is nothing to draw.
        """
        if not self.mode_names:
            raise BadInputError("no point of the sweep has a trim: there is no root locus to draw")
        slow = self.slow
        parts = [("all modes", np.ones(len(slow), dtype=bool))]
        if slow.any() and not slow.all():
            parts.append(("the slow modes", slow))
        figure = new_figure(10.0, 5.2)
        for axes, (title, shown) in zip(
            figure.subplots(1, len(parts), squeeze=False)[0], parts, strict=True
        ):
            self._draw(axes, shown)
            axes.set_title(f"{self.model.title}, {title}", fontsize=10)
        handles, labels = figure.axes[0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside upper center", ncols=4, fontsize=8)
        return figure

    def _draw(self, axes: Axes, shown: np.ndarray) -> None:
        """The columns that are shown, a line a mode, and both ends of the line."""
        names = list(dict.fromkeys(self.mode_names))
        for column in np.flatnonzero(shown).tolist():
            name, roots = self.mode_names[column], self.eigenvalues[:, column]
            style = ("-", "--", "-.", ":")[names.index(name) % 4]
            label = name if column == self.mode_names.index(name) else None
            axes.plot(roots.real, roots.imag, style, color=f"C{names.index(name)}", label=label)
        for end, marker in zip(np.flatnonzero(self.trimmed)[[0, -1]], "os", strict=True):
            roots, unit = self.eigenvalues[end, shown], self.plan.units[-1]
            note = f"{self.variables[-1]} {shown_value(self.values[end, -1], unit, '.4g')} {shown_unit(unit)}"
            axes.plot(
                roots.real,
                roots.imag,
                marker,
                color="black",
                fillstyle="none",
                markersize=5,
                label=note,
            )
        axes.axvline(0.0, color="gray", linewidth=0.8)
        axes.set_xlabel("real part, 1/s")
        axes.set_ylabel("imaginary part, 1/s")
        axes.grid(alpha=0.3)

    def report(self) -> Report:
        """One line a point: the varied values and the eigenvalues of each mode, or why there is no
        trim.

        A conjugate pair has one column; where it splits into two real eigenvalues, it has both.
        Where the modes of two columns meet in a conjugate pair, each column has one of its members.
        """
        modes = tuple(dict.fromkeys(self.mode_names))
        members = [[i for i, each in enumerate(self.mode_names) if each == name] for name in modes]

        def varied(i: int) -> tuple[str, ...]:
            return tuple(map(shown_value, self.values[i], self.plan.units))

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
            *(
                f"{name} {shown_unit(unit)}"
                for name, unit in zip(self.variables, self.plan.units, strict=True)
            ),
            *(f"{name} 1/s" for name in modes),
        )
        failures = [
            f"{', '.join(varied(i))}: {reason}" for i, reason in enumerate(self.reasons) if reason
        ]
        pictures, moving = tuple[Picture, ...](), np.ptp(self.values, axis=0) > 0
        if self.mode_names and moving.sum() == 1 and moving[-1]:
            text = f"Eigenvalues over {self.variables[-1]}"
            pictures = (Picture("root_locus.png", text, self.figure),)
        return Report(
            title=f"Sweep, {self.model.title}: {int(self.trimmed.sum())} of {count} points trimmed",
            parts=((Table(header, RowsMade(count, row)), *failures), *pictures),
            notes=warnings,
            data=self.to_dict() | {"warnings": warnings},
            records=self.records(),
        )

    def records(self) -> Table:
        """One row a point: the varied values, status, reason, operating point, eigenvalues, entries
        of A and B."""
        n, model = len(self.model.linear), self.model
        header = (
            *(
                f"{name} [{unit}]"
                for name, unit in zip(self.variables, self.plan.units, strict=True)
            ),
            *("status", "reason"),
            *(f"state {name} [{each.unit}]" for name, each in model.states.items()),
            *(f"input {name} [{each.unit}]" for name, each in model.inputs.items()),
            *(
                f"{part} eigenvalue {i + 1} [1/s]"
                for i in range(n)
                for part in ("real", "imaginary")
            ),
            *(
                f"{matrix}({row}, {column}) [{model.entry_unit(row, column)}]"
                for matrix, names in (("A", self.model.linear), ("B", tuple(model.inputs)))
                for row in self.model.linear
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
        """The sweep as an `xarray.Dataset`: states, inputs, A, B and eigenvalues over the axes of
        the grid, or over the points of a list, with names, units and reasons. Needs xarray."""
        import xarray

        plan = self.plan
        axes: tuple[str, ...] = ("point",)
        if plan.listed:
            coordinates = {name: ("point", self.values[:, i]) for i, name in enumerate(plan.axes)}
        else:
            axes = plan.variables
            coordinates = {name: (name, np.array(plan.axes[name])) for name in plan.axes}
        dataset = xarray.Dataset(
            coords={
                **coordinates,
                **labels_of(self.model, rates=self.model.linear),
                "linear_state": list(self.model.linear),
            },
            attrs={"model": self.model.title},
        )
        if self.mode_names:
            dataset.coords["mode"] = list(self.mode_names)
        dataset["reason"] = (axes, np.array(self.reasons).reshape(plan.sizes))
        for name, array in ARRAYS.items():
            values = getattr(self, name)
            own_axes = ("rate", "linear_state") if name == "A" else array.axes
            reshaped = values.reshape(*plan.sizes, *values.shape[1:])
            dataset[name] = ((*axes, *own_axes), reshaped, array.attributes)
        for name, unit in zip(plan.variables, plan.units, strict=True):
            dataset[name].attrs["units"] = unit
        return dataset

    def to_dict(self) -> dict[str, Any]:
        """Names, units and arrays; complex eigenvalues as [real, imaginary]."""
        inputs = tuple(self.model.inputs)
        return {
            "schema": "hfa.sweep/1",
            "dynamics": self.model.name,
            **self.plan.varied,
            "values": self.values,
            "reasons": list(self.reasons),
            "states": list(self.model.linear),
            "state_units": list(self.model.units(self.model.linear)),
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
    """The eigenvalues of a mode; the two members of a pair at once, one of them alone with its own
    sign."""
    pairs = {value for value in eigenvalues if value.imag > 0 and value.conjugate() in eigenvalues}
    shown = (each for each in eigenvalues if each.conjugate() not in pairs)
    return ", ".join(
        f"{each.real:.4f} {each.imag:+.4f}i"
        if each.imag and each not in pairs
        else eigenvalue_text(each)
        for each in shown
    )


def sweep(
    aircraft: Model,
    grid: Mapping[str, Sequence[float] | np.ndarray],
    *,
    condition: TrimCondition | None = None,
    start: OperatingPoint | None = None,
    listed: bool = False,
    progress: Progress | None = None,
) -> Sweep:
    """Trim and linearize at every point of the product of the given values, or, when `listed`, at
    every row of these columns: a `SweepPlan` run in memory.

    grid: trim variable or parameter of the aircraft -> values that are held (rad, ft/s, ft).
    condition: what the other variables do, by default the model's own trim, of the HFA the paper's
    level flight with a flat wing; the grid overrides it. start: where the search begins at each
    point. A point that has no trim becomes a row with its reason. progress is called with (points
    done, points in all). BadInputError when a name is unknown, a value lies outside its limits, or
    the grid is empty or has more than `MOST_POINTS` points."""
    plan = SweepPlan(grid, aircraft, condition, start=start, listed=listed)  # type: ignore[arg-type]
    return run_plan(plan, progress)


def run_plan(plan: SweepPlan, progress: Progress | None = None) -> Sweep:
    """Every point of a plan, in memory."""
    if plan.count > MOST_POINTS:
        raise BadInputError(
            f"the sweep has {plan.count:,} points; a grid of at most {MOST_POINTS:,} fits in memory"
        )
    model, rows = plan.model, run_points(*plan.task(0, plan.count), progress)  # type: ignore[call-arg]
    trimmed = rows["status"] == TRIMMED
    reasons = [rows["failures"].get(i, "") for i in range(plan.count)]
    for i in np.flatnonzero(rows["status"] == BEYOND_LIMITS).tolist():
        balancing = dict(zip(model.inputs, rows["inputs"][i].tolist(), strict=True))
        at = condition_at(plan.condition, plan.variables, rows["values"][i])
        reasons[i] = beyond_limits(
            model_at(model, plan.variables, rows["values"][i]), at, balancing
        )
    states, inputs = (
        np.where(trimmed[:, None], rows[name], np.nan) for name in ("states", "inputs")
    )
    chosen = [list(model.states).index(name) for name in model.linear]
    A, B = rows["A"][:, chosen][:, :, chosen], rows["B"][:, chosen]
    eigenvalues, names = (
        np.full((plan.count, len(chosen)), np.nan, dtype=complex),
        tuple[str, ...](),
    )
    if trimmed.any():
        eigenvalues[trimmed] = track_modes(
            A[trimmed], model.linear, model, _neighbours(plan.sizes, trimmed)
        )
        first = int(np.argmax(trimmed))
        modes = modes_of(A[first], model.linear, model.modes)
        up = [complex(value.real, abs(value.imag)) for value in eigenvalues[first]]
        names = tuple(
            min(modes, key=lambda mode: abs(mode.eigenvalue - value)).name for value in up
        )
    return Sweep(
        plan,
        rows["values"],
        tuple(reasons),
        states,
        inputs,
        A,
        B,
        eigenvalues,
        names,
        rows["kinked"],
    )


def _neighbours(sizes: list[int], trimmed: np.ndarray) -> np.ndarray:
    """(M, 2) numbers, among the trimmed points, of those that follow one another along a line of
    the grid."""
    numbers, index = np.cumsum(trimmed) - 1, np.arange(trimmed.size).reshape(sizes)
    pairs = []
    for axis, size in enumerate(sizes):
        along = np.moveaxis(index, axis, -1).ravel()
        line = np.arange(trimmed.size) // size
        along, line = along[trimmed[along]], line[trimmed[along]]
        same = line[1:] == line[:-1]
        pairs.append(np.stack([along[:-1][same], along[1:][same]], axis=-1))
    return np.asarray(numbers[np.concatenate(pairs)])
