"""Trims and linear models of the conditions of a file, each as its row asks for."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from operator import attrgetter
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from hfa_aircraft.model import Model
from hfa_support.errors import BadInputError, NoSolutionError, refuse_unknown
from hfa_support.files import folder_written_whole
from hfa_support.progress import Progress
from hfa_support.reporting.parts import NO_RECORDS
from hfa_support.reporting.report import Report, Reported
from hfa_support.reporting.results import Entries, Result, Stack, json_text, save_data, storable
from hfa_support.reporting.rows import stated_level, with_names
from hfa_support.reporting.text import Table, eigenvalue_text, shown_values, with_shown_unit
from trim.linear.linear_model import MATRICES, OFFSETS, LinearModel
from trim.linear.linearize import direct_disturbances
from trim.linear.modes import Mode
from trim.point.condition import StatedValues, stated_cells
from trim.point.margins import stalled
from trim.point.operating_point import OperatingPoint
from trim.point.status import CATEGORY, CLASS, NAME, RESULTS, STALLED, TRIMMED, UNTRIMMED
from trim.reports.levels import DEFAULT_AIRPLANE, Airplane, graded_modes
from trim.reports.linear_report import report_of_linear, reported_matrices
from trim.reports.trimmed import Trimmed
from trim.tables import dataset, eigenvalue_headings, entry_headings

if TYPE_CHECKING:
    import pandas
    import xarray

#: Suffixes of data that are no document.
_DATA = (".json", ".mat", ".csv")


class AskedTrim(NamedTuple):
    """Trim that a condition asks for.

    name: name of the condition, or its number in the file
    stated: what the condition states
    trim: function that returns the trim
    where: file and row, for messages, or ""
    airplane: class and category for the levels
    """

    name: str
    stated: StatedValues
    trim: Callable[[], OperatingPoint]
    where: str = ""
    airplane: Airplane = DEFAULT_AIRPLANE

    @property
    def airplane_cells(self) -> dict[str, str]:
        """Heading -> cell of class and category, as far as they are not the default."""
        return {
            heading: text
            for heading, text, usual in zip(
                (CLASS, CATEGORY), self.airplane, DEFAULT_AIRPLANE, strict=True
            )
            if text != usual
        }


class Signals(NamedTuple):
    """Names of the states (n), inputs (m), outputs (k) and disturbances (l) of linear models."""

    states: tuple[str, ...]
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    disturbances: tuple[str, ...]

    def axes(self, model: Model) -> dict[str, tuple[str, ...]]:
        """Return axis of an array -> names of its entries: "state" of the linear models,
        "trim_state" of the trims.
        """
        named = {kind.removesuffix("s"): names for kind, names in self._asdict().items()}
        groups = {"state": model.states, "input": model.inputs, "parameter": model.parameters}
        trims = {f"trim_{axis}": tuple(signals) for axis, signals in groups.items()}
        return named | trims


#: Vector -> its axis, and the attribute of a linear model with this vector.
_VECTORS = OFFSETS | {
    "trim_states": (("trim_state",), "point.x"),
    "trim_inputs": (("trim_input",), "point.u"),
    "trim_parameters": (("trim_parameter",), "model.p"),
}


@dataclass(frozen=True, eq=False, repr=False)
class Conditions(Result, Reported):
    """Trims and linear models of N conditions, which may hold and free different variables.

    conditions["cruise"] and conditions[0] are operating points, and
    conditions.A["alpha", "pitch_rate"] has an entry of A at each condition. Signals are the same at
    all conditions. Arrays are nan at conditions without a trim.

    model: model of the aircraft as loaded.
    asked: what the conditions ask for.
    signals: names of the signals of the linear models.
    points: operating point of each condition, or None without a trim.
    linear: linear model of each condition, or None without a trim.
    reasons: "" for a trim, otherwise the reason why there is none.
    A: (N, n, n), B: (N, n, m), C: (N, k, n), D: (N, k, m), E: (N, n, l), F: (N, k, l).
    """

    schema = "hfa.conditions/1"

    model: Model
    asked: tuple[AskedTrim, ...]
    signals: Signals
    points: tuple[OperatingPoint | None, ...]
    linear: tuple[LinearModel | None, ...]
    reasons: tuple[str, ...]
    A: Stack
    B: Stack
    C: Stack
    D: Stack
    E: Stack
    F: Stack

    @property
    def names(self) -> tuple[str, ...]:
        """Name of each condition."""
        return tuple(asked.name for asked in self.asked)

    @cached_property
    def status(self) -> tuple[str, ...]:
        """Status of each condition: "trimmed", "stalled" (beyond the largest lift) or "no trim"."""
        x, u, p = (self._vectors[f"trim_{kind}"] for kind in ("states", "inputs", "parameters"))
        words = np.where(stalled(self.model, x, u, p), STALLED, TRIMMED).tolist()
        results = zip(words, self.reasons, strict=True)
        return tuple(UNTRIMMED if reason else word for word, reason in results)

    @cached_property
    def modes(self) -> tuple[tuple[Mode, ...], ...]:
        """Modes of each condition, fastest first; () without a trim."""
        return tuple(() if linear is None else tuple(linear.modes) for linear in self.linear)

    @cached_property
    def levels(self) -> tuple[dict[str, int | None], ...]:
        """Mode -> its worst level by MIL-F-8785C at each condition: 4 below level 3, None without a
        limit. A class that a condition does not state is that of `chosen_airplane`.
        """
        return tuple(
            {} if linear is None else _levels(linear, asked.airplane)
            for linear, asked in zip(self.linear, self.asked, strict=True)
        )

    @property
    def warnings(self) -> list[str]:
        """Notes on the trims and linear models, but of nonsmooth points only their number."""
        known = [linear for linear in self.linear if linear is not None]
        said = [
            note
            for linear in known
            for note in linear.warnings
            if not any(note in nonsmooth for nonsmooth in linear.nonsmooth_points)
        ]
        if count := sum(bool(linear.nonsmooth_points) for linear in known):
            said.append(f"{count} of {len(self)} conditions have a nonsmooth point: mean slopes")
        return [*dict.fromkeys(said)]

    def __len__(self) -> int:
        return len(self.asked)

    def __iter__(self) -> Iterator[str]:
        """Yield the names of the conditions."""
        return iter(self.names)

    def keys(self) -> tuple[str, ...]:
        """Return the names of the conditions."""
        return self.names

    def __getitem__(self, index: str | int) -> OperatingPoint:
        """Return the operating point of a condition by name or number.

        Raises BadInputError for an unknown name, IndexError for a number that does not exist, and
        NoSolutionError, with the reason, for a condition without a trim.
        """
        if isinstance(index, str):
            refuse_unknown("unknown condition", index, self.names)
            index = self.names.index(index)
        point = self.points[index]
        if point is None:
            raise NoSolutionError(f"{self.names[index]}: {self.reasons[index]}")
        return point

    # Files.

    @property
    def _axes(self) -> dict[str, tuple[str, ...]]:
        """Axis of `arrays`, other than the condition and the mode -> names of its signals."""
        return self.signals.axes(self.model)

    @cached_property
    def _vectors(self) -> dict[str, np.ndarray]:
        """Offsets and trims of all conditions, by the names of `_VECTORS`."""
        return stacked(self.linear, _VECTORS, self._axes)

    def _named_signals(self) -> dict[str, Any]:
        """Return the entries of files with the names and units of the signals."""
        # `signals` has the names on axes of linear models. Only axes of trims have an underscore,
        # "trim_state".
        trims = {f"{axis}_names": names for axis, names in self._axes.items() if "_" in axis}
        units = {f"{axis}_units": self.model.units(names) for axis, names in self._axes.items()}
        return self.signals._asdict() | trims | units

    def _entries(self) -> dict[str, Any]:
        """Return the entries of the file, name -> value: what each condition asks for, and its row
        of `arrays`.
        """
        models = [
            {"name": asked.name, "condition": asked.stated}
            | {name: array[row] for name, (_, array) in self.arrays.items()}
            for row, asked in enumerate(self.asked)
        ]
        return {"dynamics": self.model.name, **self._named_signals(), "models": models}

    def report(self) -> Report:
        """Return a report with the status and the eigenvalues of the modes of each condition, and
        the reason of each that has no trim.
        """
        return replace(self._summary, records=self.records())

    @cached_property
    def _summary(self) -> Report:
        """The report without records, which take time for many conditions and serve .csv files
        alone. Its data are computed when they are read.
        """
        reasons = dict(zip(self.names, self.reasons, strict=True))
        failed = [f"{name}: {reason}" for name, reason in reasons.items() if reason]
        words = [f"linear models of {len(self) - len(failed)} of {len(self)} conditions"]
        if stalls := self.status.count(STALLED):
            words.append(f"{stalls} stalled")
        if failed:
            words.append(f"{len(failed)} without a trim")
        return Report(
            title=f"{self.model.title}: {', '.join(words)}",
            parts=(self._mode_table(), *failed),
            data=Entries(self),
            notes=self.warnings,
            failure=f"{len(failed)} of {len(self)} conditions have no trim" if failed else "",
        )

    def _mode_table(self) -> Table:
        """Return the table of the eigenvalues of the modes of each condition."""
        values = [
            {mode.name: eigenvalue_text(mode.eigenvalue) for mode in modes} for modes in self.modes
        ]
        names = [*dict.fromkeys(name for texts in values for name in texts)]
        return Table(
            ("condition", RESULTS, *(f"{name} 1/{self.model.time_unit}" for name in names)),
            [
                (name, status, *(texts.get(mode, "") for mode in names))
                for name, status, texts in zip(self.names, self.status, values, strict=True)
            ],
        )

    def records(self) -> Table:
        """Return a table with a row for each condition, a file of conditions: what it asks for, the
        result, the reason, the trim, the modes with their levels, and the entries of A and B, of C
        and D if the outputs are not the states, and of E and F of the disturbances.

        Angles are in degrees, but those of A to F in radians.
        """
        asked = [
            {NAME: row.name, **row.airplane_cells} | stated_cells(self.model, row.stated)
            for row in self.asked
        ]
        found = [self._found_cells(row) for row in range(len(self))]
        header = [*dict.fromkeys(heading for cells in (*asked, *found) for heading in cells)]
        whole = [condition | result for condition, result in zip(asked, found, strict=True)]
        rows = [tuple(cells.get(heading, "") for heading in header) for cells in whole]
        return Table(tuple(header), rows)

    def _found_cells(self, row: int) -> dict[str, Any]:
        """Return heading -> cell of what was found at a condition: its trim and linear model."""
        model, point = self.model, self.points[row]
        cells: dict[str, Any] = {RESULTS: self.status[row], "failure": self.reasons[row]}
        for name in (*model.states, *model.inputs):
            unit = model.unit(name)
            value = math.nan if point is None else point.values[name]
            cells[with_shown_unit(name, unit)] = float(shown_values(value, unit))
        for mode in self.modes[row]:
            parts = mode.eigenvalue.real, mode.eigenvalue.imag
            cells |= zip(eigenvalue_headings(mode.name, model.time_unit), parts, strict=True)
            level = self.levels[row].get(mode.name)
            cells[f"{mode.name} level"] = "" if level is None else stated_level(level)
        for matrix in reported_matrices(self.signals):
            stack = getattr(self, matrix)
            headings = entry_headings(model, matrix, *stack.names[1:])
            cells |= zip(headings, stack[row].ravel().tolist(), strict=True)
        return cells

    def to_pandas(self) -> pandas.DataFrame:
        """Return a `pandas.DataFrame` of `records`, indexed by the names of the conditions."""
        return super().to_pandas().set_index(NAME)

    @cached_property
    def arrays(self) -> dict[str, tuple[tuple[str, ...], np.ndarray]]:
        """Name -> (axes, array) of the results, with the condition as the first axis.

        They are status and reason; A to F; X0, U0 and Y0; states, inputs and parameters of the
        trims; and the eigenvalues, with the names of their modes and their levels.
        """
        n = len(self.signals.states)
        arrays: dict[str, Any] = {
            name: ((), np.array(words, dtype=object))
            for name, words in (("status", self.status), ("reason", self.reasons))
        }
        stacks = {name: getattr(self, name) for name in MATRICES} | self._vectors
        for name, (axes, _) in (MATRICES | _VECTORS).items():
            arrays[name] = axes, np.asarray(stacks[name])

        # Eigenvalues at all conditions, with the names and levels of their modes.
        roots = np.full((len(self), n), complex(math.nan, math.nan))
        names = np.full((len(self), n), "", dtype=object)
        levels = np.full((len(self), n), math.nan)
        for row, modes in enumerate(self.modes):
            # A complex mode has two roots; both entries of the pair of a real one are the same key.
            each_root = [
                (root, mode.name, self.levels[row].get(mode.name) or math.nan)
                for mode in modes
                for root in dict.fromkeys((mode.eigenvalue, mode.eigenvalue.conjugate()))
            ]
            if modes:
                roots[row], names[row], levels[row] = zip(*each_root, strict=True)
        of_modes = {"eigenvalues": roots, "mode_names": names, "mode_levels": levels}
        arrays |= {name: (("mode",), array) for name, array in of_modes.items()}
        return {name: (("condition", *axes), array) for name, (axes, array) in arrays.items()}

    def to_xarray(self) -> xarray.Dataset:
        """Return `arrays` with the names of conditions and signals, and units. Requires xarray."""
        model = self.model
        words = partial(np.array, dtype=object)  # of any length
        coordinates: dict[str, Any] = {
            axis: (axis, words(names), {"units": [*model.units(names)]})
            for axis, names in self._axes.items()
        }
        coordinates |= {"condition": words(self.names), "rate": words(self.signals.states)}
        return dataset(self.arrays, coordinates, model.title)

    def save(self, path: str | Path, provenance: Mapping[str, Any] | None = None) -> None:
        """Write the conditions to a file.

        - .json, .mat: the linear models as a list, or an array of structs, `models`
        - .npz: `arrays`, with the names and units of the signals
        - .zarr: `to_xarray`
        - .csv: `records`
        - .html, .pdf, .tex, .md: the report, with a page of A to F for each linear model

        provenance: provenance of the results, or None

        Raises BadInputError for another suffix, and for a store that exists.
        """
        path = Path(path)
        suffix = path.suffix.lower()
        origin = {"provenance": dict(provenance)} if provenance else {}
        if suffix == ".zarr":
            attributes = {name: json_text(entry) for name, entry in origin.items()}
            with folder_written_whole(path) as folder:
                self.to_xarray().assign_attrs(attributes).to_zarr(folder, consolidated=False)
            return
        if suffix == ".npz":
            arrays = {
                name: array.astype(str) if array.dtype == object else array
                for name, (_, array) in self.arrays.items()
            }
            head = {"schema": self.schema, "names": [*self.names]} | self._named_signals()
            save_data(path, storable(head) | arrays | origin, records=Table((), ()))
            return
        # Records serve .csv files alone, and take time: other files are of the report without.
        report = self.report() if suffix == ".csv" else self._summary
        if suffix not in _DATA:
            report = replace(report, parts=(*report.parts, *self._pages()))
        report.with_data(origin).save(path)

    def _pages(self) -> Iterator[Report]:
        """Yield the report of each linear model, with all matrices."""
        for number, (name, linear) in enumerate(zip(self.names, self.linear, strict=True), 1):
            if linear is not None:
                page = report_of_linear(linear, responses=False, beside=None, whole=True)
                yield replace(page, title=f"{number} {name}: {page.title}", records=NO_RECORDS)


def stacked(
    models: Sequence[LinearModel | None],
    table: Mapping[str, tuple[tuple[str, ...], str]],
    names: Mapping[str, tuple[str, ...]],
) -> dict[str, np.ndarray]:
    """Return name -> array (N, ...) of an attribute of N linear models, nan where one is None.

    table: name -> axes of the attribute of one model, and the attribute
    names: axis -> names of its entries; rates have the names of the states
    """
    arrays: dict[str, np.ndarray] = {}
    for name, (axes, attribute) in table.items():
        of_axes = [names[axis.replace("rate", "state")] for axis in axes]
        stack = np.full((len(models), *map(len, of_axes)), math.nan)
        for row, linear in enumerate(models):
            if linear is not None:
                stack[row] = attrgetter(attribute)(linear)
        arrays[name] = with_names(stack, (), *of_axes)
    return arrays


def _levels(linear: LinearModel, airplane: Airplane) -> dict[str, int | None]:
    """Return mode -> the worst level of its qualities, or None if the standard has no limit."""
    return {
        mode.name: max((row.level for row in qualities if row.level is not None), default=None)
        for mode, qualities in graded_modes(Trimmed(linear.point), airplane)
    }


def linear_models(
    model: Model,
    asked: Sequence[AskedTrim],
    *,
    states: Sequence[str] | None = None,
    inputs: Sequence[str] | None = None,
    outputs: Sequence[str] | None = None,
    progress: Progress | None = None,
) -> Conditions:
    """Return the trims and linear models of conditions, each as `trim` and `linearize` find it.

    model: model of the aircraft as loaded
    states, inputs, outputs: as in `linearize`, for each linear model
    progress: called with (finished conditions, all conditions), or None

    Raises BadInputError for an unknown name, and if each condition is refused.
    """
    points: list[OperatingPoint | None] = []
    reasons = []
    refused = []  # messages of conditions that are wrong, not without a trim
    for done, row in enumerate(asked, start=1):
        point, reason = None, ""
        try:
            point = row.trim()
        except (BadInputError, NoSolutionError) as error:
            reason = str(error)
            if isinstance(error, BadInputError):
                refused.append(": ".join(filter(None, (row.where, reason))))
        points.append(point)
        reasons.append(reason)
        if progress is not None:
            progress(done, len(asked))
    if len(refused) == len(asked):
        raise BadInputError(refused[0])

    kept = tuple(states or model.linear)
    # All models have the same columns. Which disturbances act through lags is a property of the
    # equations, and thus the same at each trim.
    first = next((point for point in points if point is not None), None)
    disturbances = () if first is None else direct_disturbances(first, kept)
    signals = Signals(kept, tuple(inputs or model.inputs), tuple(outputs or kept), disturbances)
    chosen = {"states": states, "inputs": inputs, "outputs": outputs, "disturbances": disturbances}
    linear = tuple(None if point is None else point.linearize(**chosen) for point in points)
    matrices = stacked(linear, MATRICES, signals.axes(model))
    return Conditions(
        model, tuple(asked), signals, tuple(points), linear, tuple(reasons), **matrices
    )
