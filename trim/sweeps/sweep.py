"""A sweep in memory: trims and linear models over a grid, modes tracked, failures kept as rows; and what it says."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from hfa_model.aircraft import Aircraft
from hfa_support.errors import BadInputError
from hfa_support.model import Model
from hfa_support.progress import Progress
from hfa_support.reporting.fields import ByValue
from hfa_support.reporting.figure import new_figure
from hfa_support.reporting.report import Picture, Report, Reported
from hfa_support.reporting.text import RowsMade, Table, eigenvalue_text, shown_unit, shown_value, shown_values
from trim.linear.kinks import kinks_in
from trim.linear.modes import modes_of, track_modes
from trim.point.condition import TrimCondition, usual_condition
from trim.point.operating_point import OperatingPoint, Status
from trim.sweeps.points import TRIMMED, parameters_at, reasons_of, trim_points
from trim.sweeps.sweep_plan import SweepPlan, plan_warnings

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

#: A mode is slow when it never has a larger share of the fastest eigenvalue.
_SLOW = 0.15
SCHEMA = "hfa.sweep/1"


class RootLocus(NamedTuple):
    """N points along one variable. values: (N,), in `unit`. eigenvalues: (N, n), 1/s, a column a mode;
    nan where there is no trim. mode_names: of the columns, empty where nothing is trimmed.
    """

    variable: str
    unit: str
    values: np.ndarray
    eigenvalues: np.ndarray
    mode_names: tuple[str, ...]
    called: str

    @property
    def slow(self) -> np.ndarray:
        """(n,) which eigenvalues stay slow along the line: below a share of the fastest everywhere."""
        size = np.nanmax(np.abs(self.eigenvalues), axis=0)
        return np.asarray(size < _SLOW * size.max())

    def figure(self) -> Figure:
        """One color a mode, the slow ones enlarged; both ends of the line marked.

        BadInputError when no point of it has a trim: there is nothing to draw.
        """
        if not self.mode_names:
            raise BadInputError("no point of the sweep has a trim: there is no root locus to draw")
        slow = self.slow
        parts = [("all modes", np.ones(len(slow), dtype=bool))]
        if slow.any() and not slow.all():
            parts.append(("the slow modes", slow))
        figure = new_figure(10.0, 5.2)
        for axes, (title, shown) in zip(figure.subplots(1, len(parts), squeeze=False)[0], parts, strict=True):
            self._draw(axes, shown)
            axes.set_title(f"{self.called}, {title}", fontsize=10)
        handles, labels = figure.axes[0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside upper center", ncols=4, fontsize=8)
        return figure

    def _draw(self, axes: Axes, shown: np.ndarray) -> None:
        """The columns that are shown, a line a mode, and both ends of the line."""
        values, unit = shown_values(self.values, self.unit), shown_unit(self.unit)
        names = list(dict.fromkeys(self.mode_names))
        for column in np.flatnonzero(shown).tolist():
            name = self.mode_names[column]
            style = ("-", "--", "-.", ":")[names.index(name) % 4]
            label = name if column == self.mode_names.index(name) else None
            roots = self.eigenvalues[:, column]
            axes.plot(roots.real, roots.imag, style, color=f"C{names.index(name)}", label=label)
        trimmed = np.flatnonzero(~np.isnan(self.eigenvalues[:, 0]))
        for end, marker in ((trimmed[0], "o"), (trimmed[-1], "s")):
            roots = self.eigenvalues[end, shown]
            note = f"{self.variable} {values[end]:.4g} {unit}"
            axes.plot(roots.real, roots.imag, marker, color="black", fillstyle="none", markersize=5, label=note)
        axes.axvline(0.0, color="gray", linewidth=0.8)
        axes.set_xlabel("real part, 1/s")
        axes.set_ylabel("imaginary part, 1/s")
        axes.grid(alpha=0.3)


@dataclass(frozen=True, eq=False, repr=False)
class Sweep(ByValue, Reported):
    """N points in the order of the grid, the last variable running fastest.

    plan: what was swept. values: (N, variables), all combinations of its values. reasons: "" where trimmed, else
    why not. states: (N, 7), inputs: (N, 5), A: (N, n, n), B: (N, n, 5), eigenvalues: (N, n), a column following one
    mode through the sweep; nan where the trim failed. mode_names: name of each column at the first trimmed point.
    kinks: point -> entries of A and B whose one-sided slopes differ, in words.
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
        return self.plan.dynamics_name

    @property
    def model(self) -> Model:
        """Whose trims these are."""
        return self.plan.aircraft.model

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

        count, warnings = len(self.reasons), plan_warnings(self.plan)
        if self.kinks:
            first, words = next(iter(self.kinks.items()))
            where = f"{len(self.kinks)} of {count} points, the first at {', '.join(varied(first))}"
            warnings.append(f"{words[0]} ({where})")
        header = (
            *(f"{name} {shown_unit(unit)}" for name, unit in zip(self.variables, self.units, strict=True)),
            *(f"{name} 1/s" for name in modes),
        )
        failures = [f"{', '.join(varied(i))}: {reason}" for i, reason in enumerate(self.reasons) if reason]
        return Report(
            title=f"Sweep, {self.model.title}: {int(self.trimmed.sum())} of {count} points trimmed",
            parts=((Table(header, RowsMade(count, row)), *failures), *self._picture()),
            notes=warnings,
            data=self.to_dict() | {"warnings": warnings},
            records=_records(self),
        )

    def _picture(self) -> tuple[Picture, ...]:
        """The picture of a sweep in one variable."""
        moving = np.ptp(self.values, axis=0) > 0
        if not self.mode_names or moving.sum() != 1 or not moving[-1]:
            return ()
        text = f"Eigenvalues over {self.variables[-1]}"
        return (Picture("root_locus.png", text, self.root_locus.figure),)

    def to_xarray(self) -> Any:
        """The sweep as an `xarray.Dataset`: states, inputs, A, B and eigenvalues over the axes of the grid, or over the
        points of a list, with names, units and reasons. Needs xarray."""
        import xarray

        plan, model = self.plan, self.model
        listed = plan.listed
        place = ("point",) if listed else plan.variables
        shape = (plan.count,) if listed else tuple(plan.sizes)
        arrays = {
            "states": (self.states, ("state",)),
            "inputs": (self.inputs, ("input",)),
            "A": (self.A, ("rate", "linear_state")),
            "B": (self.B, ("rate", "input")),
            "eigenvalues": (self.eigenvalues, ("mode",)),
            "reason": (np.array(self.reasons), ()),
        }
        names = {"state": tuple(model.states), "input": tuple(model.inputs), "mode": self.mode_names or None}
        names |= {"rate": self.model_states, "linear_state": self.model_states}
        coordinates: dict[str, Any] = {name: list(each) for name, each in names.items() if each}
        coordinates |= {f"{name}_unit": (name, list(model.units(names[name] or ()))) for name in ("state", "input")}
        for i, (name, unit) in enumerate(zip(plan.variables, plan.units, strict=True)):
            axis, column = 0 if listed else i, self.values[:, i].reshape(shape)
            along = np.moveaxis(column, axis, -1).reshape(-1, shape[axis])[0]
            coordinates[name] = (place[axis], along, {"units": unit})
        data = {name: ((*place, *of), each.reshape(*shape, *each.shape[1:])) for name, (each, of) in arrays.items()}
        return xarray.Dataset(data, coordinates, {"model": model.title})

    def to_dict(self) -> dict[str, Any]:
        """Names, units and arrays; complex eigenvalues as [real, imaginary]."""
        return {
            "schema": SCHEMA,
            "dynamics": self.dynamics,
            **self.plan.varied,
            "values": self.values,
            "reasons": list(self.reasons),
            "states": list(self.model_states),
            "state_units": list(self.model.units(self.model_states)),
            "inputs": list(self.model.inputs),
            "input_units": list(self.model.units(tuple(self.model.inputs))),
            "operating_states": self.states,
            "operating_inputs": self.inputs,
            "A": self.A,
            "B": self.B,
            "mode_names": list(self.mode_names),
            "eigenvalues": np.stack([self.eigenvalues.real, self.eigenvalues.imag], axis=-1),
        }


def _records(result: Sweep) -> Table:
    """One row a point: the varied values, status, reason, operating point, eigenvalues, entries of A and B."""
    n, model = len(result.model_states), result.model
    header = (
        *(f"{name} [{unit}]" for name, unit in zip(result.variables, result.units, strict=True)),
        "status",
        "reason",
        *(f"state {name} [{each.unit}]" for name, each in model.states.items()),
        *(f"input {name} [{each.unit}]" for name, each in model.inputs.items()),
        *(f"{part} eigenvalue {i + 1} [1/s]" for i in range(n) for part in ("real", "imaginary")),
        *(
            f"{matrix}({row}, {column}) [{model.entry_unit(row, column)}]"
            for matrix, names in (("A", result.model_states), ("B", tuple(model.inputs)))
            for row in result.model_states
            for column in names
        ),
    )

    def row(i: int) -> tuple[Any, ...]:
        return (
            *result.values[i],
            str(Status.FAILED if result.reasons[i] else Status.TRIMMED),
            result.reasons[i],
            *result.states[i],
            *result.inputs[i],
            *(part for value in result.eigenvalues[i] for part in (value.real, value.imag)),
            *result.A[i].ravel(),
            *result.B[i].ravel(),
        )

    return Table(header, RowsMade(len(result.reasons), row))


def _mode_text(eigenvalues: np.ndarray) -> str:
    """The eigenvalues of a mode; the two members of a pair at once, one of them alone with its own sign."""
    pairs = {value for value in eigenvalues if value.imag > 0 and value.conjugate() in eigenvalues}
    shown = (each for each in eigenvalues if each.conjugate() not in pairs)
    return ", ".join(
        f"{each.real:.4f} {each.imag:+.4f}i" if each.imag and each not in pairs else eigenvalue_text(each)
        for each in shown
    )


#: Of a sweep in memory.
MOST_POINTS = 1_000_000


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
    asked = usual_condition(aircraft.model) if condition is None else condition
    if isinstance(aircraft, Model):
        own: tuple[Any, Any] = None, aircraft
    else:
        own = aircraft.parameters, aircraft.variant
    plan = SweepPlan(grid, *own, condition=asked, start=start, listed=listed)
    return run_plan(plan, full=full, progress=progress)


def run_plan(plan: SweepPlan, *, full: bool = False, progress: Progress | None = None) -> Sweep:
    """Every point of a plan with a grid, in memory; full: all states, not the linear ones alone."""
    if plan.samples or plan.count > MOST_POINTS:
        raise BadInputError(f"the sweep has {plan.count:,} points; a grid of at most {MOST_POINTS:,} fits in memory")
    values, variables = plan.values(0, plan.count), plan.variables
    points = trim_points(plan.aircraft, variables, values, plan.condition, start=plan.start, progress=progress)
    reasons = reasons_of(points, plan.aircraft, variables, values, plan.condition)
    trimmed = points.status == TRIMMED
    points.states[~trimmed], points.inputs[~trimmed] = np.nan, np.nan
    model = plan.aircraft.model
    model_states = tuple(model.states) if full else model.linear
    rows = [list(model.states).index(name) for name in model_states]
    A, B = points.A[:, rows][:, :, rows], points.B[:, rows]
    eigenvalues = np.full((plan.count, len(rows)), np.nan, dtype=complex)
    mode_names: tuple[str, ...] = ()
    if trimmed.any():
        eigenvalues[trimmed] = track_modes(A[trimmed], model_states, _neighbours(plan.sizes, trimmed), model)
        first = int(np.argmax(trimmed))
        mode_names = _column_names(A[first], eigenvalues[first], model_states, model)
    constants, exact = parameters_at(model, variables, values), np.concatenate([points.A, points.B], axis=2)
    kinks = kinks_in(model, points.states, points.inputs, constants, exact)
    found = (points.states, points.inputs, A, B, eigenvalues, model_states, mode_names, kinks)
    return Sweep(plan, values, reasons, *found)


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


def _column_names(A: np.ndarray, eigenvalues: np.ndarray, states: tuple[str, ...], model: Model) -> tuple[str, ...]:
    """The mode of each eigenvalue column, at the first trimmed point."""
    modes = modes_of(A, states, model.modes)
    up = [complex(value.real, abs(value.imag)) for value in eigenvalues]
    return tuple(min(modes, key=lambda mode: abs(mode.eigenvalue - value)).name for value in up)
