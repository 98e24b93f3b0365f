"""Simulate many members of one flight, each with its own parameter errors, sensor noise and turbulence.

Member k is decided by --seed and k alone: any number of workers gives the same bits. The members go to a Zarr store
(-o FILE.zarr), which can be continued after an interruption (--resume). Exit code 0 when at least one member stays
inside its envelope and within the control limits.
"""

from __future__ import annotations

import argparse

from hfa_cli.options import flights, trims
from hfa_cli.options.argument_types import output_file, whole
from hfa_cli.options.parser import Option, Options
from hfa_cli.output import ProgressLine, provenance, tell
from hfa_support.errors import BadInputError
from hfa_support.files import temporary_folder

_MEMBERS, _MOST_MEMBERS = 100, 10_000_000


def options() -> Options:
    """Of `hfa monte-carlo`."""
    return {
        **trims.trim(required=True),
        **flights.law(flights.NONE),
        **flights.weights(),
        "--samples": Option(f"members, default {_MEMBERS}", "N", whole(1, _MOST_MEMBERS), more={"default": _MEMBERS}),
        **flights.scenario(members=True),
        **flights.commands(),
        **trims.workers("run of the same options"),
        **trims.JSON,
        "-o --output": Option("keep every member in this store (.zarr)", "FILE", output_file(".zarr")),
    }


def run(arguments: argparse.Namespace) -> int:
    """Fly and report; exit 1 when no member stayed within its limits."""
    from controller.flight.monte_carlo import MonteCarlo, member_report
    from hfa_support.jobs.store import stream

    target = arguments.output
    trims.refuse_files(arguments, ("output",), "a store is in ft")
    if arguments.resume and target is None:
        raise BadInputError("--resume needs the store to continue; add -o FILE.zarr")
    aircraft, point, law, scenario, envelope = flights.flight_of(arguments)
    plan = MonteCarlo(arguments.samples, flights.seed_of(arguments), aircraft, point, law, scenario, envelope)
    with temporary_folder() as folder:
        place, about = target or folder / "members.zarr", provenance().to_dict()
        crew = trims.crew_of(arguments)
        store = stream(plan, place, **crew, provenance=about, progress=ProgressLine("simulate"))
        report = member_report(plan, store, "members not kept" if target is None else f"members in {target}")
    tell(report.with_data(store=None if target is None else str(target)), [plan.point], arguments, None)
    return 0 if report.data["within_limits"] else 1
