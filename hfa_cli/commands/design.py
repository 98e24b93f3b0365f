"""The controller of a design at every dihedral angle, certified, as one file; or the table of a file made before.

With --corners the loop is closed with actuators of effectiveness 0.2 to 1 and bandwidth 0.5 to 2 rad/s; exit 1 when
one of the loops is unstable.
"""

from __future__ import annotations

import argparse
from dataclasses import replace
from functools import partial

from controller.design.design import NAMED, load_design
from controller.design.scheduled_controller import SUFFIXES, load_controller, save_controller
from hfa_cli.options import shared_options as options
from hfa_cli.options.argument_types import input_file, output_file, parsed
from hfa_cli.options.parser import add_value
from hfa_cli.options.ranges import array_of, value_range
from hfa_cli.origin import provenance
from hfa_cli.output import show
from hfa_cli.progress import ProgressLine
from hfa_support.errors import BadInputError

#: A second or two each.
_MOST_POINTS = 1000
_RANGE = "0:20:1"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options of `hfa design`."""
    parser.add_argument("file", nargs="?", type=input_file(".npz"), metavar="FILE", help="print this controller")
    designs = f"actuators, integrals, sensors, weights: {', '.join(NAMED)}, or a .toml file"
    add_value(parser, "--design", parsed(load_design), "NAME", designs)
    add_value(parser, "--dihedral", partial(value_range, "dihedral"), "RANGE", f"angles in degrees; default {_RANGE}")
    options.add_aircraft(parser)
    parser.add_argument("--corners", action="store_true", help="check the corners of the actuators too")
    about = f"write the controller ({', '.join(SUFFIXES)})"
    parser.add_argument("-o", "--output", type=output_file(*SUFFIXES), metavar="FILE", help=about)
    options.add_json(parser)


def run(arguments: argparse.Namespace) -> int:
    """Design or read, print, check; exit 1 when a corner is unstable."""
    from controller.design.controllers import design_controller
    from controller.design.servo_loop import check_corners

    options.refuse_files(arguments, ("output",), "a controller is in ft, slug, lbf")
    aircraft = options.aircraft_of(arguments)
    if (arguments.file is None) == (arguments.design is None):
        raise BadInputError("name one of --design NAME and the file of a controller")
    if arguments.file is not None:
        options.refuse(arguments, ("dihedral", "output"), "belongs to --design; leave it out with a file")
        controller = load_controller(arguments.file)
    else:
        angles = array_of("--dihedral", arguments.dihedral or value_range("dihedral", _RANGE), _MOST_POINTS)
        controller = design_controller(aircraft, arguments.design, angles, progress=ProgressLine("design"))
        controller = replace(controller, about={**controller.about, "provenance": provenance().to_dict()})
    report, ok = controller.report(), True
    if arguments.corners:
        checked = check_corners(aircraft, controller, progress=ProgressLine("corners"))
        report, ok = replace(report, parts=(*report.parts, checked.report())), checked.ok
        report = report.with_data(corners=checked.to_dict())
    if arguments.output is not None:
        save_controller(arguments.output, controller)
    show(report, arguments, target=None)
    return 0 if ok else 1
