"""Exact linear model A, B at a trim: modes, offsets, uncertainty bands, and the print beside it where it exists."""

from __future__ import annotations

import argparse

from hfa_cli import options
from hfa_cli.output import check_target, show
from trim.linear.bands import bands_known, entry_bands
from trim.linear.compare import beside_the_print, printed_at
from trim.linear.linearize import linearize
from trim.linear.model_report import linear_model_report
from trim.point.solve import find_operating_point


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options of `hfa linearize`."""
    options.add_condition(parser)
    parser.add_argument("--full", action="store_true", help="seven states, with altitude")
    options.add_aircraft(parser)
    options.add_output(parser)


def run(arguments: argparse.Namespace) -> int:
    """Trim, linearize and report."""
    target = check_target(arguments.output)
    parameters = options.parameters_of(arguments)
    aircraft = options.aircraft_of(arguments)
    condition = options.condition_of(arguments)
    point = find_operating_point(aircraft, condition)
    model = linearize(aircraft, point, full=arguments.full)
    # The bands are of the six printed states.
    known = bands_known(parameters) and not arguments.full
    bands = entry_bands(parameters, condition, model) if known else None
    printed = printed_at(point) if not arguments.full else None
    report = linear_model_report(model, bands)
    show(report if printed is None else beside_the_print(report, model, printed), as_json=arguments.json, target=target)
    return 0
