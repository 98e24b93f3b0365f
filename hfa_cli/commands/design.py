"""The controller of a design at every dihedral angle, certified, as one file; or the table of a file made before.

With --aircraft it is scheduled over the model's own scheduling variable. Margins are those of each loop opened alone,
at every input and sensor, behind actuators of orders 1 and 2 and the bandwidths of --bandwidth. With --corners the loop
is closed with actuators of effectiveness 0.2 to 1 and bandwidth 0.5 to 2 rad/s, each input by itself. Exit 1 when one
of the loops is unstable.
"""

from __future__ import annotations

import argparse
from dataclasses import replace

import numpy as np

from controller.design.design import load_design
from controller.design.scheduled_controller import SUFFIXES, load_controller, save_controller
from hfa_cli.options import shared_options as options
from hfa_cli.options.argument_types import OWN, input_file, numbers, output_file
from hfa_cli.options.flight_options import add_aircraft, aircraft_of
from hfa_cli.options.parser import add_value
from hfa_cli.options.ranges import array_of, value_range
from hfa_cli.origin import provenance
from hfa_cli.output import show
from hfa_cli.progress import ProgressLine
from hfa_model.aircraft import HFA
from hfa_support.errors import BadInputError

#: A second or two each.
_MOST_POINTS = 1000
_RANGE = "0:20:1"
#: rad/s: of the actuators behind which margins are computed.
_BANDWIDTHS = (2.0, 10.0)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options of `hfa design`."""
    about = "a design (.toml), or a controller to print (.npz)"
    parser.add_argument("file", nargs="?", type=input_file(".npz", ".toml"), metavar="FILE", help=about)
    options.add_design(parser)
    over = (OWN.get() or HFA).schedule

    def values(text: str) -> object:
        return value_range(over, text)

    add_value(parser, "--dihedral", values, "RANGE", f"angles in degrees; default {_RANGE}")
    add_value(parser, "--at", values, "RANGE", "with --aircraft: of its scheduling variable, angles in degrees")
    add_aircraft(parser)
    about = "of the actuators behind which margins are computed, rad/s; default 2:10"
    add_value(parser, "--bandwidth", numbers("A[:B...]", 1, *["1"] * 6), "A[:B...]", about)
    parser.add_argument("--corners", action="store_true", help="check the corners of the actuators too")
    about = f"write the controller ({', '.join(SUFFIXES)})"
    parser.add_argument("-o", "--output", type=output_file(*SUFFIXES), metavar="FILE", help=about)
    options.add_json(parser)


def run(arguments: argparse.Namespace) -> int:
    """Design or read, print, check; exit 1 when a loop is unstable."""
    from controller.design.controllers import design_controller
    from controller.design.servo_loop import check_corners, check_margins

    options.refuse_files(arguments, ("output",), "a controller is in ft, slug, lbf")
    if (arguments.file is None) == (arguments.design is None):
        raise BadInputError("name one of --design NAME and a file: of a design (.toml) or of a controller (.npz)")
    if arguments.file is not None and arguments.file.suffix == ".toml":
        arguments.design, arguments.file = load_design(str(arguments.file), OWN.get() or HFA), None
    aircraft, design = aircraft_of(arguments), arguments.design
    model = aircraft.model
    if arguments.at is not None and OWN.get() is None:
        raise BadInputError("--at goes with --aircraft; of the HFA give --dihedral")
    chosen = arguments.at or arguments.dihedral
    if arguments.file is not None:
        options.refuse(arguments, ("dihedral", "at", "output"), "belongs to --design; leave it out with a file")
        controller = load_controller(arguments.file, model)
    else:
        if chosen is None and design.shaping is not None:
            at = np.array(design.shaping.places)
        elif chosen is None and model.schedule != HFA.schedule:
            raise BadInputError(f"give the values of {model.schedule or 'the scheduling variable'} by --at RANGE")
        else:
            at = array_of(
                "--dihedral" if arguments.at is None else "--at",
                chosen or value_range(HFA.schedule, _RANGE),
                _MOST_POINTS,
            )
        controller = design_controller(aircraft, design, at, progress=ProgressLine("design"))
        controller = replace(controller, about={**controller.about, "provenance": provenance().to_dict()})
    knots, in_degrees = controller.places, model.schedule_unit == "deg"
    between = (knots[1:] + knots[:-1]) / 2.0
    if in_degrees:
        knots = np.degrees(knots).round(10)
        between = np.arange(np.ceil(knots[0]), np.floor(knots[-1]) + 1.0)
    places = np.unique([*knots, *between])
    bandwidths = arguments.bandwidth or (() if design is not None and not design.actuators else _BANDWIDTHS)
    seen = np.radians(places) if in_degrees else places
    margins = check_margins(aircraft, controller, seen, bandwidths, progress=ProgressLine("margins"))
    report, ok = controller.report(), margins.ok
    report = replace(report, parts=(*report.parts, margins.report())).with_data(margins=margins.to_dict())
    if arguments.corners:
        checked = check_corners(aircraft, controller, progress=ProgressLine("corners"))
        report, ok = replace(report, parts=(*report.parts, checked.report())), ok and checked.ok
        report = report.with_data(corners=checked.to_dict())
    if arguments.output is not None:
        save_controller(arguments.output, controller)
    show(report, arguments, target=None)
    return 0 if ok else 1
