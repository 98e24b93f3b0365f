"""Trims and linear models over a grid of conditions; modes tracked, failures kept as rows.

Whatever a trim can hold can be swept, --hold speed=60:70:2, and any parameter of the aircraft, --hold
panel_mass=9:11:1. What else a trim imposes, frees and limits is typed as in `hfa trim`.

-o FILE.fmu writes the models between the points of a grid as an FMU; its inputs are those of the aircraft and the swept
variables. A sweep that outgrows memory goes to a Zarr store (-o FILE.zarr): any number of points, several
processes or machines (--workers), and it can be continued after an interruption (--resume).
"""

from __future__ import annotations

import argparse
import warnings
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from hfa_cli.options import shared_options as options
from hfa_cli.options.games import add_weights, weights_of
from hfa_cli.options.parser import add_value
from hfa_cli.options.ranges import Range, array_of, listed_conditions, value_range
from hfa_cli.origin import provenance
from hfa_cli.output import draw, show
from hfa_cli.progress import ProgressLine, say_notes
from hfa_support.errors import BadInputError
from hfa_support.reporting.report import Report
from trim.sweeps.points import condition_at
from trim.sweeps.sweep import MOST_POINTS, run_plan, stored_sweep_report, stream_sweep
from trim.sweeps.sweep_plan import SweepPlan

#: Suffixes of a store and of a unit of the models between the points; options that only a store and only a game has.
STORE, UNIT = ".zarr", ".fmu"
OF_A_GAME = ("delta", "Q", "R")
OF_A_STORE = ("workers", "resume")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options of `hfa sweep`."""
    about = "start:stop:step, a,b,c or one number, degrees; default 0"
    add_value(parser, "--dihedral", partial(value_range, "dihedral"), "RANGE", about)
    about = "hold a variable, or a parameter of the aircraft, at a value or a range of them; repeatable"
    options.add_changes(parser, value_range, "RANGE", about)
    options.add_picture(parser, "the root locus")
    options.add_own(parser)
    options.add_aircraft(parser)
    parser.add_argument("--game", action="store_true", help="solve the game at every point: K, delta_min, margins")
    add_weights(parser)
    options.add_output(parser, STORE, UNIT)
    store = parser.add_argument_group(f"for a store (-o FILE{STORE})")
    options.add_workers(store, "sweep")


def run(arguments: argparse.Namespace) -> int:
    """Sweep and report; exit 1 when no point has a trim."""
    listing = arguments.condition if isinstance(arguments.condition, Path) else None
    if listing is not None:
        arguments.condition = None
    ranges = _ranges(arguments, listing)
    stored = arguments.output is not None and arguments.output.suffix.lower() == STORE
    if stored:
        why = "does not go with a store, which holds all seven states, in feet, no picture and no games"
        options.refuse(arguments, ("picture", "units", "game", *OF_A_GAME), why)
    else:
        options.refuse(arguments, OF_A_STORE, f"needs a store; add -o FILE{STORE}")
        if not arguments.game:
            options.refuse(arguments, OF_A_GAME, "needs the game; add --game")
    plan = _plan(arguments, ranges, stored, listing)
    report, trimmed = (_in_store if stored else _in_memory)(plan, arguments)
    # The notes on standard error: the table on standard output stays a table.
    written = stored or (arguments.output is not None and arguments.output.suffix.lower() == UNIT)
    show(replace(report, notes=()), arguments, target=None if written else arguments.output)
    say_notes(report.notes)
    return 0 if trimmed else 1


def _plan(arguments: argparse.Namespace, ranges: dict[str, Range], stored: bool, listing: Path | None) -> SweepPlan:
    """What is swept; what stays fixed comes first, because it is not drawn."""
    condition, own = options.swept_condition_of(arguments), options.own_of(arguments)
    if listing is not None:
        axes: dict[str, Any] = listed_conditions(listing, condition)
        rows = len(next(iter(axes.values())))
        for name, values in {**(arguments.hold or {}), **ranges}.items():
            if name in axes or not (isinstance(values, tuple) and len(values) == 1):
                raise BadInputError(f"{name} has a column or a range beside the list {listing}; give one value")
            if name in ranges:
                axes[name] = np.full(rows, values[0])
    elif stored:
        axes = dict(ranges)
    else:
        axes = {name: array_of(name, values, MOST_POINTS) for name, values in ranges.items()}
        axes = dict(sorted(axes.items(), key=lambda axis: axis[1].size > 1))
    if not stored:
        varied = [name for name, values in axes.items() if np.ptp(values) > 0]
        if arguments.picture is not None and len(varied) > 1:
            raise BadInputError(
                f"--picture draws a sweep in one variable, not in {' and '.join(varied)}; fix all but one"
            )
    aircraft = own if own is not None else options.aircraft_of(arguments)
    return SweepPlan(axes, aircraft, condition, options.start_of(arguments), listing is not None)


def _in_memory(plan: SweepPlan, arguments: argparse.Namespace) -> tuple[Report, bool]:
    """The report, with the picture drawn and the games solved, and whether any point has a trim."""
    result = run_plan(plan, progress=ProgressLine("sweep"))
    notes, failed = [], np.flatnonzero(~result.trimmed)
    if failed.size and set(plan.variables) <= set(plan.condition.model.holdable):
        at = condition_at(plan.condition, plan.variables, result.values[failed[0]])
        if advice := options.freed_alpha(arguments, plan.aircraft, at):
            notes.append(f"at the first point without a trim {advice}")
    if arguments.picture is not None and not result.trimmed.any():
        notes.append(f"nothing to draw: {arguments.picture} is not written")
    else:
        draw(arguments.picture, result.root_locus.figure)
    if arguments.output is not None and arguments.output.suffix.lower() == UNIT:
        from controller.export.exported_loop import interpolated_loop
        from controller.export.fmu import write_fmu
        from trim.linear.varying import InterpolatedModel

        write_fmu(interpolated_loop(InterpolatedModel(result)), arguments.output, provenance())
    report = result.report()
    report = replace(report, notes=[*report.notes, *notes])
    if arguments.game:
        from controller.analysis.game_sweep import sweep_games, with_games

        report = with_games(
            report,
            result,
            sweep_games(
                result, ProgressLine("games"), **weights_of(arguments, result.model.units(result.model_states))
            ),
        )
    return report, bool(result.trimmed.any())


def _in_store(plan: SweepPlan, arguments: argparse.Namespace) -> tuple[Report, bool]:
    """The report of the store, and whether any point has a trim."""
    crew, origin = options.crew_of(arguments), provenance().to_dict()
    store = stream_sweep(plan, arguments.output, **crew, provenance=origin, progress=ProgressLine("sweep"))
    report = stored_sweep_report(plan, store, arguments.output)
    return report, bool(report.data["counts"]["trimmed"])


def _ranges(arguments: argparse.Namespace, listing: Path | None) -> dict[str, Range]:
    """Variable or parameter -> its range, of --dihedral and of --hold; none are needed beside a list of points."""
    if arguments.aircraft is not None:
        options.refuse(arguments, ("dihedral", "game", *OF_A_GAME), "belongs to the HFA; leave it out with --aircraft")
    ranges = {} if arguments.dihedral is None else {"dihedral": arguments.dihedral}
    held = arguments.hold or {}
    ranges |= {name: values for name, values in held.items() if not options.is_constant(name, values)}
    if not ranges and listing is None:
        raise BadInputError("nothing to sweep; give --dihedral RANGE or --hold NAME=RANGE")
    if listing is None and arguments.aircraft is None and "dihedral" not in (*ranges, *held, *(arguments.free or ())):
        warnings.warn("no --dihedral is given: every point is at 0 deg", stacklevel=2)
    return ranges
