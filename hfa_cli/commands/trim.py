"""Trim the aircraft and report variables and their limits, what binds, each equation's verdict, loads, performance."""

from __future__ import annotations

import argparse

from hfa_cli.options import shared_options as options
from hfa_cli.output import draw, failure_as_data, show
from trim.point.hfa_report import trim_figure
from trim.point.trim_report import trim_report


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options of `hfa trim`."""
    options.add_condition(parser)
    options.add_own(parser)
    options.add_aircraft(parser)
    options.add_picture(parser, "the aircraft from the front with its loads")
    options.add_output(parser)


def run(arguments: argparse.Namespace) -> int:
    """Solve and report."""
    own = options.own_of(arguments)
    aircraft = own or options.aircraft_of(arguments)
    if own is not None:
        options.refuse(arguments, ("picture",), "draws the HFA from the front; leave it out with --aircraft")
    with failure_as_data(arguments, aircraft):
        point = options.operating_point_of(arguments, aircraft)
    draw(arguments.picture, lambda: trim_figure(options.aircraft_of(arguments), point))
    report = trim_report(aircraft, options.condition_of(arguments), point)
    show(report, arguments, target=arguments.output)
    return 0
