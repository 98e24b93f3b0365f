"""The command `hfa export`."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable
from dataclasses import dataclass, replace
from importlib.resources import files
from pathlib import Path
from typing import TYPE_CHECKING

from hfa.options.advice import trimmed
from hfa.options.argument_types import output_file, positive
from hfa.options.command import Outcome, Request, command, provenance
from hfa.options.games import TimingOptions
from hfa.options.parser import option, refuse
from hfa.options.trims import GivenTrim, trim_input
from hfa_flight.air.turbulence import Turbulence
from hfa_flight.export.c_text import (
    AIRCRAFT_FILES,
    c_filter_texts,
    c_model_texts,
    c_policy_texts,
    write_texts,
)
from hfa_flight.options import (
    DEPLOYMENT,
    EXACT,
    PolicyOptions,
    SensorOptions,
    at_held_altitude,
    behind_a_filter,
    check_policy,
    noted_linear_model,
    policy_of_options,
    policy_option,
    sample_of_options,
    sensors_of_options,
    turbulence_option,
)
from hfa_support.errors import BadInputError, printable
from hfa_support.files import write_text
from hfa_support.reporting.report import Report
from hfa_support.reporting.text import Table

if TYPE_CHECKING:
    from hfa_flight.policies.filtered_policy import FilteredPolicy
    from hfa_flight.policies.policy import Policy
    from trim.point.operating_point import OperatingPoint

#: Options that apply only with --filter.
_OF_FILTER = ("sensors", "noise", "bias", "turbulence", "fade", "rate", "delay")
#: Default dihedral angle of the exported HFA, deg.
_DIHEDRAL = math.radians(15.0)


@dataclass(frozen=True, kw_only=True, eq=False)
class ExportRequest(Request, PolicyOptions, SensorOptions, TimingOptions):
    """Options of `hfa export`."""

    units: None = None
    horizon: None = None
    margin: None = None
    keep_inside: bool = False
    policy: str | Path | None = policy_option(
        f"{EXACT}, that of the game, or a FILE: a gain, a gain table, a critic, a network or a "
        f"deployment; default: {EXACT} in C, none in an FMU",
        EXACT,
    )
    output: Path | None = option(
        "folder for C source, FILE.fmu for an FMU, or FILE.m for a function that reads models "
        "from .mat files",
        "PLACE",
        output_file(".fmu", ".m", folder=True),
        names="-o --output",
        required=True,
    )
    filter: bool = option(
        "policy behind the Kalman filter of --noise and --turbulence, in C too, or in the FMU",
        rare=True,
    )
    turbulence: Turbulence | None = turbulence_option()
    fade: float | None = option(
        "time in which the C code of --filter fades commands in where it is switched on in flight, "
        "s; default 1, or 3 if filter and gain alone are unstable",
        "S",
        positive,
        rare=True,
    )

    @property
    def flown(self) -> str | Path:
        """The policy of --policy, or the exact one."""
        return self.policy or EXACT


def _given_trim(request: ExportRequest) -> GivenTrim:
    """Return the trim of the options, by default of the paper's aircraft at `_DIHEDRAL`."""
    asked = trim_input(request)
    if asked.at is None and not asked.rows and request.aircraft is None:
        return asked.trim(_DIHEDRAL, asked.held())
    return asked.single()


@command(ExportRequest, _given_trim)
def export(request: ExportRequest, given: GivenTrim) -> Outcome:
    """Export an aircraft and its controller to other tools; -o selects the format.

    A folder receives C source without dependencies: equations, trim at --at, A, B, a gain and an
    example 100 Hz loop. FILE.fmu is the nonlinear aircraft as an FMU 2.0, in closed loop if
    --policy or --filter is given. An FMU requires a C compiler. FILE.m is a MATLAB and Octave
    function that makes state-space systems from the .mat files of `hfa sweep` and `hfa linearize`.
    With --policy DEPLOYMENT.toml, the C source is only a function for one sample of the deployed
    policy, with normalizer, clipping and mapping.
    """
    target = request.output
    assert target is not None  # required
    if target.suffix.lower() == ".m":
        return _outcome_of([_write_matlab_function(target)], given)
    is_fmu = target.suffix.lower() == ".fmu"
    if is_fmu and request.kind == DEPLOYMENT:
        raise BadInputError(
            f"{target}: an FMU has neither the sample time nor the delay of a deployment "
            "file; give a folder for C source, which is called once a sample"
        )
    check_policy(request)
    _check_filter(request)
    point = trimmed(given)
    write = _write_fmu if is_fmu else _write_source
    return _outcome_of(write(request, target, given, point), given, point.warnings)


def _check_filter(request: ExportRequest) -> None:
    """Raise BadInputError for options of a filter that have no effect or contradict others."""
    if not request.filter:
        refuse(
            request,
            _OF_FILTER,
            "applies only with --filter; add --filter",
        )
        return
    if request.kind == DEPLOYMENT:
        raise BadInputError("--filter cannot be combined with a deployment; remove --filter")


def _write_matlab_function(target: Path) -> Path:
    """Write the function for MATLAB and Octave, and return its path."""
    if not re.fullmatch(r"[A-Za-z]\w*", target.stem, re.ASCII):
        raise BadInputError(
            f"{target}: the file name is not a name of a function; give a letter, then letters, "
            "digits and _, as in hfa_models.m"
        )
    write_text(target, files("hfa_flight.export").joinpath("hfa_models.m").read_text("utf-8"))
    return target


def _write_fmu(
    request: ExportRequest, target: Path, given: GivenTrim, point: OperatingPoint
) -> list[Path]:
    """Write the aircraft as an FMU, with a policy if an option names it or its filter, and return
    the paths of the written files.
    """
    from hfa_flight.export.exported_loop import (
        exported_loop,
        filtered_steering,
        following_a_reference,
    )
    from hfa_flight.export.fmu import write_fmu

    model = given.model
    linear = noted_linear_model(model, point)
    steering = None
    if request.filter or request.policy is not None:
        policy = policy_of_options(request, linear, given.common.at)
        if request.filter:
            steering = filtered_steering(model, _filtered(request, given, point, policy))
        else:
            steering = following_a_reference(model, policy)
    loop = exported_loop(model, point, steering)
    write_fmu(loop, target, provenance(request, given.source))
    return [target]


def _write_source(
    request: ExportRequest, target: Path, given: GivenTrim, point: OperatingPoint
) -> list[Path]:
    """Write the aircraft with a policy as C source, or a deployed policy alone, and return the
    paths of the written files.
    """
    from hfa_flight.policies.deployment.policy import flown_deployment

    origin = f"{provenance(request, given.source).text()}\n{request.line}"
    if isinstance(request.flown, Path) and request.kind == DEPLOYMENT:
        return write_texts(target, c_policy_texts(flown_deployment(request.flown, point), origin))
    linear = noted_linear_model(given.model, point)
    policy = policy_of_options(request, linear, given.common.at)
    texts = c_model_texts(linear, policy, origin)
    if request.filter:
        del texts[AIRCRAFT_FILES[-1]]  # the example loop of a policy at x
        texts |= c_filter_texts(_filtered(request, given, point, policy), origin)
    return write_texts(target, texts)


def _filtered(
    request: ExportRequest, given: GivenTrim, point: OperatingPoint, policy: Policy
) -> FilteredPolicy:
    """Return a policy behind the filter of --noise and --turbulence."""
    sensors = sensors_of_options(request, given.model)
    air = at_held_altitude(request.turbulence, given.hold)
    dt = sample_of_options(request)
    filtered = behind_a_filter(policy, point, sensors, air, dt, request.fade)
    return replace(filtered, delay=request.delay, ahead=request.delay)


def _outcome_of(written: list[Path], given: GivenTrim, notes: Iterable[str] = ()) -> Outcome:
    """Return the outcome with the list of the written files and their sizes."""
    rows = [(str(path), path.stat().st_size) for path in written]
    table = Table(("file", "bytes"), [(printable(name), str(size)) for name, size in rows])
    listed = [{"file": name, "bytes": size} for name, size in rows]
    title = f"Exported: {len(rows)} {'files' if len(rows) > 1 else 'file'}"
    report = Report(title, [table], data={"schema": "hfa.export/1", "files": listed})
    return Outcome(report=report, source=given.source, notes=notes, is_written=True)
