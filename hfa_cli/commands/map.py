"""How far from trim u = -K z works: many initial states and commands, simulated nonlinear and linear.

A flight lasts eight time constants of the slowest mode of the linear loop. The report counts the starts that stay
inside the envelope and within the control limits, and names the limits that the others exceed.
"""

from __future__ import annotations

import argparse
from functools import partial

from hfa_cli.options import shared_options as options
from hfa_cli.options.flight_options import add_envelope, add_law, add_stored, check_policy, envelope_of, flown_law_of
from hfa_cli.options.parser import add_named
from hfa_cli.options.ranges import Range, array_of, value_range
from hfa_cli.output import draw, tell
from hfa_cli.progress import ProgressLine
from hfa_support.reporting.unit_system import shown_in
from trim.linear.linear_model import linearize

_MOST_POINTS = 1000
#: Option -> the quantities off trim that it takes, ft/s and degrees, and their ranges unless given.
_RANGES = {
    "initial": {"speed": "-4:8:0.25", "dihedral": "-40:40:2.5"},
    "command": {"dihedral": "-40:40:2.5"},
}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options of `hfa map`."""
    options.add_condition(parser)
    options.add_parameters(parser)
    add_law(parser)
    add_stored(parser)
    for option, ranges in _RANGES.items():
        about = f"off trim; default {', '.join(f'{name}={text}' for name, text in ranges.items())}"
        add_named(parser, f"--{option}", partial(_off_trim, tuple(ranges)), "NAME=RANGE", about)
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
    speeds, dihedrals, commands = (
        array_of(f"--{option} {name}", values, _MOST_POINTS)
        for option in _RANGES
        for name, values in getattr(arguments, option).items()
    )
    found = []
    for dynamics in VARIANTS:
        aircraft = Aircraft(options.parameters_of(arguments).values, dynamics)
        point = options.operating_point_of(arguments, aircraft)
        law = flown_law_of(arguments, linearize(aircraft, point))
        envelope = envelope_of(arguments, aircraft, point)
        result = recoverable_map(
            aircraft,
            point,
            law.gains[-1],
            envelope,
            speeds=speeds,
            dihedrals=dihedrals,
            commands=commands,
            progress=ProgressLine(f"map, {dynamics}"),
        )
        found.append(result)
    report = map_report(tuple(found), law.name)
    draw(arguments.picture, lambda: map_figure(tuple(found), report.title))
    tell(report, [each.point for each in found], arguments, arguments.output)
    return 0


def _off_trim(names: tuple[str, ...], name: str, text: str) -> Range:
    """The range of one of the quantities that an option takes."""
    if name not in names:
        raise argparse.ArgumentTypeError(f"is not among {', '.join(names)}")
    return value_range(name, text)
