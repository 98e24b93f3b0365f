"""The controller of a design at every dihedral angle, certified, as one file; or the table of a file made before.

With --tune a search over named weights of a design writes a better one; what it has evaluated is kept beside it in
OUTPUT.record, so that a search that was interrupted goes on when it is started again.

With --toward the designs between the one of that file and another are flown in place of a search.

With --corners the loop is closed with actuators of effectiveness 0.2 to 1 and bandwidth 0.5 to 2 rad/s; exit 1 when
one of the loops is unstable. With --gusts the nonlinear aircraft flies through gusts at the first and the last angle.
"""

from __future__ import annotations

import argparse
from dataclasses import replace
from functools import partial
from typing import Any

from controller.design.design_file import NAMED, design_of, load_design, read_design
from controller.design.scheduled_controller import SUFFIXES, load_controller, save_controller
from hfa_cli.options import shared_options as options
from hfa_cli.options.argument_types import input_file, one_of, output_file, parsed
from hfa_cli.options.parser import add_value
from hfa_cli.options.ranges import array_of, value_range
from hfa_cli.origin import provenance
from hfa_cli.output import draw, show
from hfa_cli.progress import ProgressLine
from hfa_model.aircraft import Aircraft
from hfa_support.errors import BadInputError
from verification.synthesis.tuning_file import load_tuning, save_design

#: A second or two each.
_MOST_POINTS = 1000
_RANGE = "0:20:1"
_OF_A_DESIGN = "belongs to --design; leave it out with --tune"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options of `hfa design`."""
    parser.add_argument("file", nargs="?", type=input_file(".npz"), metavar="FILE", help="print this controller")
    designs = f"actuators, integrals, sensors, weights: {', '.join(NAMED)}, or a .toml file"
    add_value(parser, "--design", parsed(load_design), "NAME", designs)
    add_value(parser, "--dihedral", partial(value_range, "dihedral"), "RANGE", f"angles in degrees; default {_RANGE}")
    add_value(parser, "--feedback", one_of("state", "output"), "KIND", "state or output; default: by the sensors")
    about = "search better weights, as this file says; write the design with -o (.toml)"
    add_value(parser, "--tune", parsed(load_tuning), "FILE", about)
    about = "with --tune: no search, but the designs on the line to this one"
    add_value(parser, "--toward", parsed(_named_entries), "NAME", about)
    options.add_aircraft(parser)
    parser.add_argument("--corners", action="store_true", help="check the corners of the actuators too")
    parser.add_argument("--gusts", action="store_true", help="the largest gusts of 400 ft that it withstands")
    about = f"write the controller ({', '.join(SUFFIXES)}); with --tune the design (.toml)"
    parser.add_argument("-o", "--output", type=output_file(*SUFFIXES, ".toml"), metavar="FILE", help=about)
    options.add_picture(parser, "the trade-off of a search or of a line, with --tune")
    options.add_json(parser)


def run(arguments: argparse.Namespace) -> int:
    """Design or read, print, check; exit 1 when a corner is unstable."""
    from controller.design.controllers import design_controller
    from controller.design.corners import check_corners
    from controller.design.scheduled_controller import controller_report
    from verification.synthesis.gust_limits import gust_limits

    options.refuse_files(arguments, ("output",), "a controller and a design are in ft, slug, lbf")
    aircraft = options.aircraft_of(arguments)
    given = [name for name in ("file", "design", "tune") if getattr(arguments, name) is not None]
    if len(given) != 1:
        raise BadInputError("name what to do: one of --design NAME, --tune FILE, or the file of a controller")
    if arguments.tune is not None:
        options.refuse(arguments, ("dihedral", "feedback", "corners", "gusts"), _OF_A_DESIGN)
        return (_line if arguments.toward else _search)(arguments, aircraft)
    options.refuse(arguments, ("picture", "toward"), "belongs to --tune")
    if arguments.output is not None and arguments.output.suffix.lower() not in SUFFIXES:
        raise BadInputError(f"{arguments.output}: a controller is written as {' or '.join(SUFFIXES)}")
    if arguments.file is not None:
        options.refuse(arguments, ("dihedral", "feedback", "output"), "belongs to --design; leave it out with a file")
        controller = load_controller(arguments.file)
    else:
        angles = array_of("--dihedral", arguments.dihedral or value_range("dihedral", _RANGE), _MOST_POINTS)
        controller = design_controller(
            aircraft, arguments.design, angles, arguments.feedback or "", progress=ProgressLine("design")
        )
        about = {**controller.about, "provenance": provenance().to_dict()}
        controller = replace(controller, about=about)
    report, ok = controller_report(controller), True
    if arguments.corners:
        checked = check_corners(aircraft, controller, progress=ProgressLine("corners"))
        report, ok = replace(report, parts=(*report.parts, checked.report())), checked.ok
        report = report.with_data(corners=checked.to_dict())
    if arguments.gusts:
        limits = gust_limits(aircraft, controller, ProgressLine("gusts"))
        report = replace(report, parts=(*report.parts, limits.report())).with_data(gusts=limits.to_dict())
    if arguments.output is not None:
        save_controller(arguments.output, controller)
    show(report, arguments, target=None)
    return 0 if ok else 1


def _search(arguments: argparse.Namespace, aircraft: Aircraft) -> int:
    """Tune; exit 1 when no evaluation kept the constraints."""
    from verification.synthesis.tuning_report import tuning_figure, tuning_report
    from verification.synthesis.tuning_search import tune

    target = arguments.output
    if target is None or target.suffix.lower() != ".toml":
        raise BadInputError("--tune writes a design; name it with -o FILE.toml")
    record = target.with_name(f"{target.name}.record")
    found = tune(aircraft, arguments.tune, record, ProgressLine("search"))
    report = tuning_report(arguments.tune, found)
    entries = arguments.tune.entries_at(found.best)
    save_design(target, entries | {"description": f"found by a search from {arguments.tune.name}"})
    draw(arguments.picture, lambda: tuning_figure(arguments.tune, found.seen))
    show(report, arguments, target=None)
    return 0 if report.data["ok"] else 1


def _line(arguments: argparse.Namespace, aircraft: Aircraft) -> int:
    """Fly the designs between two."""
    from verification.synthesis.design_line import design_line

    options.refuse(arguments, ("output",), "belongs to a search; leave it out with --toward, or print --json")
    name, entries = arguments.toward
    found = design_line(aircraft, arguments.tune, name, entries, ProgressLine("line"))
    draw(arguments.picture, found.figure)
    show(found.report(), arguments, target=None)
    return 0


def _named_entries(name: str) -> tuple[str, dict[str, Any]]:
    """A design by its name, and its entries, read and refused as a design."""
    entries = read_design(name)
    design_of(name, entries)
    return name, entries
