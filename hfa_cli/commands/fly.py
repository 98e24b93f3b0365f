"""Simulate a policy on all states of the nonlinear aircraft and compare with the prediction of its linear model.

Exit code 0 when every state stays inside its envelope, every input within its control limits, and no oscillation is
left that does not decay; else 1, and the report names the state that left first and the inputs that exceeded their
limits. `--law none --command elevator=1:2,2:-2,3:0` flies a doublet without a law. See `hfa schedule` for a slow change
of dihedral and `hfa map` for how far from trim the policy works.
"""

from __future__ import annotations

import argparse

from hfa_cli.options import shared_options as options
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
    tell_flight,
)
from hfa_cli.progress import ProgressLine


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options of `hfa fly`."""
    options.add_condition(parser)
    add_aircraft(parser)
    add_law(parser, NONE)
    add_stored(parser)
    add_commands(parser)
    add_scenario(parser)
    options.add_picture(parser, "the flight")
    options.add_output(parser)


def run(arguments: argparse.Namespace) -> int:
    """Fly and report; exit 1 when a limit was exceeded."""
    from controller.flight.nonlinear_flight import fly

    check_policy(arguments)
    aircraft = aircraft_of(arguments)
    point = options.operating_point_of(arguments, aircraft)
    law, scenario = policy_of(arguments, aircraft, point, scenario_of(arguments, point))
    envelope = envelope_of(arguments, aircraft, point)
    result = fly(aircraft, point, law, scenario, envelope, progress=ProgressLine("simulate"))
    return tell_flight(result, result.report(law), [point], arguments)
