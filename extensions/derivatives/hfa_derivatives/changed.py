"""An aircraft that is another one with other values of its parameters."""

from __future__ import annotations

import hashlib
from dataclasses import replace
from pathlib import Path

from hfa_aircraft.loading import load_model
from hfa_aircraft.model import Model
from hfa_support.errors import BadInputError, file_faults, is_finite, said_of, shown
from hfa_support.files import read_toml

#: Entries of such a file; all but the first two are for others who read it.
_KNOWN = ("aircraft", "parameters", "bands", "covariance", "sensors")


def changed_aircraft(path: str) -> Model | None:
    """The aircraft of a TOML file with `aircraft` and [parameters], in the units of its model, or
    None where the file has no `aircraft`.

    BadInputError names the file and its fault.
    """
    with file_faults(path):
        data = read_toml(path)
    if "aircraft" not in data:
        return None
    unknown = [name for name in data if name not in _KNOWN]
    if unknown:
        raise BadInputError(f"{path}: unknown entry {shown(unknown[0])}; use {', '.join(_KNOWN)}")
    other = data["aircraft"]
    if not isinstance(other, str) or Path(other).name == Path(path).name:
        raise BadInputError(f"{path}: aircraft is {shown(other)}; name another aircraft's file")
    values = data.get("parameters", {})
    if not isinstance(values, dict) or not all(map(is_finite, values.values())):
        raise BadInputError(f"{path}: parameters are {shown(values)}; give numbers by name")
    with said_of(path):
        model = load_model(other).with_parameters(**values)
    digest = hashlib.sha256((model.extras.source[1] + Path(path).read_text("utf-8")).encode())
    extras = replace(model.extras, source=(path, digest.hexdigest()))
    return replace(model, extras=extras)
