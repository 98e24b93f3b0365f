"""Options of actuators: lag, rate, order, and a fault in flight."""

from __future__ import annotations

import argparse
import math

import numpy as np

from controller.flight.actuators import ActuatorFault, Actuators
from hfa_cli.options.argument_types import number, numbers, parsed
from hfa_cli.options.parser import add_value
from hfa_model.support.errors import BadInputError
from hfa_model.vectors import Input
from trim.point.condition import CONTROL_LIMITS

#: How help shows colon-separated numbers.
_LAG_RATE, _ACTUATORS, _FAULT = "LAG:RATE", "LAG:RATE[:ORDER]", "EFFECTIVENESS:BANDWIDTH[:BEGIN]"


def add_actuators(parser: argparse._ActionsContainer, faults: bool = True) -> None:
    """--actuators, --engine, and --fault unless there are none."""
    about = "actuators, s and deg/s, within the trim's control limits; order 1 (default) or 2"
    add_value(parser, "--actuators", numbers(_ACTUATORS, 2, 3), _ACTUATORS, about)
    add_value(parser, "--engine", numbers(_LAG_RATE, 2), _LAG_RATE, "another lag and rate for the throttle, s and 1/s")
    if not faults:
        parser.set_defaults(fault=None)
        return
    about = "actuators of the surfaces from BEGIN on: share of the command that arrives, bandwidth in rad/s"
    add_value(parser, "--fault", parsed(_fault), _FAULT, about)


def actuators_of(arguments: argparse.Namespace) -> Actuators | None:
    """The actuators that the options name, None without them."""
    if arguments.actuators is None:
        for name in ("engine", "fault"):
            if getattr(arguments, name) is not None:
                raise BadInputError(f"--{name} belongs to --actuators; give both")
        return None
    lag, degrees_per_second, *order = arguments.actuators
    if degrees_per_second <= 0:
        raise BadInputError(f"--actuators rate is {degrees_per_second:g} deg/s; it must be positive")
    rate = math.radians(degrees_per_second)
    engine_lag, engine_rate = lag, np.inf
    if arguments.engine is not None:
        engine_lag, engine_rate = arguments.engine
    lowest, highest = (Input(*(pair[side] for pair in CONTROL_LIMITS)) for side in (0, 1))
    surfaces = len(lowest) - 1
    return Actuators(
        Input(engine_lag, *[lag] * surfaces),
        lowest,
        highest,
        Input(engine_rate, *[rate] * surfaces),
        order=int(order[0]) if order else 1,
        faults=() if arguments.fault is None else (arguments.fault,),
    )


def _fault(text: str) -> ActuatorFault:
    """The type of --fault."""
    parts = text.split(":")
    if len(parts) not in (2, 3):
        raise argparse.ArgumentTypeError(f"is {text!r}; give {_FAULT}")
    effectiveness, bandwidth, *begin = map(number, parts)
    return ActuatorFault(begin[0] if begin else 0.0, effectiveness, bandwidth)
