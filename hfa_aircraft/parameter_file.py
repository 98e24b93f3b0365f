"""Files with new values of an aircraft's parameters, as `hfa identify -o FILE.toml` writes them."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from hfa_aircraft.model import Model
from hfa_support.errors import (
    BadInputError,
    file_faults,
    is_finite,
    prefix_errors,
    refuse_unknown,
    shown,
)
from hfa_support.files import NUMBER, checked, read_toml

#: Entries of such a file. Other readers use [covariance]; [bands] is checked with an aircraft.
_FILE: dict[str, Any] = {
    "aircraft": str,
    "sha256": str,
    "parameters": {str: NUMBER},
    "bands": {str: None},
    "covariance": None,
    "sensors": {str: None},
}


@dataclass(frozen=True)
class ParameterFile:
    """New values of an aircraft's parameters, and the aircraft that they belong to.

    path: path of the file.
    aircraft: argument of --aircraft as the file gives it, or "" if the file gives none. A file in
        it is relative to the folder of this file.
    sha256: hash of the aircraft, or "" if the file gives none.
    values: parameter -> value, in the units of the aircraft.
    bands: parameter or sensor error -> [low, high].
    sensors: error of a column of a record -> value.
    """

    path: str
    aircraft: str
    sha256: str
    values: Mapping[str, float]
    bands: Mapping[str, Any]
    sensors: Mapping[str, Any]

    @classmethod
    def read(cls, path: str | Path) -> ParameterFile:
        """Return the content of a TOML file.

        Raises BadInputError if the file cannot be read, or if an entry is unknown or invalid.
        """
        file = str(path)
        with file_faults(file):
            data = read_toml(file)
        found = checked(file, data, _FILE)
        texts = {name: found.get(name, "") for name in ("aircraft", "sha256")}
        values, bands, sensors = (
            found.get(name, {}) for name in ("parameters", "bands", "sensors")
        )
        return cls(file, **texts, values=values, bands=bands, sensors=sensors)

    def applied_to(self, model: Model) -> Model:
        """Return an aircraft with the values of this file.

        Raises BadInputError if the file belongs to an aircraft with another hash, if the aircraft
        has no such parameter, or if a value is beyond the limits or its band.
        """
        source = model.source
        if self.sha256 and self.sha256 != source.digest:
            raise BadInputError(
                f"{self.path} belongs to an aircraft with SHA-256 {shown(self.sha256)}, and "
                f"{source.text} has {shown(source.digest)}; give the unchanged aircraft, or remove "
                "the entry sha256 if the change does not matter"
            )
        with prefix_errors(self.path):
            changed = model.with_parameters(**self.values)
        self._check_bands(changed)
        return changed

    def read_as_aircraft(self, base: Model) -> Model:
        """Return the aircraft that this file describes, with this file as its source.

        base: the aircraft that the file names

        Raises BadInputError as `applied_to` does.
        """
        changed = self.applied_to(base)
        content = base.source.digest + Path(self.path).read_text("utf-8")
        digest = hashlib.sha256(content.encode()).hexdigest()
        return replace(changed, source=replace(changed.source, text=self.path, digest=digest))

    def _check_bands(self, model: Model) -> None:
        """Raise BadInputError unless each band [low, high] contains its value."""
        starts = {name: signal.start for name, signal in model.parameters.items()}
        values = {**starts, **self.sensors}
        for name, band in self.bands.items():
            refuse_unknown(f"{self.path}: [bands] has the unknown parameter", name, values)
            stated = f"the band of {name} is {shown(band)}"
            kinds = [type(end) for end in band] if isinstance(band, list) else []
            if len(kinds) != 2 or not {*kinds} <= {int, float}:
                raise BadInputError(f"{self.path}: {stated}; give [low, high]")
            low, high = band
            if not low <= high:
                raise BadInputError(f"{self.path}: {stated}; give the lower limit first")
            if not (is_finite(values[name]) and low <= values[name] <= high):
                raise BadInputError(
                    f"{self.path}: {name} is {shown(values[name])}, outside the band "
                    f"{shown(band)}; correct the value or the band"
                )
