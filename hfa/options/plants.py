"""The aircraft of a request: the paper's flexible aircraft (HFA), or an aircraft of the user."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from hfa.options.argument_types import one_of, positive, seconds
from hfa.options.parser import PAPER, option
from hfa_aircraft.model import Model
from hfa_support.errors import BadInputError
from hfa_support.provenance import parameter_hash
from hfa_support.units import conversion_factor

if TYPE_CHECKING:
    from hfa_aircraft.uncertain import ParameterSpread
    from hfa_model.parameters import ParameterSet


def aircraft_help() -> str:
    """Return the help of --aircraft, with the formats of the core and of installed packages."""
    from hfa_aircraft.loading import forms_of_packages

    forms = ("aircraft (Python and FMUs are executed): package.module:NAME", *forms_of_packages())
    return ", ".join(forms) + "; default: HFA"


def _parameters_help() -> str:
    """Return the help of --parameters, with the named sets of the HFA."""
    from hfa_model.parameters import NAMED

    named = " (default) or ".join(NAMED)
    return f"parameters: {named}, or a file, of any aircraft, of hfa identify -o FILE.toml"


def _servo(text: str) -> tuple[float, float]:
    """Return lag, s, and rate limit, deg/s or inf, of the typed servos."""
    lag, _, rate = text.partition(":")
    return seconds(lag), positive(rate) if rate else math.inf


@dataclass(frozen=True, kw_only=True, eq=False)
class AircraftOptions:
    """The aircraft: the HFA with its dynamics and parameters, or an aircraft of the user."""

    aircraft: str | None = option(aircraft_help, "FILE.py:NAME")
    units: str | None = option(
        "units of input and output: si (m, kg, N); default: units of the aircraft, of the HFA "
        "ft, slug and lbf",
        "si",
        one_of("si"),
        rare=True,
    )
    dynamics: str | None = option(
        "equations: published (of the printed matrices; default), newton (exact mechanics), "
        "unsteady",
        "VARIANT",
        group=PAPER,
    )
    parameters: str | None = option(
        _parameters_help,
        "FILE",
        group=PAPER,
    )
    mass: Path | None = option(
        "mass, inertias and flight condition of an AVL file (FILE.st): a table",
        "FILE",
        Path,
        rare=True,
    )
    servo: tuple[float, float] | None = option(
        "servos of first order of all inputs, whose positions are states that policy and filter "
        "know: lag (20ms, or s) and rate limit of surfaces (deg/s)",
        "LAG[:RATE]",
        _servo,
        rare=True,
    )


class LoadedAircraft(NamedTuple):
    """The aircraft of a request.

    model: the aircraft, in the units of --units
    source: entries of the provenance: the file with its digest, or dynamics and parameters of the
        HFA
    parameters: parameters of the HFA, None of another aircraft
    """

    model: Model
    source: Mapping[str, Any]
    parameters: ParameterSet | None


@lru_cache(maxsize=1)
def loaded_aircraft(request: AircraftOptions) -> LoadedAircraft:
    """Return the aircraft of --aircraft, or the HFA.

    A request loads it once: a Python file of the user is executed.

    Raises BadInputError if an option does not apply to the aircraft.
    """
    parameters = None
    source: dict[str, Any]
    if request.aircraft is None:
        if request.mass is not None:
            raise BadInputError("--mass applies only to an AVL file; give --aircraft FILE.st")
        from hfa_model.choice import aircraft
        from hfa_model.parameters import changed_parameters, load_parameters

        file, dynamics = request.parameters, request.dynamics or "published"
        parameters = load_parameters("identified" if file is None else file)
        model = aircraft(dynamics, parameters.values)
        source = {
            "dynamics": dynamics,
            "parameters": parameters.name,
            "parameter_hash": parameter_hash(parameters.values),
            "changed": changed_parameters(parameters),
        }
    else:
        from hfa_aircraft.loading import load_model

        if request.dynamics is not None:
            raise BadInputError(
                "--dynamics applies only to the HFA; remove this option or --aircraft"
            )
        model = load_model(request.aircraft, request.parameters, mass=request.mass)
        loaded = model.source
        source = {"model": f"{loaded.text} (SHA-256 {loaded.digest[:12]})", "changed": {}}
        if request.parameters is not None:
            content = hashlib.sha256(Path(request.parameters).read_bytes()).hexdigest()
            source |= {"parameters": request.parameters, "parameter_hash": content[:12]}
    if request.units == "si":
        from hfa_aircraft.units import in_si

        model = in_si(model)
    if request.servo is not None:
        from hfa_aircraft.servos import Servo, with_servos

        lag, rate = request.servo
        servos = {  # the rate is that of the surfaces
            name: Servo(lag, rate * (conversion_factor("deg", signal.unit) or math.inf))
            for name, signal in model.inputs.items()
        }
        model = with_servos(model, servos)
    return LoadedAircraft(model, source, parameters)


def loaded_model(request: AircraftOptions) -> Model:
    """Return the model of --aircraft, or the HFA, in the units of --units.

    Raises BadInputError if an option does not apply to the aircraft.
    """
    return loaded_aircraft(request).model


def parameter_spread(
    request: AircraftOptions, model: Model, held: Collection[str]
) -> ParameterSpread:
    """Return the uncertain parameters of the aircraft, without those that are held.

    Raises BadInputError if their covariance is unknown.
    """
    from hfa_aircraft.uncertain import spread_of

    # The parameters of the HFA, those of --parameters, or those of the file of the aircraft.
    of_hfa = loaded_aircraft(request).parameters
    return spread_of(model, of_hfa or request.parameters or model.source.text, held)
