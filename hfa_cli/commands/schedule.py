"""Simulate the nonlinear aircraft through a slow change of dihedral under a schedule of gains.

At every point of a grid of dihedrals there is a trim and a gain, linear in between: certified, or from a file
unchanged.
With --aircraft the change is one of the scheduling variable of the model. Exit code as of `hfa fly`.
"""

from __future__ import annotations

import argparse
from functools import partial

from hfa_cli.options import games, shared_options as options
from hfa_cli.options.argument_types import OWN, in_unit, input_file, number, whole
from hfa_cli.options.flight_options import (
    add_aircraft,
    add_law,
    add_scenario,
    aircraft_of,
    check_policy,
    envelope_of,
    law_of,
    scenario_of,
    seed_of,
    tell_flight,
)
from hfa_cli.options.games import MATRIX_FILES
from hfa_cli.options.learning_options import law_settings
from hfa_cli.options.parser import add_value
from hfa_cli.progress import ProgressLine
from hfa_model.aircraft import HFA
from hfa_support.errors import BadInputError, shortened
from trim.point.solve import find_operating_point

#: Of the schedule; half a second or so each.
_MOST_POINTS = 1000
_TO = "VALUE[:S[:POINTS]]"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options of `hfa schedule`."""
    options.add_condition(parser)
    about = "the dihedral at the end, degrees; time of the change, default 60; points of the schedule, default 11"
    parser.add_argument("--to", action="append", metavar=_TO, help=about, required=True)
    add_aircraft(parser)
    add_law(parser)
    about = "use these gains instead of a law: K, or dihedral_deg and K at each of its angles"
    add_value(parser, "--weights", input_file(*MATRIX_FILES), "FILE", f"{about} ({' '.join(MATRIX_FILES)})")
    add_scenario(parser, "20 more than the change takes")
    options.add_picture(parser, "the flight")
    options.add_output(parser)


def run(arguments: argparse.Namespace) -> int:
    """Fly and report; exit 1 when a limit was exceeded."""
    from controller.policy.gain_table import load_gains
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
    aircraft, (end, over, points) = aircraft_of(arguments), _to(arguments.to)
    model, flights = aircraft.model, options.flight_of(arguments)
    gains = None if arguments.weights is None else load_gains(arguments.weights, model)
    begin = find_operating_point(aircraft, options.condition_of(arguments), arguments.start)
    change = change_over(model, begin.values.get(model.schedule, end), end, over)
    scenario = scenario_of(arguments, begin, LEAD + over + REST)
    if scenario.duration < LEAD + over:
        raise BadInputError(
            f"--duration is {scenario.duration:g} s and the change ends at {LEAD + over:g} s; extend it"
        )
    grid, law = grid_of(change, points), law_of(arguments)
    certified = certified_schedule(
        aircraft,
        grid if gains is None else gains.grid(grid),
        law=law,
        seed=seed_of(arguments),
        game=partial(games.game_on, arguments),
        settings={} if law == "exact" else law_settings(arguments),
        gains=gains,
        condition=flights.at,
        progress=ProgressLine("certify"),
    )
    ends = [certified.at(each).point for each in (change.start, end)]
    envelope = envelope_of(arguments, aircraft, ends[0])
    result = fly_schedule(aircraft, certified, change, scenario, envelope, progress=ProgressLine("simulate"))
    law = law if gains is None else f"gain of {arguments.weights}"
    return tell_flight(result, schedule_report(result, certified, change, law), ends, arguments)


def _to(texts: list[str]) -> tuple[float, float, int]:
    """What --to says, and the former --over and --points, which the parser turns into --to :S and --to ::POINTS."""
    fields = ["", "60", "11"]
    for text in texts:
        parts = text.split(":")
        if len(parts) > len(fields):
            raise BadInputError(f"--to is {shortened(text)!r}; give {_TO}")
        fields[: len(parts)] = [new or old for new, old in zip(parts, fields, strict=False)]
    model = OWN.get() or HFA
    unit = model.unit(model.schedule) if model.schedule else "1"
    try:
        return in_unit(unit, fields[0]), number(fields[1]), whole(2, _MOST_POINTS)(fields[2])
    except argparse.ArgumentTypeError as error:
        raise BadInputError(f"--to {error}; give {_TO}") from error
