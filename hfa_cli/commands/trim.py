"""Trim the aircraft and report state, inputs, the residual of each equation, loads and margins to limits."""

from __future__ import annotations

import argparse

from hfa_cli import options
from hfa_cli.output import show
from trim.point.trim_report import trim_report


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options of `hfa trim`."""
    options.add_condition(parser)
    options.add_aircraft(parser)
    options.add_output(parser)


def run(arguments: argparse.Namespace) -> int:
    """Solve and report."""
    aircraft = options.aircraft_of(arguments)
    point = options.operating_point_of(arguments, aircraft)
    report = trim_report(aircraft, options.condition_of(arguments), point)
    show(report, as_json=arguments.json, target=arguments.output)
    return 0
