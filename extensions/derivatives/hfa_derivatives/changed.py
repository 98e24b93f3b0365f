"""Aircraft defined by the file of another aircraft and new values of its parameters."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from hfa_aircraft.loading import load_model
from hfa_aircraft.model import Model
from hfa_support.errors import (
    BadInputError,
    file_faults,
    is_finite,
    prefix_errors,
    refuse_unknown,
    shown,
)
from hfa_support.files import read_toml

#: Permitted entries of such a file. [covariance] is used by other readers.
_KNOWN = ("aircraft", "parameters", "bands", "covariance", "sensors")


def changed_aircraft(path: str) -> Model | None:
    """Return the aircraft of a TOML file that names another aircraft and new values of parameters.

    The entry `aircraft` names the other aircraft. The values in the table [parameters] are in the
    units of the other aircraft. Return None if the file has no entry `aircraft`.

    Raises BadInputError if the file or the other aircraft cannot be loaded, or if an entry is
    unknown or invalid.
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
        raise BadInputError(
            f"{path}: the entry aircraft is {shown(other)}; give the path of the aircraft file "
            "that these parameters change"
        )
    values = _table(path, data, "parameters")
    for name, value in values.items():
        if not is_finite(value):
            raise BadInputError(f"{path}: parameter {name} is {shown(value)}; give a finite number")
    with prefix_errors(path):
        model = load_model(other).with_parameters(**values)
    _check_bands(path, data, model)
    digest = hashlib.sha256((model.extras.source[1] + Path(path).read_text("utf-8")).encode())
    extras = replace(model.extras, source=(path, digest.hexdigest()))
    return replace(model, extras=extras)


def _check_bands(path: str, data: Mapping[str, Any], model: Model) -> None:
    """Raise BadInputError unless each entry of [bands] is a pair [low, high] that contains the
    value.

    The name of each entry must be that of a parameter of the model or of a sensor error of the
    file.
    """
    bands = _table(path, data, "bands")
    sensors = _table(path, data, "sensors")
    values = {name: signal.start for name, signal in model.parameters.items()} | sensors
    for name, band in bands.items():
        refuse_unknown(f"{path}: [bands] has the unknown parameter", name, values)
        if not _is_pair(band):
            raise BadInputError(f"{path}: the band of {name} is {shown(band)}; give [low, high]")
        low, high = band
        if not low <= high:
            raise BadInputError(
                f"{path}: the band of {name} is {shown(band)}; give the lower limit first"
            )
        if not (is_finite(values[name]) and low <= values[name] <= high):
            raise BadInputError(
                f"{path}: {name} is {shown(values[name])}, outside the band {shown(band)}; "
                "correct the value or the band"
            )


def _table(path: str, data: Mapping[str, Any], name: str) -> dict[str, Any]:
    """Return the table with the given name from the data of a TOML file, or {} if it is missing.

    Raises BadInputError if the entry is not a table.
    """
    table = data.get(name, {})
    if not isinstance(table, dict):
        raise BadInputError(f"{path}: {name} is {shown(table)}; give a table [{name}]")
    return table


def _is_pair(band: Any) -> bool:
    """Return whether `band` is a list of two numbers of type int or float (not bool)."""
    return isinstance(band, list) and [type(end) in (int, float) for end in band] == [True, True]
