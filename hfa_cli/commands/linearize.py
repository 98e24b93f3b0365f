"""Exact linear model A, B at a trim: modes, offsets, uncertainty bands, and the printed matrices where they exist."""

from __future__ import annotations

import argparse

from hfa_cli import options
from hfa_cli.output import show
from hfa_model.aircraft import Aircraft
from trim.linear.bands import bands_known, entry_bands
from trim.linear.compare import beside_the_print, printed_at
from trim.linear.linearize import linearize
from trim.linear.model_report import linear_model_report, trust_in


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options of `hfa linearize`."""
    options.add_condition(parser)
    parser.add_argument("--full", action="store_true", help="seven states, with altitude")
    options.add_aircraft(parser)
    options.add_output(parser)


def run(arguments: argparse.Namespace) -> int:
    """Trim, linearize and report."""
    parameters = options.parameters_of(arguments)
    aircraft = Aircraft(parameters.values, arguments.dynamics)
    condition = options.condition_of(arguments)
    point = options.operating_point_of(arguments, aircraft)
    model = linearize(aircraft, point, full=arguments.full)
    # The bands are of the six printed states.
    known = bands_known(parameters) and not arguments.full
    bands = entry_bands(parameters, condition, model) if known else None
    printed = printed_at(point) if not arguments.full else None
    report = linear_model_report(model, bands, trust_in(bands))
    if printed is not None:
        report = beside_the_print(report, model, printed)
    show(report, arguments, target=arguments.output)
    return 0
