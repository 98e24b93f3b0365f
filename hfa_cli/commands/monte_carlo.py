"""Simulate many members of one flight, each with its own parameter errors, sensor noise and turbulence.

Member k is decided by --seed and k alone: any number of workers gives the same bits. The members go to a Zarr store
(-o FILE.zarr), which can be continued after an interruption (--resume). Exit code 0 when at least one member stays
inside its envelope and within the control limits.
"""

from __future__ import annotations

import argparse
from dataclasses import replace
from typing import TYPE_CHECKING

from hfa_cli.options import shared_options as options
from hfa_cli.options.argument_types import check_target, whole
from hfa_cli.options.flight_options import (
    NONE,
    add_aircraft,
    add_commands,
    add_law,
    add_scenario,
    add_stored,
    aircraft_of,
    check_policy,
    envelope_of,
    policy_of,
    scenario_of,
    seed_of,
)
from hfa_cli.options.parser import add_value
from hfa_cli.origin import provenance
from hfa_cli.output import tell
from hfa_cli.progress import ProgressLine
from hfa_support.errors import BadInputError
from hfa_support.files import temporary_folder

if TYPE_CHECKING:
    from controller.flight.monte_carlo import MonteCarlo

_DEFAULT_MEMBERS = 100
_MOST_MEMBERS = 10_000_000


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options of `hfa monte-carlo`."""
    options.add_condition(parser)
    add_aircraft(parser)
    add_law(parser, NONE)
    add_stored(parser)
    about = f"members, default {_DEFAULT_MEMBERS}"
    add_value(parser, "--samples", whole(1, _MOST_MEMBERS), "N", about, default=_DEFAULT_MEMBERS)
    add_scenario(parser, members=True)
    add_commands(parser)
    options.add_workers(parser, "run of the same options")
    options.add_json(parser)
    parser.add_argument("-o", "--output", metavar="FILE", help="keep every member in this store (.zarr)")


def run(arguments: argparse.Namespace) -> int:
    """Fly and report; exit 1 when no member stayed within its limits."""
    from controller.flight.monte_carlo import member_report, stream_monte_carlo

    options.refuse_files(arguments, ("output",), "a store is in ft")
    target = check_target(arguments.output, (".zarr",))
    if arguments.resume and target is None:
        raise BadInputError("--resume needs the store to continue; add -o FILE.zarr")
    crew = options.crew_of(arguments)
    plan = _plan(arguments)
    with temporary_folder() as folder:
        store = stream_monte_carlo(
            plan,
            folder / "members.zarr" if target is None else target,
            **crew,
            provenance=provenance().to_dict(),
            progress=ProgressLine("simulate"),
        )
        report = member_report(plan, store, "members not kept" if target is None else f"members in {target}")
    tell(replace(report, data={**report.data, "store": arguments.output}), [plan.point], arguments, None)
    return 0 if report.data["within_limits"] else 1


def _plan(arguments: argparse.Namespace) -> MonteCarlo:
    from controller.flight.monte_carlo import MonteCarlo

    check_policy(arguments)
    aircraft = aircraft_of(arguments)
    point = options.operating_point_of(arguments, aircraft)
    law, scenario = policy_of(arguments, aircraft, point, scenario_of(arguments, point))
    envelope = envelope_of(arguments, aircraft, point)
    return MonteCarlo(arguments.samples, seed_of(arguments), aircraft, point, law, scenario, envelope)
