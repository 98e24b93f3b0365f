"""The command `hfa sweep`."""

from __future__ import annotations

import csv
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from hfa.options.argument_types import quantity
from hfa.options.command import Request, command, output_option, picture_option
from hfa.options.option import option, refuse
from hfa.options.output import ProgressLine
from hfa.options.plants import loaded_model
from hfa.options.ranges import Range, array_of, is_one_value, value_range
from hfa.options.show import provenance, show, show_text
from hfa.options.trims import (
    SeveralTrims,
    at_name,
    at_value,
    common_condition,
    held_values,
    trim_source,
)
from hfa.options.workers import WorkerOptions
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
class SweepRequest(Request, SeveralTrims, WorkerOptions):
    """Options of `hfa sweep`."""

    hold: Mapping[str, str] = option(
        "impose a value or a range on a variable or parameter of the aircraft; repeatable",
        "NAME=RANGE",
        named=True,
    )
    conditions: Path | None = option(
        "a .csv file of points in place of a grid: a row of names, rows of values (degrees)", "FILE"
    )
    output: Path | None = output_option(NETCDF, stores=(STORE,), purpose=_PURPOSE)
    picture: Path | None = picture_option("the root locus")


@command(SweepRequest)
def sweep(request: SweepRequest) -> int:
    """Trim and linearize an aircraft over a grid of conditions, and track its modes.

    Any variable of a trim (--hold speed=60:70:2) and any parameter of the aircraft
    (--hold NAME=9:11:1) can be swept. For a point without a trim, the row contains the reason. The
    exit code is 1 if no point has a trim. --resume continues an interrupted sweep into a store."""
    store = request.output
    if store is None or store.suffix.lower() != STORE:
        refuse(request, OF_A_STORE, f"requires a store; add -o FILE{STORE}")
        return _in_memory(request)
    refuse(request, ("picture",), "is not available for a sweep into a store; remove this option")
    return _in_store(request, store)


def _in_memory(request: SweepRequest) -> int:
    """Run a sweep whose results are printed, and return 1 if no point has a trim, otherwise 0."""
    plan, source = _plan(request, stored=False)
    result = run_plan(plan, progress=ProgressLine("sweep"))
    report = result.report()
    figure: Callable[[], Figure] | None = result.figure
    notes = list(report.notes)
    if request.picture is not None and not result.trimmed.any():
        notes.append(f"nothing to draw: {request.picture} is not written")
        figure = None
    # Notes are printed on standard error, so that standard output contains only the table.
    is_netcdf = request.output is not None and request.output.suffix.lower() == NETCDF
    write = result.save if is_netcdf else None
    show(request, replace(report, notes=()), source, figure=figure, write=write, notes=notes)
    return 0 if result.trimmed.any() else 1


def _in_store(request: SweepRequest, store: Path) -> int:
    """Run a sweep into a store, and return 1 if no point has a trim, otherwise 0."""
    from trim.sweeps.store import reported_sweep

    plan, source = _plan(request, stored=True)
    report = reported_sweep(
        plan,
        store,
        workers=request.workers,
        resume=request.resume,
        provenance=provenance(request, source).to_dict(),
        progress=ProgressLine("sweep"),
    )
    show_text(request, replace(report, notes=()), source, notes=report.notes)
    return 0 if report.data["counts"]["trimmed"] else 1


def _plan(request: SweepRequest, stored: bool) -> tuple[SweepPlan, dict[str, Any]]:
    """Return the plan of the sweep, and the entries of the provenance.

    The axes are those of a list of points, or the swept options. For a grid that is not written
    to a store, the axes with a single value come first.

    stored: whether the sweep is written to a store

    Raises BadInputError if nothing is swept or if an axis is invalid.
    """
    model = loaded_model(request)
    by = model.schedule
    at = at_value(request, model, value_range)
    hold = held_values(request, model, value_range)
    constants = {
        name: values[0]
        for name, values in hold.items()
        if is_one_value(values) and name not in model.parameters
    }
    listing = request.conditions
    condition, start = common_condition(request, model, at, {**hold, **constants})
    ranges: dict[str, Range] = {} if at is None else {by: at}
    ranges |= {name: values for name, values in hold.items() if name not in constants}
    if listing is not None:
        axes = _listed_axes(listing, condition, hold, ranges)
    elif not ranges:
        raise BadInputError(
            f"no variable is swept; give --{at_name(model)} RANGE, --hold NAME=RANGE or "
            "--conditions FILE.csv"
        )
    elif stored:
        axes = dict(ranges)
    else:
        arrays = {name: array_of(name, each, MOST_POINTS) for name, each in ranges.items()}
        axes = dict(sorted(arrays.items(), key=lambda axis: axis[1].size > 1))
    is_named = by in (*axes, *condition.free, *hold)
    if listing is None and model.about.names_schedule and not is_named:
        warn(f"no --{by} is given: every point is at 0 deg")
    plan = SweepPlan(axes, model, condition, start, listing is not None)
    return plan, trim_source(request, condition, at, hold)


def _listed_axes(
    listing: Path,
    condition: TrimCondition,
    hold: Mapping[str, Range],
    ranges: Mapping[str, Range],
) -> dict[str, Any]:
    """Return the axes of a sweep over a list of points, name -> value at each point, (N,).

    hold: values of --hold, of which constants are in the condition
    ranges: values of the options that are axes
    """
    axes: dict[str, Any] = listed_points(listing, condition)
    rows = len(next(iter(axes.values())))
    for name, values in {**hold, **ranges}.items():
        if name in axes or not is_one_value(values):
            raise BadInputError(
                f"give {name} either as a column of {listing} or by an option with one value"
            )
    for name, values in ranges.items():
        axes[name] = np.full(rows, values[0])
    return axes


def listed_points(path: Path, condition: TrimCondition) -> dict[str, np.ndarray]:
    """Return name -> value at each point, (N,), from a CSV file of trim points. A column may have a
    unit in its heading, "gamma [deg]".
    """
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
    if any(";" in title for title in title_row):
        raise BadInputError(
            f"{path}: row {header} contains a semicolon; separate the columns by commas, and write "
            "numbers with a decimal point"
        )
    headings = [name.strip().removesuffix("]").partition(" [") for name in title_row]
    names = [name for name, _, _ in headings]
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
        for column, ((name, _, unit), text) in enumerate(zip(headings, row, strict=True)):
            try:
                table[index, column] = quantity(model, name, f"{text.strip()} {unit}".strip())
            except BadInputError as error:
                raise BadInputError(f"{path}: row {number}, column {name} {error}") from error
    return dict(zip(names, table.T, strict=True))
