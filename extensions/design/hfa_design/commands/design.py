"""The command `hfa design`."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from hfa.options.aircraft import Aircraft
from hfa.options.argument_types import input_file, output_file, positive
from hfa.options.output import Output, ProgressLine
from hfa.options.part import option, part
from hfa.options.ranges import Range, array_of, scheduled_range, value_range
from hfa.options.request import Request, command
from hfa.options.trim import called_at, scheduled
from hfa_design.design import load_design
from hfa_design.options import design_option
from hfa_flight.schedule.scheduled_controller import (
    SUFFIXES,
    in_units_of,
    load_controller,
    save_controller,
)
from hfa_support.errors import BadInputError

#: Largest number of scheduling values. Each takes one or two seconds.
_MOST_POINTS = 1000
_RANGE = "0:20:1"


def _bandwidths(text: str) -> tuple[float, ...]:
    return tuple(positive(word) for word in text.split(":"))


@dataclass(frozen=True, kw_only=True, eq=False)
class DesignRequest(Request):
    """Options of `hfa design`."""

    aircraft: Aircraft = part(Aircraft)
    output: Output = part(
        Output,
        file=option(
            f"write the controller ({', '.join(SUFFIXES)})",
            "FILE",
            output_file(*SUFFIXES),
            names="-o --output",
        ),
    )
    file: Path | None = option(
        "design to compute (.toml), or controller to print (.npz)",
        "FILE",
        input_file(".npz", ".toml"),
        names="file",
        count="?",
    )
    design: Any = design_option()
    at: Range | None = scheduled(
        scheduled_range,
        "RANGE",
        lambda model: f"default {_RANGE}" if model.about.names_schedule else "",
    )
    bandwidth: tuple[float, ...] | None = option(
        "actuator bandwidths for which margins are computed, rad/s, such as 2:10, two values; "
        "default: the actuators of the design",
        "A[:B...]",
        _bandwidths,
    )

    def breakpoints(self, design: Any) -> np.ndarray:
        """Return the values of the scheduling variable at which controllers are computed, (N,).

        The values are in the unit that the model declares. They come from the first of these
        sources:

        - the option --at,
        - the breakpoints of a loop-shaping design,
        - the default range, if the model names its scheduling variable.

        Raises BadInputError if there is no source.
        """
        by = self.model.schedule
        if self.at is not None:
            typed = array_of(f"--{called_at(self.model)}", self.at, _MOST_POINTS)
            return self.model.native_values((by,), typed[:, None])[:, 0]
        if design.shaping is not None:
            return np.array(design.shaping.breakpoints)
        if not self.model.about.names_schedule:
            raise BadInputError(
                f"values of {by or 'the scheduling variable'} are missing; give --at RANGE"
            )
        return array_of(f"--{by}", value_range(self.model, by, _RANGE), _MOST_POINTS)


@command(DesignRequest)
def design(request: DesignRequest) -> int:
    """Compute the certified controllers of a design at the points of --at, or print a controller
    file.

    With --aircraft, the controller is scheduled over the scheduling variable of the model.
    Margins are computed for each input and sensor, with all other loops closed, for the actuators
    of the design, or those of orders 1 and 2 with the bandwidths of --bandwidth. Exit code 1 if a
    loop is unstable.
    """
    from hfa_design.controllers import design_controller
    from hfa_design.servo_loops import check_margins

    if (request.file is None) == (request.design is None):
        raise BadInputError(
            "the design is missing or given twice; give either --design NAME or a file (.toml "
            "for a design, .npz for a controller)"
        )
    model = request.model
    design = request.design
    stored = request.file
    if stored is not None and stored.suffix == ".toml":
        design = load_design(str(stored), model)
    if design is None:
        assert stored is not None  # a design or a file is required
        request.refuse(
            ("at", "output.file"),
            "applies only to a design; remove this option for a controller file",
        )
        controller = load_controller(stored, model)
    else:
        controller = design_controller(
            model.native, design, request.breakpoints(design), progress=ProgressLine("design")
        )
        controller = in_units_of(controller, model)
        origin = {**controller.about, "provenance": request.provenance.to_dict()}
        controller = replace(controller, about=origin)
    knots = controller.breakpoints
    in_degrees = model.is_typed_in_degrees
    between = (knots[1:] + knots[:-1]) / 2.0
    if in_degrees:
        knots = np.degrees(knots).round(10)
        between = np.arange(np.ceil(knots[0]), np.floor(knots[-1]) + 1.0)
    places = np.unique([*knots, *between])
    bandwidths = request.bandwidth or ()
    seen = np.radians(places) if in_degrees else places
    margins = check_margins(model, controller, seen, bandwidths, progress=ProgressLine("margins"))
    report = controller.report()
    report = replace(report, parts=(*report.parts, margins.report())).with_data(margins=margins)
    request.show(report, write=partial(save_controller, controller=controller))
    return 0 if margins.ok else 1
