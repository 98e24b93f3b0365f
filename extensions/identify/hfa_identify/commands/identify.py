"""The command `hfa identify`."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from hfa.options.argument_types import each_of, input_file, listed_names, one_of, quantity
from hfa.options.command import (
    Outcome,
    ProgressLine,
    Request,
    command,
    output_option,
    picture_option,
)
from hfa.options.parser import option
from hfa.options.plants import AircraftOptions, LoadedAircraft, loaded_aircraft
from hfa_aircraft.model import Model
from hfa_support.errors import refuse_unknown
from hfa_support.files import TABLE_FILES

#: Suffix of the file of an identified aircraft.
AIRCRAFT = ".toml"


def _held(model: Model, name: str, text: str) -> float:
    """Return the value typed for an input or an initial state, in the model's units."""
    refuse_unknown("names the unknown input or state", name, (*model.inputs, *model.states))
    return quantity(model, name, text)


def _given(model: Model, name: str, text: str) -> float:
    """Return the value typed for a parameter, in the model's units."""
    refuse_unknown("names the unknown parameter", name, tuple(model.parameters))
    return quantity(model, name, text)


@dataclass(frozen=True, kw_only=True, eq=False)
class IdentifyRequest(Request, AircraftOptions):
    """Arguments of `hfa identify`: flight records and the parameters to be identified."""

    units: None = None
    output: Path | None = output_option(AIRCRAFT, purpose=" (the identified aircraft)")
    picture: Path | None = picture_option("measured and fitted quantities, and residuals")
    records: tuple[Path, ...] = option(
        "flight records with columns for time, inputs, measured states and outputs",
        "RECORD.csv",
        input_file(*TABLE_FILES),
        names="records",
        count="+",
        required=True,
    )
    free: tuple[str, ...] = option(
        "parameters to identify, such as CL_alpha,Cm_q or CL_*,Cm_*; also the bias of a column, "
        "such as bias_alpha",
        "NAMES",
        listed_names,
        required=True,
    )
    given: Mapping[str, str] = option(
        "parameter fixed at this value, even if a pattern of --free matches it; repeatable",
        "NAME=VALUE",
        named=True,
    )
    hold: Mapping[str, str] = option(
        "value of an input without a column, or initial value of an unmeasured state; repeatable",
        "NAME=VALUE",
        named=True,
    )
    inputs: str | None = option(
        "interpolation of the inputs between samples: linear or steps; default: the likelier of "
        "both fits",
        "KIND",
        one_of("linear", "steps"),
    )


@command(IdentifyRequest, loaded_aircraft)
def identify(request: IdentifyRequest, aircraft: LoadedAircraft) -> Outcome:
    """Identify parameters of an aircraft from flight records by maximum likelihood.

    The method is output error. The report contains estimates with 95 % bands corrected for colored
    residuals, correlations, and the quality of the fit. Exit code 0: no findings. Exit code 1:
    findings, such as a quantity that is off the model, with the time and the difference. The first
    line names the most important findings.
    """
    from hfa_identify.estimation import identify as identified_of
    from hfa_identify.identified import aircraft_text
    from hfa_support.files import write_text

    model, progress = aircraft.model, ProgressLine("identify")
    identified = identified_of(
        model,
        request.records,
        request.free,
        given=each_of("--given", model, request.given, _given),
        hold=each_of("--hold", model, request.hold, _held),
        inputs=request.inputs,
        progress=progress,
    )
    file = request.output
    write = None
    if file is not None and file.suffix == AIRCRAFT:
        write = partial(write_text, text=aircraft_text(identified, file.parent))
    return Outcome(
        report=identified.report(),
        ok=identified.ok,
        source=aircraft.source,
        figure=identified.figure,
        write=write,
    )
