"""Options of proofs over an interval of the scheduling variable."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from hfa.options.aircraft import Aircraft
from hfa.options.argument_types import number
from hfa.options.trim import Trim
from hfa_aircraft.model import Model
from hfa_prove.hfa import standard_errors_of
from hfa_support.errors import BadInputError, shortened
from hfa_support.schema import Number

if TYPE_CHECKING:
    from hfa_prove.search.family import Family
    from hfa_prove.search.loops import Intervals, Loop

not_negative = partial(number, declared=Number(0.0))


def interval(text: str) -> tuple[float, ...]:
    """Return the two numbers of a text LOW:HIGH, or the one number of a text.

    Raises BadInputError unless there is one number, or LOW < HIGH.
    """
    ends = tuple(number(part) for part in text.split(":"))
    if len(ends) > 2 or (len(ends) == 2 and not ends[0] < ends[1]):
        raise BadInputError(f"is {shortened(text)!r}; give one number, or LOW:HIGH with LOW < HIGH")
    return ends


def positive_interval(text: str) -> tuple[float, float]:
    """Return the two numbers of a text LOW:HIGH, or the one number of a text twice.

    Raises BadInputError unless 0 < LOW < HIGH, or one number is positive.
    """
    ends = interval(text)
    if not ends[0] > 0.0:
        raise BadInputError(f"is {text}; give positive numbers")
    return ends[0], ends[-1]


def interval_of(model: Model, text: str) -> tuple[float, ...]:
    """Return the ends LOW and HIGH of the scheduling variable, or one value, in the unit typed."""
    return interval(text)


def family_of(aircraft: Aircraft, trim: Trim, errors: float = 0.0) -> Family:
    """Return the aircraft and its trims at any scheduling value, as defined by the options.

    aircraft, trim: the options of the aircraft and its trim
    errors: number of standard errors that the proof covers for each identified parameter

    Raises BadInputError if `errors` is not 0 and the parameters have no standard errors.
    """
    from hfa_prove.search.family import Family

    standard_errors: Mapping[str, float] = {}
    if not aircraft.own:
        standard_errors = standard_errors_of(aircraft.dynamics, aircraft.parameter_set)
    if errors and not standard_errors:
        raise BadInputError("the parameters have no standard errors; remove --error")
    spread = {
        name: errors * error for name, error in standard_errors.items() if errors * error > 0.0
    }
    return Family(trim.aircraft, trim.common_condition, spread)


def refuse_no_certificate(output: Path | None, *, resume: bool = False) -> None:
    """Raise BadInputError if the output file of a certificate is not a .json file.

    output: path of the file, or None
    resume: whether the certificate in the file is continued, which requires the file
    """
    if output is not None and output.suffix.lower() != ".json":
        raise BadInputError(
            f"{output}: a certificate must be a .json file; give a path with the suffix .json"
        )
    if resume and output is None:
        raise BadInputError(
            "--resume requires an unfinished certificate; give the path with -o FILE.json"
        )


def loop_of_file(weights: Path, design: Any, model: Model, intervals: Intervals | None) -> Loop:
    """Return the loop of a gain schedule or controller in a file.

    design: design with the actuators of the controller, or None if the file contains gains
    intervals: intervals of uncertain actuators, or None
    """
    from hfa_flight.schedule.gain_schedule import load_gain_schedule
    from hfa_flight.schedule.scheduled_controller import load_controller
    from hfa_prove.search.loops import loop_of_schedule, loop_of_servo

    if design is None:
        return loop_of_schedule(load_gain_schedule(weights, model), intervals)
    controller = load_controller(weights, model)
    return loop_of_servo(controller, design.of(model).actuators, model, intervals)
