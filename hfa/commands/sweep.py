"""The command `hfa sweep`."""

from __future__ import annotations

import argparse
import csv
import warnings
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from hfa.options import trims
from hfa.options.argument_types import model, quantity
from hfa.options.parser import Options, command
from hfa.options.ranges import Range, array_of, value_range
from hfa.output import ProgressLine, draw, provenance, show
from hfa_support.errors import BadInputError
from hfa_support.reporting.report import Report
from trim.point.condition import TrimCondition
from trim.sweeps.sweep import MOST_POINTS, run_plan
from trim.sweeps.sweep_plan import SweepPlan

#: Suffixes of a store and of a unit of the models between the points; options that only a store
#: has.
STORE, UNIT = ".zarr", ".fmu"
OF_A_STORE = ("workers", "resume")


def _options() -> Options:
    held = "hold a variable, or a parameter of the aircraft, at a value or a range of them"
    return {
        **trims.at(
            partial(value_range, model().schedule), "RANGE", "start:stop:step, a,b,c or one number"
        ),
        **trims.flights(value_range, "RANGE", held),
        **trims.AIRCRAFT,
        **trims.picture("the root locus"),
        **trims.workers(f"sweep to {STORE}"),
        **trims.output(STORE, UNIT),
    }


@command(_options)
def sweep(arguments: argparse.Namespace) -> int:
    """Trims and linear models over a grid of conditions; modes tracked, failures kept as rows.

    Whatever a trim can hold can be swept, --hold speed=60:70:2, and any parameter of the aircraft,
    --hold panel_mass=9:11:1. What else a trim imposes, frees and limits is typed as in `hfa trim`.
    Exit code 1 when no point has a trim.

    -o FILE.fmu writes the models between the points of a grid as an FMU; its inputs are those of
    the aircraft and the swept variables. A sweep that outgrows memory goes to a Zarr store (-o
    FILE.zarr): any number of points, several processes or machines (--workers), and it can be
    continued after an interruption (--resume)."""
    suffix = "" if arguments.output is None else arguments.output.suffix.lower()
    stored = suffix == STORE
    if stored:
        why = "does not go with a store, which holds all seven states, in feet, and no picture"
        trims.refuse(arguments, ("picture", "units"), why)
    else:
        trims.refuse(arguments, OF_A_STORE, f"needs a store; add -o FILE{STORE}")
    plan = _plan(arguments, stored)
    report, trimmed = (_in_store if stored else _in_memory)(plan, arguments)
    # The notes on standard error: the table on standard output stays a table.
    show(replace(report, notes=()), arguments, written=suffix in (STORE, UNIT), notes=report.notes)
    return 0 if trimmed else 1


def _plan(arguments: argparse.Namespace, stored: bool) -> SweepPlan:
    """What is swept; what stays fixed comes first, because it is not drawn."""
    listing = arguments.condition if isinstance(arguments.condition, Path) else None
    if listing is not None:
        arguments.condition = None
    condition, aircraft, by = (
        trims.flights_of(arguments),
        trims.aircraft_of(arguments),
        model().schedule,
    )
    held: dict[str, Range] = {} if arguments.at is None else {by: arguments.at}
    held |= {
        name: each for name, each in arguments.hold.items() if not trims.is_constant(name, each)
    }
    if listing is not None:
        axes: dict[str, Any] = _listed(listing, condition)
        for name, values in {**arguments.hold, **held}.items():
            if name in axes or not (isinstance(values, tuple) and len(values) == 1):
                raise BadInputError(
                    f"{name} has a column or a range beside the list {listing}; give one value"
                )
        rows = len(next(iter(axes.values())))
        axes |= {
            name: np.full(rows, values[0])
            for name, values in held.items()
            if isinstance(values, tuple)
        }
    elif not held:
        raise BadInputError("nothing to sweep; give --dihedral RANGE or --hold NAME=RANGE")
    elif stored:
        axes = dict(held)
    else:
        axes = {name: array_of(name, values, MOST_POINTS) for name, values in held.items()}
        axes = dict(sorted(axes.items(), key=lambda axis: axis[1].size > 1))
    if (
        arguments.picture is not None
        and len(varied := [name for name, each in axes.items() if np.ptp(each) > 0]) > 1
    ):
        raise BadInputError(
            f"--picture draws a sweep in one variable, not in {' and '.join(varied)}; fix all but one"
        )
    if listing is None and by == "dihedral" and by not in (*axes, *condition.free, *arguments.hold):
        warnings.warn("no --dihedral is given: every point is at 0 deg", stacklevel=2)
    return SweepPlan(axes, aircraft, condition, trims.start_of(arguments), listing is not None)


def _listed(path: Path, condition: TrimCondition) -> dict[str, np.ndarray]:
    """The columns of a CSV file of conditions: a header of names, then a row a point, typed as in
    --hold (degrees).

    BadInputError names the row, the header being row 1, and the column.
    """
    try:
        lines = path.read_text("utf-8-sig").splitlines()
        names, *rows = [row for row in csv.reader(lines) if any(map(str.strip, row))] or [[]]
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise BadInputError(
            f"{path}: cannot be read ({error}); give a CSV file of conditions"
        ) from error
    names, of = [name.strip() for name in names], condition.model
    if not rows or len({*names}) < len(names):
        raise BadInputError(
            f"{path}: give a row of names, each once, and a row of their values for each point"
        )
    for name in names:
        of.refuse_unheld(f"{path}: the column of row 1 is unknown:", name, tuple(of.parameters))
    table = np.empty((len(rows), len(names)))
    for place, row in enumerate(rows):
        if len(row) != len(names):
            raise BadInputError(
                f"{path}: row {place + 2} has {len(row)} cells for {len(names)} columns; correct it"
            )
        for column, (name, text) in enumerate(zip(names, row, strict=True)):
            try:
                table[place, column] = quantity(name, text)
            except BadInputError as error:
                raise BadInputError(f"{path}: row {place + 2}, column {name} {error}") from error
    return dict(zip(names, table.T, strict=True))


def _in_memory(plan: SweepPlan, arguments: argparse.Namespace) -> tuple[Report, bool]:
    """The report, with the picture drawn, and whether any point has a trim."""
    result = run_plan(plan, progress=ProgressLine("sweep"))
    report = result.report()
    if arguments.picture is not None and not result.trimmed.any():
        report = replace(
            report, notes=[*report.notes, f"nothing to draw: {arguments.picture} is not written"]
        )
    else:
        draw(arguments, result.figure)
    if arguments.output is not None and arguments.output.suffix.lower() == UNIT:
        from controller.export.exported_loop import interpolated_loop
        from controller.export.fmu import write_fmu
        from trim.sweeps.interpolated import InterpolatedModel

        write_fmu(
            interpolated_loop(InterpolatedModel(result)), arguments.output, provenance(arguments)
        )
    return report, bool(result.trimmed.any())


def _in_store(plan: SweepPlan, arguments: argparse.Namespace) -> tuple[Report, bool]:
    """The report of the store, and whether any point has a trim."""
    from trim.sweeps.sweep_store import stored_sweep_report, stream_sweep

    dataset = stream_sweep(
        plan,
        arguments.output,
        workers=arguments.workers.get("scheduler", arguments.workers.get("count", 1)),
        resume=arguments.resume,
        provenance=provenance(arguments).to_dict(),
        progress=ProgressLine("sweep"),
    )
    report = stored_sweep_report(plan, dataset, arguments.output)
    return report, bool(report.data["counts"]["trimmed"])
