"""The aircraft of a request: the paper's flexible aircraft (HFA), or an aircraft of the user."""

from __future__ import annotations

import hashlib
from collections.abc import Collection
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from shlex import quote
from typing import TYPE_CHECKING, Any

from hfa.options.argument_types import one_of
from hfa.options.parser import PAPER, option
from hfa_aircraft.model import Model
from hfa_support.errors import BadInputError
from hfa_support.provenance import parameter_hash

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


def _parameter_file(text: str) -> str:
    """Return the name or path of --parameters. Raises BadInputError for NAME=VALUE."""
    if "=" in text and not Path(text).exists():
        raise BadInputError(f"is {text}, not a file; a parameter is set by --hold {quote(text)}")
    return text


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
        _parameter_file,
        group=PAPER,
    )
    mass: Path | None = option(
        "mass, inertias and flight condition of an AVL file (FILE.st): a table",
        "FILE",
        Path,
        rare=True,
    )


@lru_cache(maxsize=1)
def loaded_model(request: AircraftOptions) -> Model:
    """Return the model of --aircraft, or the HFA, in the units of --units.

    A request loads it once: a Python file of the user is executed.

    Raises BadInputError if an option does not apply to the aircraft.
    """
    if request.aircraft is None:
        if request.mass is not None:
            raise BadInputError("--mass applies only to an AVL file; give --aircraft FILE.st")
        from hfa_model.choice import aircraft

        model = aircraft(request.dynamics or "published", parameter_set(request).values)
    else:
        from hfa_aircraft.loading import load_model

        if request.dynamics is not None:
            raise BadInputError(
                "--dynamics applies only to the HFA; remove this option or --aircraft"
            )
        file = None if request.parameters is None else Path(request.parameters)
        model = load_model(request.aircraft, file, mass=request.mass)
    if request.units != "si":
        return model
    from hfa_aircraft.units import in_si

    return in_si(model)


def parameter_set(request: AircraftOptions) -> ParameterSet:
    """Return the parameters of the HFA, from --parameters or the default."""
    from hfa_model.parameters import default_parameters, load_parameters

    if request.parameters is None or request.aircraft is not None:
        return default_parameters()
    return load_parameters(request.parameters)


def is_own(model: Model) -> bool:
    """Return whether a model was loaded from a file or another source of the user (--aircraft)."""
    return model.source.text != ""


def aircraft_source(request: AircraftOptions, model: Model) -> dict[str, Any]:
    """Return the entries of the provenance on the aircraft as loaded.

    They are the aircraft's file with its digest, or the dynamics and parameters of the HFA.
    """
    if is_own(model):
        file, digest = model.source.text, model.source.digest
        source = {"model": f"{file} (SHA-256 {digest[:12]})", "changed": {}}
        if request.parameters is not None:
            content = hashlib.sha256(Path(request.parameters).read_bytes()).hexdigest()
            source |= {"parameters": request.parameters, "parameter_hash": content[:12]}
        return source
    from hfa_model.parameters import changed_parameters

    chosen = parameter_set(request)
    return {
        "dynamics": request.dynamics or "published",
        "parameters": chosen.name,
        "parameter_hash": parameter_hash(chosen.values),
        "changed": changed_parameters(chosen),
    }


def parameter_spread(
    request: AircraftOptions, model: Model, held: Collection[str]
) -> ParameterSpread:
    """Return the uncertain parameters of the aircraft, without those that are held.

    Raises BadInputError if their covariance is unknown.
    """
    from hfa_aircraft.uncertain import spread_of

    file = request.parameters or model.source.text
    return spread_of(model, file if is_own(model) else parameter_set(request), held)
