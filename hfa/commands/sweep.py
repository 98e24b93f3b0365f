"""The command `hfa sweep`."""

from __future__ import annotations

import csv
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from hfa.options.aircraft import Aircraft
from hfa.options.argument_types import quantity
from hfa.options.output import Output, ProgressLine, output_option, picture_option
from hfa.options.part import OfModel, option, part
from hfa.options.ranges import Range, array_of, is_one_value, scheduled_range, value_range
from hfa.options.request import Request, command
from hfa.options.trim import Trim, called_at, condition_help, condition_or_list, scheduled
from hfa.options.workers import Workers
from hfa_support.errors import BadInputError, warn
from hfa_support.files import regular_file
from trim.point.condition import TrimCondition
from trim.sweeps.sweep import MOST_POINTS, NETCDF, run_plan
from trim.sweeps.sweep_plan import SweepPlan

if TYPE_CHECKING:
    from matplotlib.figure import Figure

#: Options that are available only for a store.
OF_A_STORE = ("workers", "resume")
#: Suffix of a store.
STORE = ".zarr"
_PURPOSE = (
    f" ({STORE}: store of a sweep larger than memory, or by several processes or machines "
    "(--workers))"
)


@dataclass(frozen=True, kw_only=True, eq=False)
class SweptTrim(Trim):
    """The conditions of a sweep over a grid or a list of points."""

    at: Range | None = scheduled(
        scheduled_range, "RANGE", "a number, a list a,b,c or a range start:stop:step"
    )
    hold: Mapping[str, Range] = option(
        "impose a value or a range on a variable or parameter of the aircraft; repeatable",
        "NAME=RANGE",
        OfModel(value_range),
        named=True,
    )
    given: TrimCondition | Path | None = option(
        lambda model: (
            f"{condition_help(model)}, or a .csv file of points: a row of names, rows of values"
        ),
        "FILE",
        OfModel(condition_or_list),
        names="--condition",
        rare=True,
    )

    @cached_property
    def common_condition(self) -> TrimCondition:
        """Trim condition shared by all points, without the variables that a list of points sets."""
        if isinstance(self.given, Path):
            return replace(self, given=None).common_condition
        return super().common_condition

    def plan(self, stored: bool) -> SweepPlan:
        """Return the plan of the sweep: axes, aircraft and trim condition.

        The axes are those of a list of points, or the swept options. For a grid that is not written
        to a store, the axes with a single value come first.

        stored: whether the sweep is written to a store

        Raises BadInputError if nothing is swept or if an axis is invalid.
        """
        listing = self.given if isinstance(self.given, Path) else None
        condition = self.common_condition
        by = self.model.schedule
        ranges: dict[str, Range] = {} if self.at is None else {by: self.at}
        ranges |= {name: values for name, values in self.hold.items() if not self.is_constant(name)}
        if listing is not None:
            axes = self._listed_axes(listing, condition, ranges)
        elif not ranges:
            raise BadInputError(
                f"no variable is swept; give --{called_at(self.model)} RANGE or --hold NAME=RANGE"
            )
        elif stored:
            axes = dict(ranges)
        else:
            arrays = {name: array_of(name, each, MOST_POINTS) for name, each in ranges.items()}
            axes = dict(sorted(arrays.items(), key=lambda axis: axis[1].size > 1))
        is_named = by in (*axes, *condition.free, *self.hold)
        if listing is None and self.model.about.names_schedule and not is_named:
            warn(f"no --{by} is given: every point is at 0 deg")
        return SweepPlan(axes, self.aircraft, condition, self.start_point, listing is not None)

    def _listed_axes(
        self, listing: Path, condition: TrimCondition, ranges: Mapping[str, Range]
    ) -> dict[str, Any]:
        """Return the axes of a sweep over a list of points, name -> value at each point, (N,).

        ranges: values of the options that are axes; constants of --hold are in the condition
        """
        axes: dict[str, Any] = _listed(listing, condition)
        rows = len(next(iter(axes.values())))
        for name, values in {**self.hold, **ranges}.items():
            if name in axes or not is_one_value(values):
                raise BadInputError(
                    f"give {name} either as a column of {listing} or by an option with one value"
                )
        for name, values in ranges.items():
            axes[name] = np.full(rows, values[0])
        return axes


@dataclass(frozen=True, kw_only=True, eq=False)
class SweepRequest(Request):
    """Options of `hfa sweep`."""

    aircraft: Aircraft = part(Aircraft)
    trim: SweptTrim = part(SweptTrim)
    processes: Workers = part(Workers)
    output: Output = part(
        Output,
        file=output_option(NETCDF, stores=(STORE,), purpose=_PURPOSE),
        picture=picture_option("the root locus"),
    )


@command(SweepRequest)
def sweep(request: SweepRequest) -> int:
    """Trim and linearize an aircraft over a grid of conditions, and track its modes.

    Any variable of a trim (--hold speed=60:70:2) and any parameter of the aircraft
    (--hold NAME=9:11:1) can be swept. For a point without a trim, the row contains the reason. The
    exit code is 1 if no point has a trim. --resume continues an interrupted sweep into a store."""
    store = request.output.file
    if store is None or store.suffix.lower() != STORE:
        request.processes.refuse(OF_A_STORE, f"requires a store; add -o FILE{STORE}")
        return _in_memory(request)
    request.output.refuse(
        ("picture",), "is not available for a sweep into a store; remove this option"
    )
    return _in_store(request, store)


def _in_memory(request: SweepRequest) -> int:
    """Run a sweep whose results are printed, and return 1 if no point has a trim, otherwise 0."""
    plan = request.trim.plan(stored=False)
    picture = request.output.picture
    result = run_plan(plan, progress=ProgressLine("sweep"))
    report = result.report()
    figure: Callable[[], Figure] | None = result.figure
    notes = list(report.notes)
    if picture is not None and not result.trimmed.any():
        notes.append(f"nothing to draw: {picture} is not written")
        figure = None
    # Notes are printed on standard error, so that standard output contains only the table.
    is_netcdf = request.output.file is not None and request.output.file.suffix.lower() == NETCDF
    write = result.save if is_netcdf else None
    request.show(replace(report, notes=()), figure=figure, write=write, notes=notes)
    return 0 if result.trimmed.any() else 1


def _in_store(request: SweepRequest, store: Path) -> int:
    """Run a sweep into a store, and return 1 if no point has a trim, otherwise 0."""
    from trim.sweeps.store import reported_sweep

    report = reported_sweep(
        request.trim.plan(stored=True),
        store,
        workers=request.processes.workers,
        resume=request.processes.resume,
        provenance=request.provenance.to_dict(),
        progress=ProgressLine("sweep"),
    )
    request.print(replace(report, notes=()), notes=report.notes)
    return 0 if report.data["counts"]["trimmed"] else 1


def _listed(path: Path, condition: TrimCondition) -> dict[str, np.ndarray]:
    """Return name -> value at each point, (N,), from a CSV file of trim points."""
    try:
        lines = regular_file(path).read_text("utf-8-sig").splitlines()
        numbered_rows = [
            (number, row)
            for number, row in enumerate(csv.reader(lines), start=1)
            if any(cell.strip() for cell in row)
        ]
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise BadInputError(
            f"{path} cannot be read ({error}); give a readable CSV file of conditions"
        ) from error
    header, title_row = numbered_rows[0] if numbered_rows else (1, [])
    names = [name.strip() for name in title_row]
    point_rows = numbered_rows[1:]
    model = condition.model
    if not point_rows or len({*names}) < len(names):
        raise BadInputError(
            f"{path}: row {header} contains a name twice, or no values follow; give a row of "
            "different names, then a row of values for each point"
        )
    for name in names:
        what = f"{path}: the column of row {header} is unknown:"
        model.refuse_unheld(what, name, tuple(model.parameters))
    table = np.empty((len(point_rows), len(names)))
    for index, (number, row) in enumerate(point_rows):
        if len(row) != len(names):
            raise BadInputError(
                f"{path}: row {number} has {len(row)} cells, but row {header} has {len(names)}; "
                "correct the row"
            )
        for column, (name, text) in enumerate(zip(names, row, strict=True)):
            try:
                table[index, column] = quantity(model, name, text)
            except BadInputError as error:
                raise BadInputError(f"{path}: row {number}, column {name} {error}") from error
    return dict(zip(names, table.T, strict=True))
