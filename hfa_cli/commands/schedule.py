"""Simulate the nonlinear aircraft through a slow change of dihedral under a schedule of gains.

At every point of a grid of dihedrals there is a level trim and a gain, linear in between: certified, or from a file as
it is. Exit code 0 when every state stays inside its envelope and every input within its control limits; else 1, and the
report names the state that left first and the inputs that exceeded their limits.
"""

from __future__ import annotations

import argparse

from hfa_cli.options import games, shared_options as options
from hfa_cli.options.argument_types import angle, input_file, number, whole
from hfa_cli.options.flight_options import (
    add_law,
    add_scenario,
    check_policy,
    envelope_of,
    law_of,
    scenario_of,
    seed_of,
)
from hfa_cli.options.games import MATRIX_FILES
from hfa_cli.options.learning_options import law_settings
from hfa_cli.options.parser import add_value
from hfa_cli.output import draw, tell
from hfa_cli.progress import ProgressLine
from hfa_support.errors import BadInputError
from trim.point.condition import level_flight
from trim.point.solve import find_operating_point

#: Of the schedule; half a second or so each.
_MOST_POINTS = 1000


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options of `hfa schedule`."""
    add_value(parser, "--dihedral", angle, "DEG", "dihedral at the start, degrees", required=True)
    add_value(parser, "--to", angle, "DEG", "dihedral at the end", required=True)
    add_value(parser, "--over", number, "S", "time of the change, default 60", default=60.0)
    add_value(parser, "--points", whole(2, _MOST_POINTS), "N", "grid points of the schedule, default 11", default=11)
    options.add_aircraft(parser)
    add_law(parser)
    about = "use these gains instead of a law: K, or dihedral_deg and K at each of its angles"
    add_value(parser, "--weights", input_file(*MATRIX_FILES), "FILE", f"{about} ({' '.join(MATRIX_FILES)})")
    add_scenario(parser, "20 more than the change takes")
    options.add_picture(parser, "the flight")
    options.add_output(parser)


def run(arguments: argparse.Namespace) -> int:
    """Fly and report; exit 1 when a limit was exceeded."""
    from controller.policy.gain_table import load_gains
    from verification.flights.flight_figures import flight_figure
    from verification.flights.scheduling import (
        LEAD,
        REST,
        certified_schedule,
        change_over,
        fly_schedule,
        grid_of,
        schedule_report,
    )

    check_policy(arguments)
    gains = None if arguments.weights is None else load_gains(arguments.weights)
    aircraft = options.aircraft_of(arguments)
    start, end, over = arguments.dihedral, arguments.to, arguments.over
    change = change_over(start, end, over)
    scenario = scenario_of(arguments, find_operating_point(aircraft, level_flight(start)), LEAD + over + REST)
    if scenario.duration < LEAD + over:
        raise BadInputError(
            f"--duration is {scenario.duration:g} s and the change of dihedral ends at {LEAD + over:g} s; extend it"
        )
    grid = grid_of(change, arguments.points)
    certified = certified_schedule(
        aircraft,
        grid if gains is None else gains.grid(grid),
        law=law_of(arguments),
        seed=seed_of(arguments),
        game=games.weights_of(arguments),
        settings={} if law_of(arguments) == "exact" else law_settings(arguments),
        gains=gains,
        progress=ProgressLine("certify"),
    )
    envelope = envelope_of(arguments, aircraft, certified.at(start).point)
    result = fly_schedule(aircraft, certified, change, scenario, envelope, progress=ProgressLine("simulate"))
    law = law_of(arguments) if gains is None else f"gain of {arguments.weights}"
    report = schedule_report(result, certified, change, law)
    draw(arguments.picture, lambda: flight_figure(result, report.title))
    tell(report, [certified.at(start).point, certified.at(end).point], arguments, arguments.output, result.history())
    return 0 if result.within_limits else 1
