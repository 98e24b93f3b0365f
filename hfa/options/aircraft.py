"""The aircraft of a request: the paper's flexible aircraft (HFA), or an aircraft of the user."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from hfa.options.argument_types import one_of
from hfa.options.part import OfModel, Part, option
from hfa_aircraft.model import Model
from hfa_model.choice import aircraft
from hfa_model.parameters import NAMED, ParameterSet, default_parameters, load_parameters
from hfa_support.errors import BadInputError

if TYPE_CHECKING:
    from hfa_aircraft.uncertain import ParameterSpread


def is_own(model: Model | None) -> bool:
    """Return whether a model was loaded from a file or another source that the user named.

    The result is False for the paper's flexible aircraft and for None.
    """
    return model is not None and model.source.text != ""


def aircraft_help(_: Model | None) -> str:
    """Return the help of --aircraft, with the formats of the core and of installed packages."""
    from hfa_aircraft.loading import forms_of_packages

    forms = ("aircraft (Python and FMUs are executed): package.module:NAME", *forms_of_packages())
    return ", ".join(forms) + "; default: HFA"


def _parameters(model: Model | None, text: str) -> ParameterSet | Path:
    """Return the parameters of the HFA, or the file while the model is unknown."""
    if "=" in text and not Path(text).exists():
        raise BadInputError(f"is {text}, not a file; a parameter is set by --hold {text}")
    return Path(text) if model is None or is_own(model) else load_parameters(text)


@dataclass(frozen=True, kw_only=True, eq=False)
class Aircraft(Part):
    """The aircraft: the HFA with its dynamics and parameters, or an aircraft of the user."""

    units: str | None = option(
        "units of input and output: si (m, kg, N); default: units of the aircraft, of the HFA "
        "ft, slug and lbf",
        "si",
        one_of("si"),
        rare=True,
    )
    source: str | None = option(aircraft_help, "FILE.py:NAME", names="--aircraft")
    dynamics: str = option(
        "equations of the HFA: published (of the printed matrices; default), newton (exact "
        "mechanics), unsteady",
        "VARIANT",
        default="published",
    )
    parameters: ParameterSet | Path | None = option(
        f"parameters of the HFA: a file, {' or '.join(NAMED)} (default: identified); of another "
        "aircraft: a file that hfa identify -o FILE.toml wrote",
        "FILE",
        OfModel(_parameters),
        rare=True,
    )

    mass: Path | None = option(
        "mass, inertias and flight condition of an AVL file (FILE.st): a table",
        "FILE",
        Path,
        rare=True,
    )

    @property
    def is_given(self) -> bool:
        """True if the model is an aircraft that the user loaded, and not the HFA."""
        return is_own(self.model)

    @property
    def parameter_set(self) -> ParameterSet:
        """Parameters of the HFA, from --parameters or the default."""
        known = self.parameters
        return known if isinstance(known, ParameterSet) else default_parameters()

    @classmethod
    def loaded(cls, typed: Mapping[str, Any]) -> Model:
        """Return the model that the options of the user define, in the units of --units.

        typed: field -> value, for the options given by the user

        Raises BadInputError if --dynamics is combined with --aircraft.
        """
        model = cls.declared_model(typed)
        if typed.get("units") != "si":
            return model
        from hfa_aircraft.units import in_si

        return in_si(model)

    @classmethod
    def declared_model(cls, typed: Mapping[str, Any]) -> Model:
        """Return the model of --aircraft, or the HFA, in its own units."""
        if "source" not in typed:
            if "mass" in typed:
                raise BadInputError("--mass applies only to an AVL file; give --aircraft FILE.st")
            known = load_parameters(typed.get("parameters", "identified"))
            return aircraft(typed.get("dynamics", "published"), known.values)
        from hfa_aircraft.loading import load_model

        if "dynamics" in typed:
            raise BadInputError(
                "--dynamics applies only to the HFA; remove this option or --aircraft"
            )
        return load_model(typed["source"], typed.get("parameters"), mass=typed.get("mass"))

    def origin(self, held: Mapping[str, float]) -> dict[str, Any]:
        """Return the provenance of the aircraft.

        The provenance is the aircraft's file with its digest, or the dynamics and parameters of the
        HFA.

        held: parameter -> value, for the parameters that the options of a trim set
        """
        if self.is_given:
            file, digest = self.model.source.text, self.model.source.digest
            origin = {"model": f"{file} (SHA-256 {digest[:12]})"}
            if isinstance(self.parameters, Path):
                content = hashlib.sha256(self.parameters.read_bytes()).hexdigest()
                origin |= {"parameters": str(self.parameters), "parameter_hash": content[:12]}
            return origin
        from hfa_model.parameters import changed_parameters
        from hfa_support.provenance import Change, parameter_hash

        chosen = self.parameter_set
        changed = changed_parameters(chosen)
        for name, value in held.items():
            signal = self.model.parameters[name]
            if value != signal.start:
                changed[name] = Change(value, signal.start, signal.unit)
        return {
            "dynamics": self.dynamics,
            "parameters": chosen.name,
            "parameter_hash": parameter_hash(chosen.values),
            "changed": changed,
        }

    def spread(self, held: Mapping[str, float]) -> ParameterSpread:
        """Return the uncertain parameters of the aircraft, without those that are held.

        Raises BadInputError if their covariance is unknown.
        """
        from hfa_aircraft.uncertain import spread_of

        file = self.parameters or self.model.source.text
        return spread_of(self.model, str(file) if self.is_given else self.parameter_set, held)
