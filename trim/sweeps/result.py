"""Trims and linear models at the points of a sweep, in memory."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from hfa_aircraft.model import Model
from hfa_aircraft.signals import StatesAndInputs, recognized, record
from hfa_support.errors import BadInputError, NoSolutionError, imported, refuse_unknown
from hfa_support.reporting.figure import new_figure, pyplot_figure
from hfa_support.reporting.parts import Picture
from hfa_support.reporting.report import Report, Reported
from hfa_support.reporting.results import ByValue, Matrix, Result, RootTable, Stack, storable
from hfa_support.reporting.rows import ByName
from hfa_support.reporting.text import (
    SHOWN_AS_ZERO,
    Table,
    beside_unit,
    eigenvalue_text,
    numbered,
    shown_unit,
    shown_value,
    shown_values,
    with_shown_unit,
)
from trim.linear.linear_model import LinearModel
from trim.point.condition import exact_cell, imposed_heading
from trim.point.margins import stalled
from trim.point.operating_point import OperatingPoint
from trim.point.problem import TrimProblem
from trim.point.status import NAME, RESULTS, STALLED, UNTRIMMED, Status
from trim.point.system import parameters_at
from trim.sweeps.mode_tracking import mode_names_of, neighbors_in_grid, track_modes
from trim.sweeps.points import condition_at, model_at
from trim.sweeps.sweep_plan import SweepPlan, arrays_of, at_limit, coordinates_of, limited
from trim.tables import draw_curves, eigenvalue_headings, entry_headings, write_netcdf

if TYPE_CHECKING:
    import pandas
    import xarray
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

#: Suffix of the files in NetCDF.
NETCDF = ".nc"
#: Width and height of the root locus, inches.
_LOCUS_INCHES = (10.0, 5.2)
#: Widths of its lines, points: of the first and the last of several, and of a single one.
_THIN, _THICK, _SINGLE = 0.7, 2.7, 1.5
#: A mode is slow if its eigenvalue is always below this fraction of the fastest.
_SLOW = 0.15
#: Column of the variables at a limit in a printed table.
_AT_LIMIT = "at limit"
#: Number of points above which only `_ROWS_AT_END` first and last rows are printed.
_MOST_ROWS = 200
#: Number of rows printed at each end, and of reasons for failures.
_ROWS_AT_END = 20
#: Number of points trimmed one by one from which a note is printed.
_MANY_SLOW = 20


def trimmed_words(trimmed: int, stalls: int, count: int) -> str:
    """Return the verdict on a sweep as text: "trimmed at 5 of 6 points, STALLED at 1".

    trimmed: number of points with a trim, also those that are stalled
    stalls: number of stalled points
    """
    if not trimmed:
        return f"no trim at any of {count:,} points" if count > 1 else "no trim"
    stalled_too = f", STALLED at {stalls:,}" if stalls else ""
    return f"trimmed at {trimmed - stalls:,} of {count:,} points{stalled_too}"


def slow_note(one_by_one: int, count: int) -> list[str]:
    """Return a list with a note on points that were trimmed one by one, a slow method.

    The list is empty if there are fewer than `_MANY_SLOW` such points.

    one_by_one: number of these points
    count: number of all points
    """
    if one_by_one < _MANY_SLOW:
        return []
    return [
        f"{one_by_one:,} of {count:,} points were trimmed one by one, which is slower: the "
        "equations are not square, or Newton's method on all points at once did not converge"
    ]


class SweptMode(NamedTuple):
    """Mode at the N points of a sweep.

    name: name of the mode at the first trimmed point.
    eigenvalue: (N, 1), or (N, 2) for a pair, 1/s; nan without a trim.
    """

    name: str
    eigenvalue: np.ndarray

    @property
    def frequency(self) -> np.ndarray:
        """Natural frequency ω_n = |λ|, rad/s, in the shape of `eigenvalue`."""
        return np.abs(self.eigenvalue)

    @property
    def damping(self) -> np.ndarray:
        """Damping ratio ζ = -Re λ / |λ|, in the shape of `eigenvalue`, or nan for λ = 0."""
        with np.errstate(invalid="ignore"):
            return np.asarray(-self.eigenvalue.real / self.frequency)


@dataclass(frozen=True, eq=False, repr=False)
class Sweep(StatesAndInputs, ByValue, Result, Reported):
    """Trims and linear models at the N points of a sweep.

    The points are in the order of the grid, in which the last variable varies fastest. All numbers
    are in the units of the model.

    plan: the swept variables and values.
    values: (N, variables), the swept values at each point.
    reasons: (N,), "" if trimmed, otherwise the reason why not.
    states: (N, n), X0, all states of the model; nan if not trimmed, as in all arrays below.
    inputs: (N, m), U0.
    A: (N, k, k), for the k linear states of the model.
    B: (N, k, m).
    nonsmooth_points: number of a point -> notes on entries of A and B at a nonsmooth point.
    one_by_one: number of points that were trimmed one by one.

    >>> import hfa
    >>> sweep = hfa.sweep(hfa.aircraft(), {"dihedral": [0.1, 0.2]})
    >>> sweep.trimmed.tolist(), sweep.A.shape
    ([True, True], (2, 6, 6))
    """

    schema = "hfa.sweep/1"

    plan: SweepPlan
    values: Matrix
    reasons: tuple[str, ...]
    states: Matrix
    inputs: Matrix
    A: Stack
    B: Stack
    nonsmooth_points: dict[int, tuple[str, ...]] = field(default_factory=dict)
    one_by_one: int = 0

    @property
    def model(self) -> Model:
        """Model of the aircraft."""
        return self.plan.model

    @property
    def variables(self) -> tuple[str, ...]:
        """Names of the swept variables, in order."""
        return self.plan.variables

    @property
    def state_names(self) -> tuple[str, ...]:
        """Names of the states of A and B, in order."""
        return self.model.linear

    @property
    def trimmed(self) -> np.ndarray:
        """Mask of the points with a trim, (N,)."""
        return np.array([reason == "" for reason in self.reasons])

    @cached_property
    def stalled(self) -> np.ndarray:
        """Mask of the trims beyond the largest lift, (N,): `trim.point.margins.stalled`."""
        columns = dict(zip(self.variables, self.values.T, strict=True))
        parameters = parameters_at(self.model, len(self), columns)
        return stalled(self.model, self.states, self.inputs, parameters)

    @cached_property
    def eigenvalues(self) -> RootTable:
        """Eigenvalues of A, (N, k), 1/s; each column contains one mode; nan if not trimmed."""
        trimmed = self.trimmed
        eigenvalues = np.full(self.A.shape[:2], complex(np.nan, np.nan))
        if trimmed.any():
            neighbors = neighbors_in_grid(self.plan.sizes, trimmed)
            linear = self.model.linear
            eigenvalues[trimmed] = track_modes(self.A[trimmed], linear, self.model, neighbors)
        return eigenvalues

    @cached_property
    def mode_names(self) -> tuple[str, ...]:
        """Name of each column's mode at the first trimmed point, (k,), or () if none is trimmed."""
        if not self.trimmed.any():
            return ()
        first = int(np.argmax(self.trimmed))
        return mode_names_of(self.eigenvalues[first], self.A[first], self.model)

    @property
    def modes(self) -> ByName[SweptMode]:
        """Modes at all points, which can be indexed by number or name: modes["phugoid"].damping."""
        names = np.array(self.mode_names)
        return ByName(
            SweptMode(name, self.eigenvalues[:, names == name])
            for name in dict.fromkeys(self.mode_names)
        )

    @property
    def slow(self) -> np.ndarray:
        """Mask of the slow eigenvalues, (k,).

        An eigenvalue is slow if its largest magnitude in the sweep is below `_SLOW` times the
        largest magnitude of all eigenvalues.
        """
        size = np.nanmax(np.abs(self.eigenvalues), axis=0)
        return np.asarray(size < _SLOW * size.max())

    @property
    def warnings(self) -> list[str]:
        """Notes on values beyond a range, on nonsmooth points, and on those trimmed one by one."""
        warnings = [*self.plan.warnings, *slow_note(self.one_by_one, len(self.reasons))]
        if self.nonsmooth_points:
            first, notes = next(iter(self.nonsmooth_points.items()))
            count = f"{len(self.nonsmooth_points)} of {len(self.reasons)} points"
            warnings.append(f"{notes[0]} ({count}, the first at {', '.join(self._varied(first))})")
        return warnings

    def figure(self) -> Figure:
        """Return a new figure with the root locus of the sweep."""
        return self._draw_locus(new_figure(*_LOCUS_INCHES))

    def plot(self, *names: str) -> np.ndarray:
        """Draw the root locus over the last variable with pyplot, and return the Axes.

        names: values that are drawn instead of the root locus: plot("alpha", "elevator")

        Raises BadInputError if the root locus is drawn and no point has a trim, and for an unknown
        name.
        """
        if names:
            x = self.variables[-1]
            across = (x, self.model.unit(x), self[x])
            return draw_curves(self.model, across, self._columns(names), self._lines())
        return np.array(self._draw_locus(pyplot_figure(*_LOCUS_INCHES)).axes)

    def _draw_locus(self, figure: Figure) -> Figure:
        """Draw the root locus of the sweep on an empty figure, and return the figure."""
        if not self.mode_names:
            raise BadInputError(
                "no point of the sweep has a trim; sweep other values to draw a root locus"
            )
        slow = self.slow
        parts = [("all modes", np.ones(len(slow), dtype=bool))]
        if slow.any() and not slow.all():
            parts.append(("the slow modes", slow))
        panels = figure.subplots(1, len(parts), squeeze=False)[0]
        for axes, (title, columns) in zip(panels, parts, strict=True):
            self._draw(axes, columns)
            axes.set_title(f"{self.model.title}, {title}", fontsize=10)
        handles, labels = panels[0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside upper center", ncols=4, fontsize=8)
        return figure

    def _draw(self, axes: Axes, columns: np.ndarray) -> None:
        """Draw the paths of some eigenvalues along the last variable, and mark their ends."""
        self._draw_paths(axes, columns)
        self._mark_ends(axes, columns)
        if len(self._lines()) > 1:
            self._add_widths_to_legend(axes)
        axes.axvline(0.0, color="gray", linewidth=0.8)
        axes.margins(0.05, 0.12)
        axes.locator_params(axis="x", nbins=6)
        axes.set_xlabel(f"real part, 1/{self.model.time_unit}")
        axes.set_ylabel(f"imaginary part, 1/{self.model.time_unit}")
        axes.grid(alpha=0.3)

    def _draw_paths(self, axes: Axes, columns: np.ndarray) -> None:
        """Draw a path of each eigenvalue for each line of points, the first ones the thinnest."""
        names = list(dict.fromkeys(self.mode_names))
        for column in np.flatnonzero(columns).tolist():
            name = self.mode_names[column]
            number = names.index(name)
            style = ("-", "--", "-.", ":")[number % 4]
            for line, width in zip(self._lines(), self._widths(), strict=True):
                roots = self.eigenvalues[line, column]
                (path,) = axes.plot(
                    roots.real, roots.imag, style, color=f"C{number}", linewidth=width
                )
            if column == self.mode_names.index(name):  # one label for each mode
                path.set_label(name)

    def _mark_ends(self, axes: Axes, columns: np.ndarray) -> None:
        """Mark the eigenvalues at the first and the last trimmed point of each line of points."""
        unit = self.plan.units[-1]
        places = np.arange(len(self))
        trimmed = [places[line][self.trimmed[line]] for line in self._lines()]
        for end, marker in ((0, "o"), (-1, "s")):
            ends = [points[end] for points in trimmed if points.size]
            roots = self.eigenvalues[ends][:, columns].ravel()
            # in the legend: the different values of the last variable at these points
            values = dict.fromkeys(shown_value(self.values[i, -1], unit, ".4g") for i in ends)
            axes.plot(
                roots.real,
                roots.imag,
                marker,
                color="black",
                fillstyle="none",
                markersize=5,
                label=beside_unit(f"{self.variables[-1]} {' or '.join(values)}", unit),
            )

    def _add_widths_to_legend(self, axes: Axes) -> None:
        """Add the thinnest and the thickest path to the legend: "thin: speed 30 m/s"."""
        for line, width, word in ((0, _THIN, "thin"), (-1, _THICK, "thick")):
            first_point = self._lines()[line].start
            varied = zip(self.variables, self.values[first_point], self.plan.units, strict=True)
            texts = [
                beside_unit(f"{name} {shown_value(value, unit, '.4g')}", unit)
                for name, value, unit in [*varied][:-1]  # the last one varies along the line
            ]
            label = f"{word}: {', '.join(texts)}"
            axes.plot([], [], color="black", linewidth=width, label=label)

    def _entries(self) -> dict[str, Any]:
        """Return the entries of the file, name -> value."""
        return {
            "dynamics": self.plan.model.name,
            **self.plan.entries(),
            "values": self.values,
            "reasons": self.reasons,
            "operating_states": self.states,
            "operating_inputs": self.inputs,
            "A": self.A,
            "B": self.B,
            "eigenvalues": self.eigenvalues,
            "mode_names": self.mode_names,
            "states": self.state_names,
            "state_units": self.state_units,
            "inputs": self.input_names,
            "input_units": self.input_units,
            "warnings": self.warnings,
        } | ({"stalled": self.stalled} if self.stalled.any() else {})

    def report(self) -> Report:
        """Return a report with the values, eigenvalues, alpha, inputs, stalls and limits reached at
        each point, or the reason for a missing trim.

        For a long sweep, only the first and last lines are printed. A conjugate pair has one
        column. If the modes of two columns become a conjugate pair, each column contains one member
        of the pair.
        """
        count = len(self.reasons)
        failed = np.flatnonzero(~self.trimmed).tolist()
        parts: list[Any] = [self._eigenvalue_table()]
        if self.trimmed.any():
            parts.append(self._trim_table())
        for i in failed[:_ROWS_AT_END]:
            parts.append(f"{', '.join(self._varied(i))}: {self.reasons[i]}")
        if len(failed) > _ROWS_AT_END:
            parts.append(
                f"{len(failed) - _ROWS_AT_END:,} more points have no trim; -o FILE.csv writes all"
            )
        if self.mode_names and count > 1:
            text = f"Eigenvalues over {self.variables[-1]}"
            parts.append(Picture("root_locus.png", text, self.figure))
        words = trimmed_words(count - len(failed), int(self.stalled.sum()), count)
        return Report(
            title=f"Sweep, {self.model.title}: {words}",
            parts=tuple(parts),
            notes=self.warnings,
            data=storable(self),
            records=self.records(),
        )

    def _eigenvalue_table(self) -> Table:
        """Return a table of swept values and eigenvalues, one row for each point."""
        modes = self.modes
        names = [f"{mode.name} 1/{self.model.time_unit}" for mode in modes]
        return self._over_points(
            names, lambda i: tuple(_mode_text(mode.eigenvalue[i]) for mode in modes)
        )

    def _trim_table(self) -> Table:
        """Return a table of alpha, of inputs that are not always 0, and of stalls and limits."""
        model = self.model
        nominal = model.nominal(model.inputs)
        moved = (np.abs(np.nan_to_num(self.inputs)) >= SHOWN_AS_ZERO * nominal).any(axis=0)
        inputs = [name for name, is_moved in zip(model.inputs, moved, strict=True) if is_moved]
        alpha = recognized(model.states).get("alpha", "")  # "" of a model without alpha
        names = [name for name in (alpha, *inputs) if name and name not in self.variables]
        values = {name: self[name] for name in names}
        units = {name: model.unit(name) for name in names}

        def row(i: int) -> tuple[str, ...]:
            """Return the values at a point, and its stall and limits."""
            numbers = [shown_value(values[name][i], units[name], ".4g") for name in names]
            stall = ["STALLED"] if self.stalled[i] else []
            reached = [*stall, *self._limits_reached(i)]
            return *numbers, ", ".join(reached) or "none"

        # "throttle" in place of "throttle 1", which has no unit
        header = [f"{name} {shown_unit(unit)}".removesuffix(" 1") for name, unit in units.items()]
        return self._over_points([*header, _AT_LIMIT], row)

    @cached_property
    def at_limit(self) -> np.ndarray:
        """Which free states and inputs are at their lowest (-1) or highest (1) limit, (N, k)."""
        return at_limit(self.plan.condition, self.states, self.inputs)

    def _limits_reached(self, i: int) -> list[str]:
        """Return the variables at a limit at a point with a trim, as in "thrust highest"."""
        names = limited(self.plan.condition)
        ends = {-1: "lowest", 1: "highest"}
        sides = zip(names, self.at_limit[i].tolist(), strict=True)
        return [f"{name} {ends[side]}" for name, side in sides if side]

    def _over_points(
        self, headings: Sequence[str], cells: Callable[[int], tuple[str, ...]]
    ) -> Table:
        """Return a table of swept values and other cells, of all points or the first and last."""
        varied = zip(self.variables, self.plan.units, strict=True)
        labels = [f"{name} {shown_unit(unit)}" for name, unit in varied]
        if self.plan.names:
            labels = ["condition", *labels]
        header = (*labels, *headings)

        def row(i: int) -> tuple[str, ...]:
            """Return the swept values of a point, and its cells, or dashes without a trim."""
            of_point = ("-",) * len(headings) if self.reasons[i] else cells(i)
            return *self._varied(i), *of_point

        count = len(self.reasons)
        if count <= _MOST_ROWS:
            return Table(header, [*map(row, range(count))], labels=len(labels))
        between = (f"({count - 2 * _ROWS_AT_END:,} more)", *("..." for _ in header[1:]))
        head = [row(i) for i in range(_ROWS_AT_END)]
        tail = [row(i) for i in range(count - _ROWS_AT_END, count)]
        return Table(header, [*head, between, *tail], labels=len(labels))

    def _varied(self, i: int) -> tuple[str, ...]:
        """Return the name of point i, if it has one, and the swept values there as text."""
        name = (self.plan.names[i],) if self.plan.names else ()
        return *name, *map(shown_value, self.values[i], self.plan.units)

    def records(self) -> Table:
        """Return a table in full precision with one row for each point, a file of conditions.

        A row contains the condition, the result, the reason or the limits reached, the operating
        point, the eigenvalues, and the entries of A and B. Angles are in degrees, but those of A
        and B in radians.
        """
        model = self.model
        names = (*model.states, *model.inputs)
        units = model.units(names)
        of_all = self.plan.cells_of_all()
        header = (
            *((NAME,) if self.plan.names else ()),
            *(imposed_heading(model, name) for name in self.variables),
            *of_all,
            RESULTS,
            "failure",
            "limits reached",
            *map(with_shown_unit, names, units),
            *self._headings_of_linear_model(),
        )
        point = np.hstack([self.states, self.inputs])
        shown = np.transpose(
            [shown_values(column, unit) for column, unit in zip(point.T, units, strict=True)]
        )

        def row(i: int) -> tuple[Any, ...]:
            """Return the cells of a point, in the order of the header."""
            reason = self.reasons[i]
            result = UNTRIMMED if reason else STALLED if self.stalled[i] else Status.TRIMMED
            reached = "" if reason else ", ".join(self._limits_reached(i))
            matrices = (self.eigenvalues[i].view(float), self.A[i].ravel(), self.B[i].ravel())
            return (
                *self.plan.names[i : i + 1],  # none of a grid
                *map(exact_cell, self.values[i].tolist(), self.plan.units),
                *of_all.values(),
                str(result),
                reason,
                reached,
                *np.concatenate([shown[i], *matrices]).tolist(),
            )

        return Table(header, _RowsMade(len(self.reasons), row))

    def _headings_of_linear_model(self) -> list[str]:
        """Return the headings of the parts of the eigenvalues, and of the entries of A and B."""
        # A second eigenvalue of a mode has its number: "phugoid 2 eigenvalue real [1/s]".
        model = self.model
        names = self.mode_names or numbered("mode ", len(model.linear))
        headings = []
        for place, name in enumerate(names):
            number = names[: place + 1].count(name)
            called = name if number == 1 else f"{name} {number}"
            headings += eigenvalue_headings(called, model.time_unit)
        for matrix, columns in (("A", model.linear), ("B", tuple(model.inputs))):
            headings += entry_headings(model, matrix, model.linear, columns)
        return headings

    def __len__(self) -> int:
        return len(self.reasons)

    def __getitem__(self, index: Any) -> Any:
        """Return the linear model of a point, sweep[0], or the values of a name (N,),
        sweep["alpha"].

        A name is a swept variable, a state or an input.

        Raises NoSolutionError, with the reason, for a point without a trim. Raises IndexError for
        the number of a point that does not exist, and BadInputError for any other name.
        """
        if not isinstance(index, str):
            return _linear_model_at(self, index)
        known = (*self.variables, *self.model.states, *self.model.inputs)
        refuse_unknown("unknown variable", index, known)
        if index in self.variables:
            return self.values[:, self.variables.index(index)]
        return np.asarray((self.states if index in self.model.states else self.inputs)[index])

    def to_xarray(self) -> xarray.Dataset:
        """Return states, inputs, A, B, eigenvalues, limits reached and reasons over the axes.
        Requires xarray.

        The axes are those of the grid, or "point" for a list.
        """
        from trim.tables import dataset

        plan = self.plan
        axes: tuple[str, ...] = ("point",)
        if plan.listed:
            swept = {name: ("point", self.values[:, i]) for i, name in enumerate(plan.axes)}
        else:
            axes = plan.variables
            swept = {name: (name, np.array(plan.axes[name])) for name in plan.axes}
        coordinates: dict[str, Any] = {
            **swept,
            **coordinates_of(plan.condition),
        }
        if self.mode_names:
            coordinates["mode"] = list(self.mode_names)
        variables: dict[str, Any] = {"reason": (axes, np.array(self.reasons).reshape(plan.sizes))}
        for name, array in arrays_of(self.model).items():
            values = getattr(self, name)
            reshaped = values.reshape(*plan.sizes, *values.shape[1:])
            variables[name] = ((*axes, *array.axes), reshaped, array.attributes)
        swept_points = dataset(variables, coordinates, self.model.title)
        for name, unit in zip(plan.variables, plan.units, strict=True):
            swept_points[name].attrs["units"] = unit
        return swept_points

    def save(self, path: str | Path) -> None:
        """Write the report to a file, as `Report.save` does, or `to_xarray` to a .nc file.

        A .nc file (NetCDF) contains complex numbers as `NAME_real` and `NAME_imag`.
        """
        if Path(path).suffix.lower() == NETCDF:
            write_netcdf(self.to_xarray(), path)
        else:
            super().save(path)

    def to_pandas(self) -> pandas.DataFrame:
        """Return a `pandas.DataFrame` with one row for each point.

        The columns are the swept values, states, inputs, damping and frequency of each mode, and
        the reason if there is no trim.
        """
        pandas = imported("pandas", "data frames require")
        names = dict.fromkeys((*self.variables, *self.model.states, *self.model.inputs))
        columns = {name: self[name] for name in names}
        columns |= {**self._mode_columns(), "reason": list(self.reasons)}
        return pandas.DataFrame(columns)

    def _columns(self, names: Iterable[str]) -> dict[str, np.ndarray]:
        """Return name -> values (N,) of swept variables, states, inputs and mode columns."""
        of_modes = self._mode_columns()
        return {name: of_modes[name] if name in of_modes else self[name] for name in names}

    def _mode_columns(self) -> dict[str, np.ndarray]:
        """Return damping and frequency of each mode, "phugoid damping" -> (N,)."""
        columns = {}
        for mode in self.modes:
            columns[f"{mode.name} damping"] = mode.damping[:, 0]
            columns[f"{mode.name} frequency"] = mode.frequency[:, 0]
        return columns

    def _widths(self) -> np.ndarray:
        """Return the width of each line along the last variable, points."""
        count = len(self._lines())
        return np.linspace(_THIN, _THICK, count) if count > 1 else np.array([_SINGLE])

    def _lines(self) -> list[slice]:
        """Return a slice of the points for each line along the last variable."""
        size = self.plan.sizes[-1]
        return [slice(first, first + size) for first in range(0, len(self), size)]

    def at(self, **values: float) -> LinearModel:
        """Return the linear model at one value of each swept variable, as in sweep.at(speed=46.0).

        The model is trimmed at these values. The values need not be in the grid.

        Raises BadInputError if a value is missing or a name is not a swept variable, and
        NoSolutionError if there is no trim.
        """
        if {*values} != {*self.variables}:
            raise BadInputError(
                f"the names are {', '.join(values) or 'missing'}; give one value for each of "
                f"{', '.join(self.variables)}"
            )
        from trim import sweep

        plan = self.plan
        axes = {name: [value] for name, value in values.items()}
        linear: LinearModel = sweep(
            plan.model, axes, condition=plan.condition, start=plan.start, listed=plan.listed
        )[0]
        return linear


def _mode_text(eigenvalues: np.ndarray) -> str:
    """Return the eigenvalues of a mode as text: a pair with ±, a single member with its sign."""
    words = []
    for value in eigenvalues:
        paired = value.imag != 0 and value.conjugate() in eigenvalues
        if value.imag < 0 and paired:
            continue  # printed with the other member
        if value.imag and not paired:
            words.append(f"{value.real:.4f} {value.imag:+.4f}i")
        else:
            words.append(eigenvalue_text(value))
    return ", ".join(words)


def _linear_model_at(swept: Sweep, index: int) -> LinearModel:
    """Return the linear model of a point of a sweep, with its operating point."""
    count = len(swept.reasons)
    if not -count <= index < count:
        raise IndexError(f"point {index} does not exist; choose from {-count} to {count - 1}")
    index %= count
    if swept.reasons[index]:
        raise NoSolutionError(
            f"point {index} has no trim: {swept.reasons[index]}; choose a trimmed point"
        )
    values = swept.values[index]
    model = model_at(swept.model, swept.variables, values)
    condition = condition_at(swept.plan.condition, swept.variables, values)
    states = record(tuple(model.states))(*swept.states[index].tolist())
    inputs = record(tuple(model.inputs))(*swept.inputs[index].tolist())
    # states and inputs, and the outputs that replace states as variables of a trim
    values_at = OperatingPoint(states, inputs, {}, Status.TRIMMED, model).values
    problem = TrimProblem(model, condition, values_at)
    point = OperatingPoint._of(problem, problem.system.scaled(values_at), Status.TRIMMED)
    return point.linearize()


class _RowsMade(Sequence[tuple[Any, ...]]):
    """Sequence of the rows of a table, each computed when it is accessed: number -> row."""

    def __init__(self, count: int, row: Callable[[int], tuple[Any, ...]]) -> None:
        self._count = count
        self._row = row

    def __len__(self) -> int:
        return self._count

    def __getitem__(self, index: Any) -> Any:
        """Return the row with a number. Raises IndexError beyond the last one, which ends loops."""
        if not 0 <= index < self._count:
            raise IndexError(index)
        return self._row(index)
