"""Simulate a policy on all states of the nonlinear aircraft and compare with the prediction of its linear model.

Exit code 0 when every state stays inside its envelope, every input within its control limits, and no oscillation is
left that does not decay; else 1, and the report names the state that left first and the inputs that exceeded their
limits. `--law none --command elevator=1:2,2:-2,3:0` flies a doublet without a law. See `hfa schedule` for a slow change
of dihedral and `hfa map` for how far from trim the policy works.
"""

from __future__ import annotations

import argparse

from hfa_cli.options import flights, trims
from hfa_cli.options.parser import Options
from hfa_cli.output import ProgressLine


def options() -> Options:
    """Of `hfa fly`."""
    policy = {**flights.law(flights.NONE), **flights.weights(), **flights.commands()}
    end = {**trims.picture("the flight"), **trims.output()}
    return {**trims.trim(required=True), **policy, **flights.scenario(), **end}


def run(arguments: argparse.Namespace) -> int:
    """Fly and report; exit 1 when a limit was exceeded."""
    from controller.flight.nonlinear_flight import fly

    aircraft, point, law, scenario, envelope = flights.flight_of(arguments)
    result = fly(aircraft, point, law, scenario, envelope, progress=ProgressLine("simulate"))
    return flights.tell_flight(result, result.report(), [point], arguments)
