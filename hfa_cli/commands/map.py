"""How far from trim u = -K z works: many initial states and commands, simulated nonlinear and linear.

A flight lasts eight time constants of the slowest mode of the linear loop. The report counts the starts that stay
inside the envelope and within the control limits, and names the limits that the others exceed. Of the HFA both sets of
equations are flown; of --aircraft two states of --initial and one of --command are to be named.
"""

from __future__ import annotations

import argparse
from functools import partial

from hfa_cli.options import shared_options as options
from hfa_cli.options.argument_types import OWN
from hfa_cli.options.flight_options import (
    add_aircraft,
    add_envelope,
    add_law,
    add_stored,
    aircraft_of,
    check_policy,
    envelope_of,
    flown_law_of,
)
from hfa_cli.options.parser import add_named
from hfa_cli.options.ranges import Range, array_of, value_range
from hfa_cli.output import draw, tell
from hfa_cli.progress import ProgressLine
from hfa_support.reporting.unit_system import shown_in
from trim.linear.linear_model import linearize

_MOST_POINTS = 1000
#: Option -> the quantities off trim of the HFA that it varies, ft/s and degrees, and their ranges unless given.
_RANGES = {
    "initial": {"speed": "-4:8:0.25", "dihedral": "-40:40:2.5"},
    "command": {"dihedral": "-40:40:2.5"},
}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options of `hfa map`."""
    options.add_condition(parser)
    add_aircraft(parser)
    add_law(parser)
    add_stored(parser)
    own = OWN.get()
    for option, ranges in _RANGES.items():
        known = tuple(ranges) if own is None else tuple((own.states, own.linear)[option == "command"])
        about = f"off trim; default {', '.join(f'{name}={text}' for name, text in ranges.items())}"
        add_named(parser, f"--{option}", partial(_off_trim, known), "NAME=RANGE", about)
        if own is None:
            with shown_in("english"):
                parser.set_defaults(**{option: {name: value_range(name, text) for name, text in ranges.items()}})
    add_envelope(parser)
    options.add_picture(parser, "the map")
    options.add_output(parser)


def run(arguments: argparse.Namespace) -> int:
    """Fly and report."""
    from hfa_model.aircraft import Aircraft
    from hfa_model.variants import VARIANTS
    from verification.flights.flight_figures import map_figure
    from verification.flights.recoverable_map import map_report, recoverable_map

    check_policy(arguments)
    starts, commands = (
        {
            name: array_of(f"--{option} {name}", values, _MOST_POINTS)
            for name, values in (getattr(arguments, option) or {}).items()
        }
        for option in _RANGES
    )
    aircraft, found, law_name = aircraft_of(arguments), [], ""
    flown = [aircraft]
    if isinstance(aircraft, Aircraft):
        flown = [Aircraft(aircraft.parameters, dynamics) for dynamics in VARIANTS]
    for each in flown:
        point = options.operating_point_of(arguments, each)
        law = flown_law_of(arguments, linearize(each, point))
        law_name = law.name
        result = recoverable_map(
            each,
            point,
            law.gains[-1],
            envelope_of(arguments, each, point),
            starts=starts,
            commands=commands,
            progress=ProgressLine(f"map, {point.dynamics}"),
        )
        found.append(result)
    report = map_report(tuple(found), law_name)
    draw(arguments.picture, lambda: map_figure(tuple(found), report.title))
    tell(report, [each.point for each in found], arguments, arguments.output)
    return 0


def _off_trim(names: tuple[str, ...], name: str, text: str) -> Range:
    """The range of one of the quantities that an option takes."""
    if name not in names:
        raise argparse.ArgumentTypeError(f"is not among {', '.join(names)}")
    return value_range(name, text)
