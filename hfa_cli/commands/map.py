"""How far from trim u = -K z works: many initial states and commands, simulated nonlinear and linear.

A flight lasts eight time constants of the slowest mode of the linear loop. The report counts the starts that stay
inside the envelope and within the control limits, and names the limits that the others exceed. Of the HFA both sets of
equations are flown; of --aircraft two states of --initial and one of --command are to be named.
"""

from __future__ import annotations

import argparse

from controller.flight.envelope import flight_envelope
from hfa_cli.options import flights, trims
from hfa_cli.options.argument_types import OWN
from hfa_cli.options.parser import Option, Options
from hfa_cli.options.ranges import array_of, value_range
from hfa_cli.output import ProgressLine, draw, tell
from hfa_support.reporting.unit_system import shown_in
from trim.linear.linear_model import linearize

_MOST_POINTS = 1000
#: Option -> the quantities off trim of the HFA that it varies, ft/s and degrees, and their ranges unless given.
_RANGES = {
    "initial": {"speed": "-4:8:0.25", "dihedral": "-40:40:2.5"},
    "command": {"dihedral": "-40:40:2.5"},
}


def options() -> Options:
    """Of `hfa map`."""
    own, varied = OWN.get(), dict[str, Option]()
    for option, ranges in _RANGES.items():
        known = tuple(ranges) if own is None else tuple((own.states, own.linear)[option == "command"])
        about = f"off trim; default {', '.join(f'{name}={text}' for name, text in ranges.items())}"
        with shown_in("english"):
            default = {name: value_range(name, text) for name, text in ranges.items()} if own is None else None
        kind = flights.among(known, value_range)
        varied[f"--{option}"] = Option(about, "NAME=RANGE", kind, named=True, more={"default": default})
    policy, end = {**flights.law(), **flights.weights()}, {**trims.picture("the map"), **trims.output()}
    return {**trims.trim(required=True), **policy, **varied, **flights.ENVELOPE, **end}


def run(arguments: argparse.Namespace) -> int:
    """Fly and report."""
    from hfa_model.aircraft import Aircraft
    from hfa_model.variants import VARIANTS
    from verification.flights.flight_figures import map_figure
    from verification.flights.recoverable_map import map_report, recoverable_map

    flights.check_policy(arguments)
    starts, commands = (
        {
            name: array_of(f"--{option} {name}", values, _MOST_POINTS)
            for name, values in (getattr(arguments, option) or {}).items()
        }
        for option in _RANGES
    )
    aircraft, found, law_name = trims.aircraft_of(arguments), [], ""
    flown = [aircraft]
    if isinstance(aircraft, Aircraft):
        flown = [Aircraft(aircraft.parameters, dynamics) for dynamics in VARIANTS]
    for each in flown:
        point = trims.point_of(arguments, each)
        law = flights.flown_law_of(arguments, linearize(each, point))
        envelope, progress = flight_envelope(each, point, arguments.envelope), ProgressLine(f"map, {point.dynamics}")
        gain, law_name = law.gains[-1], law.name
        found.append(recoverable_map(each, point, gain, envelope, starts=starts, commands=commands, progress=progress))
    report = map_report(tuple(found), law_name)
    draw(arguments.picture, lambda: map_figure(tuple(found), report.title))
    tell(report, [each.point for each in found], arguments, arguments.output)
    return 0
