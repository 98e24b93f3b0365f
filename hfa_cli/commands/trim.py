"""Trim the aircraft and report state, inputs, the residual of each equation, loads and margins to limits."""

from __future__ import annotations

import argparse
from pathlib import Path

from hfa_cli import options
from hfa_cli.output import check_target, show
from hfa_cli.values import assignments
from trim.point.condition import release
from trim.point.operating_point import load_operating_point
from trim.point.solve import find_operating_point
from trim.point.trim_report import trim_report


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options of `hfa trim`."""
    options.add_condition(parser)
    parser.add_argument("--free", action="append", metavar="NAME", help="leave a variable free; repeatable")
    parser.add_argument(
        "--hold", action="append", metavar="NAME=VALUE", help="hold a variable, degrees for angles; repeatable"
    )
    parser.add_argument("--start", metavar="FILE", help="begin from a saved operating point (.json)")
    options.add_aircraft(parser)
    options.add_output(parser)


def run(arguments: argparse.Namespace) -> int:
    """Solve and report."""
    target = check_target(arguments.output)
    aircraft = options.aircraft_of(arguments)
    condition = release(
        options.condition_of(arguments), free=tuple(arguments.free or ()), hold=assignments(arguments.hold)
    )
    start = None if arguments.start is None else load_operating_point(Path(arguments.start))
    point = find_operating_point(aircraft, condition, start)
    show(trim_report(aircraft, condition, point), as_json=arguments.json, target=target)
    return 0
