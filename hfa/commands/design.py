"""The command `hfa design`."""

from __future__ import annotations

import argparse
from dataclasses import replace
from functools import partial

import numpy as np

import hfa_model
from controller.servo.design import load_design
from controller.servo.scheduled_controller import SUFFIXES, load_controller, save_controller
from hfa.options import trims
from hfa.options.argument_types import input_file, model as named_model, output_file, positive
from hfa.options.parser import Option, Options, command
from hfa.options.ranges import array_of, value_range
from hfa.output import ProgressLine, provenance, show
from hfa_support.errors import BadInputError

#: A second or two each.
_MOST_POINTS = 1000
_RANGE = "0:20:1"
#: rad/s: of the actuators behind which margins are computed.
_BANDWIDTHS = (2.0, 10.0)


def _options() -> Options:
    file, by = "a design (.toml), or a controller to print (.npz)", named_model().schedule
    usual = value_range(by, _RANGE) if by == hfa_model.aircraft().schedule else None
    bandwidth = "of the actuators behind which margins are computed, rad/s; default 2:10"
    return {
        "file": Option(file, "FILE", input_file(".npz", ".toml"), more={"nargs": "?"}),
        **trims.design(),
        **trims.at(
            partial(value_range, by),
            "RANGE",
            f"default {_RANGE}" * (usual is not None),
            default=usual,
        ),
        **trims.AIRCRAFT,
        "--bandwidth": Option(
            bandwidth, "A[:B...]", lambda text: tuple(map(positive, text.split(":")))
        ),
        "-o --output": Option(
            f"write the controller ({', '.join(SUFFIXES)})", "FILE", output_file(*SUFFIXES)
        ),
        **trims.JSON,
    }


@command(_options)
def design(arguments: argparse.Namespace) -> int:
    """The controller of a design at every dihedral angle, certified, as one file; or the table of a
    file made before.

    With --aircraft it is scheduled over the model's own scheduling variable. Margins are those of
    each loop opened alone, at every input and sensor, behind actuators of orders 1 and 2 and the
    bandwidths of --bandwidth. Exit 1 when one of the loops is unstable."""
    from controller.servo.controllers import design_controller
    from controller.servo.servo_loop import check_margins

    trims.refuse_si(arguments, "a controller is in ft, slug, lbf")
    if (arguments.file is None) == (arguments.design is None):
        raise BadInputError(
            "name one of --design NAME and a file: of a design (.toml) or of a controller (.npz)"
        )
    if arguments.file is not None and arguments.file.suffix == ".toml":
        arguments.design, arguments.file = load_design(str(arguments.file), named_model()), None
    aircraft, design = trims.aircraft_of(arguments), arguments.design
    model = aircraft
    if arguments.file is not None:
        trims.refuse(arguments, ("at", "output"), "belongs to --design; leave it out with a file")
        controller = load_controller(arguments.file, model)
    else:
        at = arguments.at
        if "at" not in arguments.given and design.shaping is not None:
            at = tuple(design.shaping.places)
        if at is None:
            raise BadInputError(
                f"give the values of {model.schedule or 'the scheduling variable'} by --at RANGE"
            )
        at = array_of(f"--{trims.called_at()}", at, _MOST_POINTS)
        controller = design_controller(aircraft, design, at, progress=ProgressLine("design"))
        controller = replace(
            controller, about={**controller.about, "provenance": provenance(arguments).to_dict()}
        )
    knots, in_degrees = controller.places, model.schedule_unit == "deg"
    between = (knots[1:] + knots[:-1]) / 2.0
    if in_degrees:
        knots = np.degrees(knots).round(10)
        between = np.arange(np.ceil(knots[0]), np.floor(knots[-1]) + 1.0)
    places = np.unique([*knots, *between])
    bandwidths = arguments.bandwidth or (
        () if design is not None and not design.actuators else _BANDWIDTHS
    )
    seen = np.radians(places) if in_degrees else places
    margins = check_margins(
        aircraft, controller, seen, bandwidths, progress=ProgressLine("margins")
    )
    report = controller.report()
    report = replace(report, parts=(*report.parts, margins.report())).with_data(
        margins=margins.to_dict()
    )
    if arguments.output is not None:
        save_controller(arguments.output, controller)
    show(report, arguments, written=True)
    return 0 if margins.ok else 1
