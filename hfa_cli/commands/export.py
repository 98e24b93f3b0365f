"""The aircraft for other tools; the suffix of -o says which.

FOLDER: C source that needs no library: equations of motion, the trim at --dihedral, its A and B, and the gain of a
policy, with an example of a 100 Hz loop. FILE.fmu: the nonlinear aircraft
trimmed at --dihedral as an FMU 2.0 for model exchange and co-simulation; with --law, its policy flies. Needs a C
compiler. --controller FILE: in both, a scheduled controller with its states in place of the policy; in the FMU behind
--actuators, with which the C files have an example of a 100 Hz loop too. FILE.m: a function of MATLAB and Octave that
makes state-space systems of what `hfa sweep` and `hfa linearize` write as .mat.
"""

from __future__ import annotations

import argparse
import math
import re
from dataclasses import replace
from importlib.resources import files
from pathlib import Path
from typing import TYPE_CHECKING

from hfa_cli.options import flights, trims
from hfa_cli.options.argument_types import OWN, folder_or_file
from hfa_cli.options.parser import Option, Options
from hfa_cli.output import origin_lines, provenance, show
from hfa_support.errors import BadInputError
from hfa_support.files import write_text, write_texts
from hfa_support.reporting.report import Report
from hfa_support.reporting.text import Table
from trim.linear.linear_model import linearize

if TYPE_CHECKING:
    from hfa_model.aircraft import Aircraft
    from hfa_support.model import Model
    from trim.point.operating_point import OperatingPoint

SCHEMA = "hfa.export/1"


def options() -> Options:
    """Of `hfa export`."""
    place = "a folder for C source, or a file .fmu (FMU) or .m (the function that reads .mat files of models)"
    default = {"default": math.radians(15.0)} if OWN.get() is None else {}
    return {
        **{name: replace(each, more=default) for name, each in trims.at().items()},
        **trims.flights(),
        **trims.AIRCRAFT,
        "-o --output": Option(place, "PLACE", folder_or_file(".fmu", ".m"), more={"required": True}),
        **flights.law(),
        "--law": Option("the gain: exact, certified; default exact in C, none in an FMU", "NAME"),
        **flights.CONTROLLER,
        **flights.ACTUATORS,
        **trims.JSON,
    }


def run(arguments: argparse.Namespace) -> int:
    """Trim, linearize, find what controls it, write, say what was written."""
    place = arguments.output
    provenance()  # before anything is written: it finds what is wrong with options that nothing below reads
    if place.suffix == ".m":
        if not re.fullmatch(r"[A-Za-z]\w*", place.stem, re.ASCII):
            raise BadInputError(
                f"{place}: a function is called by its file's name; choose letters, digits and _, as in hfa_models.m"
            )
        write_text(place, files("controller.export").joinpath("hfa_models.m").read_text("utf-8"))
        show(_report([place]), arguments, target=None)
        return 0
    _check(arguments)
    aircraft = trims.aircraft_of(arguments)
    point = trims.point_of(arguments, aircraft)
    write = _write_gain if arguments.controller is None else _write_controller
    show(_report(write(arguments, aircraft, point)), arguments, target=None, notes=point.warnings)
    return 0


def _check(arguments: argparse.Namespace) -> None:
    """BadInputError for options that would change nothing."""
    if arguments.controller is None:
        trims.refuse(arguments, ("actuators",), "belongs to --controller; leave it out")
        return
    flights.check_policy(arguments)
    if arguments.output.suffix and arguments.actuators is None:
        raise BadInputError("--controller flies behind actuators in an FMU; add --actuators LAG:RATE")


def _write_gain(arguments: argparse.Namespace, aircraft: Aircraft | Model, point: OperatingPoint) -> list[Path]:
    """The aircraft, with the gain of a law where one is asked for; C has the exact one unless another is."""
    from controller.export.c_model import c_model_texts
    from controller.export.exported_loop import exported_loop
    from controller.export.fmu import write_fmu

    alone = arguments.law is None
    if alone:
        arguments.law = "exact"
    flights.check_policy(arguments)
    model, place = linearize(aircraft, point), arguments.output
    gain = flights.flown_law_of(arguments, model).gains[0]
    if not place.suffix:
        return write_texts(place, c_model_texts(aircraft, model, gain, origin_lines()))
    write_fmu(exported_loop(aircraft, point, None if alone else gain), place, provenance())
    return [place]


def _write_controller(arguments: argparse.Namespace, aircraft: Aircraft | Model, point: OperatingPoint) -> list[Path]:
    """The aircraft under a scheduled controller behind actuators; in C both beside each other."""
    from controller.design.scheduled_controller import load_controller
    from controller.export.c_model import c_model_texts
    from controller.export.exported_loop import EXAMPLE, c_controller_texts, controller_example, exported_loop
    from controller.export.fmu import write_fmu

    controller, place = load_controller(arguments.controller, aircraft.model), arguments.output
    actuators = flights.actuators_of(arguments)
    if place.suffix and actuators is not None:
        write_fmu(exported_loop(aircraft, point, None, controller, actuators), place, provenance())
        return [place]
    without = c_model_texts(aircraft, linearize(aircraft, point), None, origin_lines())
    texts = without | c_controller_texts(controller, aircraft, point, origin_lines())
    if actuators is not None:
        texts[EXAMPLE] = controller_example(controller, aircraft, point, actuators, origin_lines())
    return write_texts(place, texts)


def _report(written: list[Path]) -> Report:
    rows = [(str(path), path.stat().st_size) for path in written]
    table = Table(("file", "bytes"), [(name, str(size)) for name, size in rows])
    listed = [{"file": name, "bytes": size} for name, size in rows]
    return Report(
        f"Exported: {len(rows)} file{'s' * (len(rows) > 1)}", [table], data={"schema": SCHEMA, "files": listed}
    )
