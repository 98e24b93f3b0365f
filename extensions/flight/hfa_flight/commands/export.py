"""The command `hfa export`."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass, replace
from importlib.resources import files
from pathlib import Path
from typing import TYPE_CHECKING

from hfa.inherited import AircraftOptions, JsonOption, TrimOptions, print_report
from hfa.learning import DEFAULT_LAW
from hfa.options.argument_types import breakpoint_value, one_of, output_file
from hfa.options.part import option
from hfa.options.request import command
from hfa.options.trim import scheduled
from hfa_flight.export.c_text import write_texts
from hfa_flight.options import (
    LawOptions,
    actuators_of,
    actuators_option,
    controller_option,
    deployment_option,
    noted_linear_model,
    weights_option,
)
from hfa_flight.results import Exported
from hfa_support.errors import BadInputError, printable
from hfa_support.files import write_text
from hfa_support.reporting.report import Report
from hfa_support.reporting.text import Table

if TYPE_CHECKING:
    from hfa_aircraft.model import Model
    from trim.point.operating_point import OperatingPoint

#: Default dihedral angle of the exported HFA, deg.
_DIHEDRAL = math.radians(15.0)


@dataclass(frozen=True, kw_only=True, eq=False)
class ExportRequest(LawOptions, AircraftOptions, TrimOptions, JsonOption):
    """Options of `hfa export`."""

    at: float | None = scheduled(breakpoint_value)
    output: Path = option(
        "folder for C source, FILE.fmu for an FMU, or FILE.m for a function that reads models from "
        ".mat files",
        "PLACE",
        output_file(".fmu", ".m", folder=True),
        names="-o --output",
        required=True,
    )
    law: str = option(
        "gain to export: exact or certified (learned); default: exact in C, none in an FMU",
        "NAME",
        one_of("exact", DEFAULT_LAW),
        default="",
    )
    weights: Path | None = weights_option()
    controller: Path | None = controller_option()
    actuators: tuple[float, ...] | None = actuators_option()
    policy: Path | None = deployment_option()


@command(ExportRequest)
def export(request: ExportRequest) -> int:
    """Export an aircraft and its controller to other tools; -o selects the format.

    A folder receives C source without dependencies: equations, trim at --at, A, B, a gain and an
    example 100 Hz loop. FILE.fmu is the nonlinear aircraft as an FMU 2.0, in closed loop if a
    law, gain or controller is given. An FMU requires a C compiler. FILE.m is a MATLAB and Octave
    function that makes state-space systems from the .mat files of `hfa sweep` and `hfa linearize`.
    --controller FILE replaces the gain by a controller. With --policy DEPLOYMENT.toml, the C source
    is only a function for one sample of the deployed policy, with normalizer, clipping and mapping.
    """
    names_no_policy = (
        not request.law
        and request.weights is None
        and request.controller is None
        and request.policy is None
    )
    if names_no_policy:
        request = replace(request, law="exact")
    if request.at is None and not request.own:
        request = replace(request, at=_DIHEDRAL)
    # Computing the provenance checks options that the code below does not read, before any file is
    # written.
    origin = f"{request.provenance.text()}\n{request.line}"
    if request.output.suffix.lower() == ".m":
        return _write_function(request)
    if request.controller is None:
        request.refuse(("actuators",), "applies only to --controller; remove this option")
    elif _is_fmu(request) and request.actuators is None:
        raise BadInputError("--controller requires actuators in an FMU; add --actuators LAG:RATE")
    if request.policy is not None and _is_fmu(request):
        raise BadInputError(
            f"{request.output}: an FMU has neither the sample time nor the delay of a deployment "
            "file; give a folder for C source, which is called once a sample"
        )
    request.check_policy()
    model = request.flown_aircraft()
    point = request.operating_point(model)
    if request.policy is not None:
        written = _write_deployed_policy(request, request.policy, point, origin)
    else:
        is_aircraft_alone = names_no_policy and _is_fmu(request)
        written = _written(request, model, point, origin, with_gain=not is_aircraft_alone)
    print_report(_report(written), request, notes=point.warnings)
    return 0


def _is_fmu(request: ExportRequest) -> bool:
    """Return whether the output is an .fmu file."""
    return request.output.suffix.lower() == ".fmu"


def _write_function(request: ExportRequest) -> int:
    """Write the MATLAB and Octave function, print the report and return exit code 0.

    Raises BadInputError if the name of the file cannot be the name of a function.
    """
    target = request.output
    if not re.fullmatch(r"[A-Za-z]\w*", target.stem, re.ASCII):
        raise BadInputError(
            f"{target}: the file name is not a name of a function; give a letter, then letters, "
            "digits and _, as in hfa_models.m"
        )
    write_text(target, files("hfa_flight.export").joinpath("hfa_models.m").read_text("utf-8"))
    print_report(_report([target]), request)
    return 0


def _write_deployed_policy(
    request: ExportRequest, deployment: Path, point: OperatingPoint, origin: str
) -> list[Path]:
    """Write the command of a deployed policy at one sample as a C function.

    Returns the paths of the written files.

    deployment: path of the deployment file
    origin: provenance, for comments in the source
    """
    from hfa_flight.export.deployment_c import exported_texts
    from hfa_flight.policies.deployment.policy import flown_deployment

    policy = flown_deployment(deployment, point)
    return write_texts(request.output, exported_texts(policy, origin))


def _written(
    request: ExportRequest,
    model: Model,
    point: OperatingPoint,
    origin: str,
    *,
    with_gain: bool,
) -> list[Path]:
    """Write the aircraft, with a gain, with a controller or alone, as C or as an FMU.

    Returns the paths of the written files.

    origin: provenance, for comments in the source
    with_gain: whether the policy of the options is included if no controller is given
    """
    from controller.schedule.scheduled_controller import load_controller
    from hfa_flight.export.aircraft_c import c_model_texts
    from hfa_flight.export.controller_c import c_controller_texts, controller_steering
    from hfa_flight.export.exported_loop import exported_loop, following_a_reference
    from hfa_flight.export.fmu import write_fmu

    actuators = actuators_of(model, request.actuators)
    controller = None
    if request.controller is not None:
        controller = load_controller(request.controller, model)
    linear = noted_linear_model(model, point)
    policy = None
    if controller is None and with_gain:
        policy = request.policy_about(linear)
    if _is_fmu(request):
        steering = None
        if controller is not None:
            steering = controller_steering(controller, model, point)
        elif policy is not None:
            steering = following_a_reference(model, policy)
        loop = exported_loop(model, point, steering, actuators)
        write_fmu(loop, request.output, request.provenance)
        return [request.output]
    texts = c_model_texts(linear, policy, origin)
    if controller is not None:
        texts |= c_controller_texts(controller, model, point, origin, actuators)
    return write_texts(request.output, texts)


def _report(written: list[Path]) -> Report:
    rows = [(str(path), path.stat().st_size) for path in written]
    table = Table(("file", "bytes"), [(printable(name), str(size)) for name, size in rows])
    listed = [{"file": name, "bytes": size} for name, size in rows]
    return Report(
        f"Exported: {len(rows)} {'files' if len(rows) > 1 else 'file'}",
        [table],
        data=Exported(files=listed).as_data(),
    )
