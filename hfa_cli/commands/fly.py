"""Simulate a policy on the seven-state nonlinear aircraft and compare with the prediction of its linear model.

Exit code 0 when every state stays inside its envelope and every input within its control limits; else 1, and the report
names the state that left first and the inputs that exceeded their limits. See `hfa schedule` for a slow change of
dihedral and `hfa map` for how far from trim the policy works.
"""

from __future__ import annotations

import argparse

from hfa_cli.options import shared_options as options
from hfa_cli.options.flight_options import (
    add_controller,
    add_law,
    add_scenario,
    add_signal,
    add_stored,
    check_policy,
    controlled,
    envelope_of,
    flown_law_of,
    scenario_of,
)
from hfa_cli.output import draw, tell
from hfa_cli.progress import ProgressLine
from trim.linear.linear_model import linearize


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options of `hfa fly`."""
    options.add_condition(parser)
    options.add_aircraft(parser)
    add_law(parser)
    add_stored(parser)
    add_controller(parser)
    add_signal(parser, "--reference", "what a state shall follow")
    add_scenario(parser)
    options.add_picture(parser, "the flight")
    options.add_output(parser)


def run(arguments: argparse.Namespace) -> int:
    """Fly and report; exit 1 when a limit was exceeded."""
    from controller.flight.nonlinear_flight import fly
    from verification.flights.flight_figures import flight_figure

    check_policy(arguments)
    aircraft = options.aircraft_of(arguments)
    point = options.operating_point_of(arguments, aircraft)
    scenario = scenario_of(arguments, point)
    envelope = envelope_of(arguments, aircraft, point)
    law, scenario = controlled(arguments, aircraft, point, scenario)
    if law is None:
        law = flown_law_of(arguments, linearize(aircraft, point))
    result = fly(aircraft, point, law, scenario, envelope, progress=ProgressLine("simulate"))
    report = result.report(law)
    draw(arguments.picture, lambda: flight_figure(result, report.title))
    tell(report, [point], arguments, arguments.output, result.history())
    return 0 if result.within_limits else 1
