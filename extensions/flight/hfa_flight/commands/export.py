"""The command `hfa export`."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass, replace
from importlib.resources import files
from pathlib import Path
from typing import TYPE_CHECKING

from hfa.options.aircraft import Aircraft
from hfa.options.argument_types import one_of, output_file
from hfa.options.output import Output
from hfa.options.part import option, part
from hfa.options.request import Request, command
from hfa.options.trim import Trim
from hfa_flight.air.turbulence import Turbulence
from hfa_flight.export.c_text import write_texts
from hfa_flight.options import (
    EXACT,
    PolicyGiven,
    actuators_of,
    actuators_option,
    at_held_altitude,
    noise_option,
    noted_linear_model,
    turbulence_option,
)
from hfa_support.errors import BadInputError, printable
from hfa_support.files import write_text
from hfa_support.reporting.report import Report
from hfa_support.reporting.text import Table

if TYPE_CHECKING:
    from hfa_aircraft.model import Model
    from hfa_flight.policies.policy import FunctionPolicy, GainPolicy
    from hfa_flight.policies.scheduled_gains import ScheduledGainPolicy
    from trim.point.operating_point import OperatingPoint

#: Default dihedral angle of the exported HFA, deg.
_DIHEDRAL = math.radians(15.0)


@dataclass(frozen=True, kw_only=True, eq=False)
class ExportRequest(Request):
    """Options of `hfa export`."""

    aircraft: Aircraft = part(Aircraft, without=("units",))
    trim: Trim = part(Trim)
    policy: PolicyGiven = part(
        PolicyGiven,
        without=("horizon", "margin", "keep_inside"),
        law=option(
            f"gain to export: {EXACT}; default: {EXACT} in C, none in an FMU",
            "NAME",
            one_of(EXACT),
            default=EXACT,
        ),
    )
    output: Output = part(
        Output,
        file=option(
            "folder for C source, FILE.fmu for an FMU, or FILE.m for a function that reads models "
            "from .mat files",
            "PLACE",
            output_file(".fmu", ".m", folder=True),
            names="-o --output",
            required=True,
        ),
    )
    actuators: tuple[float, ...] | None = actuators_option()
    filter: bool = option(
        "policy behind the Kalman filter of --noise and --turbulence, in C too, or in the FMU",
        default=False,
        rare=True,
    )
    noise: Mapping[str, float] = noise_option(
        "standard deviation of the noise of a sensor of --filter, degrees for angles; repeatable"
    )
    turbulence: Turbulence | None = turbulence_option()

    @property
    def target(self) -> Path:
        """The folder or file of -o."""
        assert self.output.file is not None  # required
        return self.output.file


@command(ExportRequest)
def export(request: ExportRequest) -> int:
    """Export an aircraft and its controller to other tools; -o selects the format.

    A folder receives C source without dependencies: equations, trim at --at, A, B, a gain and an
    example 100 Hz loop. FILE.fmu is the nonlinear aircraft as an FMU 2.0, in closed loop if a
    law, gain or gain table is given. An FMU requires a C compiler. FILE.m is a MATLAB and Octave
    function that makes state-space systems from the .mat files of `hfa sweep` and `hfa linearize`.
    With --policy DEPLOYMENT.toml, the C source is only a function for one sample of the deployed
    policy, with normalizer, clipping and mapping.
    """
    policy = request.policy
    names_no_policy = policy.typed.keys().isdisjoint(("law", "weights", "controller", "deployment"))
    if request.trim.at is None and not request.aircraft.is_given:
        request = replace(request, trim=replace(request.trim, at=_DIHEDRAL))
    # Computing the provenance checks options that the code below does not read, before any file is
    # written.
    origin = f"{request.provenance.text()}\n{request.line}"
    if request.target.suffix.lower() == ".m":
        return _write_function(request)
    if not _is_fmu(request):
        request.refuse(("actuators",), "applies only to an FMU; remove this option")
    if policy.deployment is not None and _is_fmu(request):
        raise BadInputError(
            f"{request.target}: an FMU has neither the sample time nor the delay of a deployment "
            "file; give a folder for C source, which is called once a sample"
        )
    policy.check(request)
    _check_filter(request)
    model = request.trim.aircraft
    point = request.trim.point()
    if policy.deployment is not None:
        written = _write_deployed_policy(request, policy.deployment, point, origin)
    else:
        is_aircraft_alone = names_no_policy and _is_fmu(request) and not request.filter
        written = _written(request, model, point, origin, with_gain=not is_aircraft_alone)
    request.print(_report(written), notes=point.warnings)
    return 0


def _check_filter(request: ExportRequest) -> None:
    """Raise BadInputError for options of a filter that have no effect or contradict others."""
    if not request.filter:
        request.refuse(("noise", "turbulence"), "applies only with --filter; add --filter")
        return
    if not request.noise:
        raise BadInputError("--filter requires the noise of the sensors; add --noise STATE=VALUE")
    request.refuse(("policy.controller", "policy.deployment"), "cannot be combined with --filter")


def _is_fmu(request: ExportRequest) -> bool:
    """Return whether the output is an .fmu file."""
    return request.target.suffix.lower() == ".fmu"


def _write_function(request: ExportRequest) -> int:
    """Write the MATLAB and Octave function, print the report and return exit code 0."""
    target = request.target
    if not re.fullmatch(r"[A-Za-z]\w*", target.stem, re.ASCII):
        raise BadInputError(
            f"{target}: the file name is not a name of a function; give a letter, then letters, "
            "digits and _, as in hfa_models.m"
        )
    write_text(target, files("hfa_flight.export").joinpath("hfa_models.m").read_text("utf-8"))
    request.print(_report([target]))
    return 0


def _write_deployed_policy(
    request: ExportRequest, deployment: Path, point: OperatingPoint, origin: str
) -> list[Path]:
    """Write the command of a deployed policy at one sample as a C function."""
    from hfa_flight.export.deployment_c import c_policy_texts
    from hfa_flight.policies.deployment.policy import flown_deployment

    policy = flown_deployment(deployment, point)
    return write_texts(request.target, c_policy_texts(policy, origin))


def _written(
    request: ExportRequest,
    model: Model,
    point: OperatingPoint,
    origin: str,
    *,
    with_gain: bool,
) -> list[Path]:
    """Write the aircraft, with a policy or alone, as C or as an FMU."""
    from hfa_flight.export.aircraft_c import c_model_texts
    from hfa_flight.export.exported_loop import (
        behind_a_filter,
        exported_loop,
        following_a_reference,
    )
    from hfa_flight.export.filter_c import c_filter_texts
    from hfa_flight.export.fmu import write_fmu
    from hfa_flight.policies.kalman import filter
    from hfa_flight.policies.scheduled_gains import scheduled_gains
    from hfa_flight.schedule.gain_schedule import load_gain_schedule

    actuators = actuators_of(model, request.actuators)
    linear = noted_linear_model(model, point)
    policy: GainPolicy | FunctionPolicy | ScheduledGainPolicy | None = None
    if request.policy.controller is not None:
        schedule = load_gain_schedule(request.policy.controller, model)
        name = f"gains of {request.policy.controller}"
        policy = scheduled_gains(name, schedule, point, request.trim.common_condition.at)
    elif with_gain:
        policy = request.policy.about(linear)
    filtered = None
    if request.filter:
        air = at_held_altitude(request.turbulence, request.trim.hold)
        filtered = filter(linear, request.noise, air).policy(policy)
    if _is_fmu(request):
        steering = None if policy is None else following_a_reference(model, policy)
        if filtered is not None:
            steering = behind_a_filter(model, filtered)
        loop = exported_loop(model, point, steering, actuators)
        write_fmu(loop, request.target, request.provenance)
        return [request.target]
    texts = c_model_texts(linear, policy, origin)
    if filtered is not None:
        texts |= c_filter_texts(filtered, origin)
    return write_texts(request.target, texts)


def _report(written: list[Path]) -> Report:
    rows = [(str(path), path.stat().st_size) for path in written]
    table = Table(("file", "bytes"), [(printable(name), str(size)) for name, size in rows])
    listed = [{"file": name, "bytes": size} for name, size in rows]
    title = f"Exported: {len(rows)} {'files' if len(rows) > 1 else 'file'}"
    return Report(title, [table], data={"schema": "hfa.export/1", "files": listed})
