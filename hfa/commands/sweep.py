"""The command `hfa sweep`."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from hfa.options.argument_types import array_of
from hfa.options.command import (
    Outcome,
    ProgressLine,
    Request,
    WorkerOptions,
    command,
    option,
    output_option,
    picture_option,
    provenance,
)
from hfa.options.parser import refuse
from hfa.options.points import GivenPoints, PointOptions, given_points
from hfa.options.trims import TrimInput, at_name, trim_input
from hfa_support.errors import BadInputError, warn
from trim.sweeps.result import NETCDF
from trim.sweeps.sweep import MOST_POINTS, run_plan
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
class SweepRequest(Request, PointOptions, WorkerOptions):
    """Options of `hfa sweep`."""

    output: Path | None = output_option(NETCDF, stores=(STORE,), purpose=_PURPOSE)
    picture: Path | None = picture_option("the root locus")
    resume: bool = option("continue an interrupted run with the same options", rare=True)


@command(SweepRequest, trim_input)
def sweep(request: SweepRequest, given: TrimInput) -> Outcome:
    """Trim and linearize an aircraft over a grid of conditions, and track its modes.

    Any variable of a trim (--hold speed=60:70:2) and any parameter of the aircraft
    (--hold NAME=9:11:1) can be swept. For a point without a trim, the row contains the reason. The
    exit code is 1 if no point has a trim. --resume continues an interrupted sweep into a store."""
    points = given_points(request, given)
    store = request.output
    if store is None or store.suffix.lower() != STORE:
        refuse(request, OF_A_STORE, f"requires a store; add -o FILE{STORE}")
        return _in_memory(request, points)
    refuse(request, ("picture",), "is not available for a sweep into a store; remove this option")
    return _in_store(request, store, points)


def _plan(points: GivenPoints, axes: Mapping[str, Any]) -> SweepPlan:
    """Return the plan of the sweep.

    axes: those of the points, as arrays or as ranges
    """
    model, names = points.trims.model, tuple(row.name for row in points.trims.rows)
    if points.trims.rows and not axes:
        raise BadInputError(
            "the conditions have different columns, free variables or limits; `hfa trim "
            "--conditions FILE` trims them, and a sweep requires the same columns in each row"
        )
    if not axes:
        raise BadInputError(
            f"no variable is swept; give --{at_name(model)} RANGE, --hold NAME=RANGE or "
            "--conditions FILE.csv"
        )
    condition, schedule = points.condition(), model.schedule
    is_hfa = model.about.names_schedule  # at a dihedral of 0 by default
    if is_hfa and not points.listed and schedule not in (*axes, *points.constants, *condition.free):
        warn(f"no --{schedule} is given: every point is at 0 deg")
    return SweepPlan(
        axes=axes,
        model=model,
        condition=condition,
        start=points.trims.start,
        listed=points.listed,
        names=names if any(names) else (),
    )


def _in_memory(request: SweepRequest, points: GivenPoints) -> Outcome:
    """Return the outcome of a sweep whose results are printed."""
    axes = {name: array_of(name, values, MOST_POINTS) for name, values in points.axes.items()}
    result = run_plan(_plan(points, axes), progress=ProgressLine("sweep"))
    report = result.report()
    figure: Callable[[], Figure] | None = result.figure
    notes = list(report.notes)  # printed on standard error, not below the table
    if request.picture is not None and not result.trimmed.any():
        notes.append(f"nothing to draw: {request.picture} is not written")
        figure = None
    # Other files than NetCDF are written from the report.
    is_netcdf = request.output is not None and request.output.suffix.lower() == NETCDF
    write = result.save if is_netcdf else None
    return Outcome(
        report=replace(report, notes=()),
        ok=bool(result.trimmed.any()),
        source=points.source(),
        notes=notes,
        figure=figure,
        write=write,
    )


def _in_store(request: SweepRequest, store: Path, points: GivenPoints) -> Outcome:
    """Return the outcome of a sweep into a store."""
    from trim.sweeps.store import reported_sweep

    source = points.source()
    report = reported_sweep(
        _plan(points, points.axes),  # whose ranges need not fit into memory
        store,
        workers=request.workers,
        resume=request.resume,
        provenance=provenance(request, source).to_dict(),
        progress=ProgressLine("sweep"),
    )
    return Outcome(
        report=replace(report, notes=()),
        ok=report.data["counts"]["trimmed"] > 0,
        source=source,
        notes=report.notes,
        is_written=True,
    )
