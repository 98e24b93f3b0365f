"""An example for the C files of a controller: a loop of 100 Hz around it, in which its aircraft is simulated."""

from __future__ import annotations

import numpy as np

from controller.design.scheduled_controller import ScheduledController
from controller.export.c_model import c_table, comment_lines
from controller.export.exported_controller import commandable, filled, unit_of_output
from controller.export.exported_loop import held_loop
from controller.flight.actuators import Actuators
from hfa_model.aircraft import Aircraft
from hfa_model.native.c_code import c_function
from hfa_model.vectors import STATES
from trim.point.operating_point import OperatingPoint

EXAMPLE = "controller_100hz.c"
#: What is commanded, in the unit of the first command, and how long it is simulated, s.
COMMANDED, SECONDS = 0.01, 20


def controller_example(
    controller: ScheduledController, aircraft: Aircraft, point: OperatingPoint, actuators: Actuators, origin: str
) -> str:
    """The text of `EXAMPLE`; it needs `hfa_controller.h` and `.c`. BadInputError as in `held_loop`."""
    function, states = held_loop(aircraft, point, controller, actuators)
    names, trim = commandable(controller), np.array(point.inputs)
    commanded = f"{COMMANDED:g} {unit_of_output(names[0])} of {names[0]}" if names else "nothing"
    return filled(
        f"{EXAMPLE}.in",
        origin=comment_lines(origin),
        command=commanded,
        commanded=COMMANDED if names else 0.0,
        seconds=SECONDS,
        states=len(states),
        dihedral=STATES.index("dihedral"),
        tables="\n".join(
            [
                c_table("static const char *const name", [f'"{each.name}"' for each in states]),
                c_table("static const double begin", [each.start for each in states]),
                c_table("static const double lowest", actuators.lowest - trim),
                c_table("static const double highest", actuators.highest - trim),
            ]
        ),
        function=c_function(function, "loop", ("y", "u"), ("rate", "dihedral", "measured")),
    )
