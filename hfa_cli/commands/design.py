"""The controller of a design at every dihedral angle, certified, as one file; or the table of a file made before.

Margins are those of each loop opened alone, at every input and sensor, behind actuators of orders 1 and 2 and the
bandwidths of --bandwidth. With --corners the loop is closed with actuators of effectiveness 0.2 to 1 and bandwidth 0.5
to 2 rad/s, each input by itself. Exit 1 when one of the loops is unstable.
"""

from __future__ import annotations

import argparse
from dataclasses import replace
from functools import partial

import numpy as np

from controller.design.design import NAMED, load_design
from controller.design.scheduled_controller import SUFFIXES, load_controller, save_controller
from hfa_cli.options import shared_options as options
from hfa_cli.options.argument_types import input_file, numbers, output_file, parsed
from hfa_cli.options.parser import add_value
from hfa_cli.options.ranges import array_of, value_range
from hfa_cli.origin import provenance
from hfa_cli.output import show
from hfa_cli.progress import ProgressLine
from hfa_support.errors import BadInputError

#: A second or two each.
_MOST_POINTS = 1000
_RANGE = "0:20:1"
#: rad/s: of the actuators behind which margins are computed.
_BANDWIDTHS = (2.0, 10.0)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options of `hfa design`."""
    parser.add_argument("file", nargs="?", type=input_file(".npz"), metavar="FILE", help="print this controller")
    designs = f"actuators, integrals, sensors, weights: {', '.join(NAMED)}, or a .toml file"
    add_value(parser, "--design", parsed(load_design), "NAME", designs)
    add_value(parser, "--dihedral", partial(value_range, "dihedral"), "RANGE", f"angles in degrees; default {_RANGE}")
    options.add_aircraft(parser)
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
    aircraft = options.aircraft_of(arguments)
    if (arguments.file is None) == (arguments.design is None):
        raise BadInputError("name one of --design NAME and the file of a controller")
    if arguments.file is not None:
        options.refuse(arguments, ("dihedral", "output"), "belongs to --design; leave it out with a file")
        controller = load_controller(arguments.file)
    else:
        design, chosen = arguments.design, arguments.dihedral
        angles = array_of("--dihedral", chosen or value_range("dihedral", _RANGE), _MOST_POINTS)
        knots = angles if chosen or design.shaping is None else np.array(design.shaping.dihedrals)
        controller = design_controller(aircraft, design, knots, progress=ProgressLine("design"))
        controller = replace(controller, about={**controller.about, "provenance": provenance().to_dict()})
    knots = np.degrees(controller.dihedrals).round(10)
    places = np.radians(np.unique([*knots, *np.arange(np.ceil(knots[0]), np.floor(knots[-1]) + 1.0)]))
    at_once = arguments.design is not None and not arguments.design.actuators
    bandwidths = arguments.bandwidth or (() if at_once else _BANDWIDTHS)
    margins = check_margins(aircraft, controller, places, bandwidths, progress=ProgressLine("margins"))
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
