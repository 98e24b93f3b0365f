"""The command `hfa export`."""

from __future__ import annotations

import argparse
import math
import re
from importlib.resources import files
from pathlib import Path
from typing import TYPE_CHECKING

from hfa.options import flights, games, trims
from hfa.options.argument_types import OWN, one_of, output_file
from hfa.options.parser import Option, Options, command
from hfa.output import origin_lines, provenance, show
from hfa_support.errors import BadInputError
from hfa_support.files import write_text, write_texts
from hfa_support.reporting.report import Report
from hfa_support.reporting.text import Table
from trim.linear.linear_model import linearize

if TYPE_CHECKING:
    from hfa_aircraft.model import Model
    from trim.point.operating_point import OperatingPoint

SCHEMA = "hfa.export/1"
_LAWS = ("exact", games.DEFAULT_LAW)


def _options() -> Options:
    place = "a folder for C source, or a file .fmu (FMU) or .m (the function that reads .mat files of models)"
    at = math.radians(15.0) if OWN.get() is None else None
    return {
        **trims.at(default=at),
        **trims.flights(),
        **trims.AIRCRAFT,
        "-o --output": Option(
            place, "PLACE", output_file(".fmu", ".m", folder=True), more={"required": True}
        ),
        **flights.law(),
        "--law": Option(
            "the gain: exact, certified; default exact in C, none in an FMU", "NAME", one_of(*_LAWS)
        ),
        **flights.CONTROLLER,
        **flights.ACTUATORS,
        **trims.JSON,
    }


@command(_options)
def export(arguments: argparse.Namespace) -> int:
    """The aircraft for other tools; the suffix of -o says which.

    FOLDER: C source that needs no library: equations of motion, the trim at --dihedral, its A and
    B, and the gain of a policy, with an example of a 100 Hz loop. FILE.fmu: the nonlinear aircraft
    trimmed at --dihedral as an FMU 2.0 for model exchange and co-simulation; with --law, its policy
    flies. Needs a C compiler. --controller FILE: in both, a scheduled controller with its states in
    place of the policy; in the FMU behind --actuators, with which the C files have an example of a
    100 Hz loop too. FILE.m: a function of MATLAB and Octave that makes state-space systems of what
    `hfa sweep` and `hfa linearize` write as .mat."""
    place = arguments.output
    provenance(
        arguments
    )  # before anything is written: it finds what is wrong with options that nothing below reads
    if place.suffix == ".m":
        if not re.fullmatch(r"[A-Za-z]\w*", place.stem, re.ASCII):
            raise BadInputError(
                f"{place}: a function is called by its file's name; choose letters, digits and _, as in hfa_models.m"
            )
        write_text(place, files("controller.export").joinpath("hfa_models.m").read_text("utf-8"))
        show(_report([place]), arguments, written=True)
        return 0
    if arguments.controller is None:
        trims.refuse(arguments, ("actuators",), "belongs to --controller; leave it out")
    elif place.suffix and arguments.actuators is None:
        raise BadInputError(
            "--controller flies behind actuators in an FMU; add --actuators LAG:RATE"
        )
    alone = arguments.controller is None and arguments.law is None
    if alone:
        arguments.law = "exact"
    flights.check_policy(arguments)
    model = trims.aircraft_of(arguments)
    point = trims.point_of(arguments, model)
    written = _written(arguments, model, point, with_gain=not (alone and place.suffix))
    show(_report(written), arguments, written=True, notes=point.warnings)
    return 0


def _written(
    arguments: argparse.Namespace, model: Model, point: OperatingPoint, *, with_gain: bool
) -> list[Path]:
    """The aircraft with the gain of a law, or under a scheduled controller behind actuators."""
    from controller.export.aircraft_c import c_model_texts
    from controller.export.exported_loop import exported_loop, following_a_reference
    from controller.export.fmu import write_fmu
    from controller.servo.controller_c import c_controller_texts, controller_steering
    from controller.servo.scheduled_controller import load_controller

    place, actuators, origin = (
        arguments.output,
        flights.actuators_of(arguments),
        origin_lines(arguments),
    )
    controller = None
    if arguments.controller is not None:
        controller = load_controller(arguments.controller, model)
    linear = linearize(model, point)
    policy = None
    if controller is None and with_gain:
        policy = flights.flown_law_of(arguments, linear)
    if place.suffix:
        steering = None
        if controller is not None:
            steering = controller_steering(controller, model, point)
        elif policy is not None:
            steering = following_a_reference(model, policy)
        loop = exported_loop(model, point, steering, actuators)
        write_fmu(loop, place, provenance(arguments))
        return [place]
    texts = c_model_texts(linear, None if policy is None else policy.gains[0], origin)
    if controller is not None:
        texts |= c_controller_texts(controller, model, point, origin, actuators)
    return write_texts(place, texts)


def _report(written: list[Path]) -> Report:
    rows = [(str(path), path.stat().st_size) for path in written]
    table = Table(("file", "bytes"), [(name, str(size)) for name, size in rows])
    listed = [{"file": name, "bytes": size} for name, size in rows]
    return Report(
        f"Exported: {len(rows)} file{'s' * (len(rows) > 1)}",
        [table],
        data={"schema": SCHEMA, "files": listed},
    )
