"""Simulate the nonlinear aircraft through a slow change of dihedral under a schedule of gains.

At every point of a grid of dihedrals there is a trim and a gain, linear in between: certified, or from a file
unchanged.
With --aircraft the change is one of the scheduling variable of the model. Exit code as of `hfa fly`.
"""

from __future__ import annotations

import argparse
from functools import partial

import numpy as np

from controller.flight.envelope import flight_envelope
from hfa_cli.options import flights, games, trims
from hfa_cli.options.argument_types import model, number, quantity, whole
from hfa_cli.options.parser import Option, Options
from hfa_cli.output import ProgressLine
from hfa_support.errors import BadInputError, shortened
from trim.point.solve import find_operating_point

#: Of the schedule; half a second or so each.
_MOST_POINTS = 1000
_TO = "VALUE[:S[:POINTS]]"


def options() -> Options:
    """Of `hfa schedule`."""
    about = "the dihedral at the end, degrees; time of the change, default 60; points of the schedule, default 11"
    return {
        **trims.trim(required=True),
        "--to": Option(about, _TO, _to, more={"required": True}),
        **flights.law(),
        **flights.weights("use these gains instead of a law: K, or dihedral_deg and K at each of its angles"),
        **flights.scenario("20 more than the change takes"),
        **trims.picture("the flight"),
        **trims.output(),
    }


def run(arguments: argparse.Namespace) -> int:
    """Fly and report; exit 1 when a limit was exceeded."""
    from controller.policy.gain_table import load_gains
    from verification.flights import scheduling

    flights.check_policy(arguments)
    aircraft, (end, over, points), path = trims.aircraft_of(arguments), arguments.to, arguments.weights
    gains = None if path is None else load_gains(path, model())
    begin = find_operating_point(aircraft, trims.condition_of(arguments), trims.start_of(arguments))
    change = scheduling.change_over(aircraft.model, begin.values.get(model().schedule, end), end, over)
    scenario = flights.scenario_of(arguments, begin, scheduling.LEAD + over + scheduling.REST)
    ended = scheduling.LEAD + over
    if scenario.duration < ended:
        raise BadInputError(f"--duration is {scenario.duration:g} s and the change ends at {ended:g} s; extend it")
    low, high = sorted((change.start, change.end))
    grid, law = np.linspace(low, high, points), flights.law_of(arguments)
    certified = scheduling.certified_schedule(
        aircraft,
        grid if gains is None else gains.grid(grid),
        law=law,
        seed=flights.seed_of(arguments),
        game=partial(games.game_on, arguments),
        settings={} if law == "exact" else games.law_settings(arguments),
        gains=gains,
        condition=trims.flights_of(arguments).at,
        progress=ProgressLine("certify"),
    )
    ends = [certified.at(each).point for each in (change.start, end)]
    envelope, progress = flight_envelope(aircraft, ends[0], arguments.envelope), ProgressLine("simulate")
    result = scheduling.fly_schedule(aircraft, certified, change, scenario, envelope, progress=progress)
    report = scheduling.schedule_report(result, certified, change, law if path is None else f"gain of {path}")
    return flights.tell_flight(result, report, ends, arguments)


def _to(text: str) -> tuple[float, float, int]:
    """The value at the end, the time of the change, the points of the schedule."""
    parts = text.split(":")
    if len(parts) > 3:
        raise argparse.ArgumentTypeError(f"is {shortened(text)!r}; give {_TO}")
    over, points = (*parts[1:], *("60", "11")[len(parts) - 1 :])
    return quantity(model().schedule, parts[0]), number(over), whole(2, _MOST_POINTS)(points)
