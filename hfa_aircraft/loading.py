"""Loading of models from Python files, modules, data files and formats of installed packages."""

from __future__ import annotations

import hashlib
import os
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from shlex import quote
from typing import Any, Protocol

from hfa_aircraft.model import Model
from hfa_aircraft.python_file import fingerprint, model_of_python
from hfa_support.entry_points import AIRCRAFT, loaded, offered
from hfa_support.errors import (
    BadInputError,
    file_faults,
    prefix_errors,
    refuse_unknown,
    shown,
)
from hfa_support.files import NUMBER, Number, checked, read_toml, regular_file, resolved

#: Entries of such a file. Other readers use [covariance]; [bands] is checked with an aircraft.
_FILE: dict[str, Any] = {
    "aircraft": str,
    "sha256": str,
    "parameters": {str: NUMBER},
    "bands": {str: [Number(infinite=True)]},
    "covariance": None,
    "sensors": {str: NUMBER},
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
        return cls(
            path=file,
            aircraft=found.get("aircraft", ""),
            sha256=found.get("sha256", ""),
            values=found.get("parameters", {}),
            bands=found.get("bands", {}),
            sensors=found.get("sensors", {}),
        )

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
            if len(band) != 2 or not band[0] <= values[name] <= band[1]:
                raise BadInputError(
                    f"{self.path}: the band of {name} is {shown(band)}; give [low, high] around "
                    f"its value {shown(values[name])}"
                )


#: Suffixes of the data files that the project reads.
DATA_FILES = (".csv", ".json", ".mat", ".npz", ".st", ".toml")
#: Suffix of aircraft that are compiled programs (FMI), which `hfa_fmu` executes.
COMPILED = ".fmu"
#: Largest number of files of which each names the next.
_MOST_FILES = 20
#: What precedes the table of masses in the text of an aircraft: "wing.st?mass=mass.toml".
MASS = "?mass="


class AircraftReader(Protocol):
    """Function that reads an aircraft, also the type of the entry points of `hfa.aircraft`."""

    def __call__(self, text: str, /) -> Model:
        """Return the model of an aircraft.

        text: argument of --aircraft

        Raises BadInputError for an invalid text or file.
        """


def load_model(
    text: str | Path, parameters: str | Path | None = None, *, mass: str | Path | None = None
) -> Model:
    """Return the model of an aircraft.

    Python files, modules and FMUs are executed. Data files (`DATA_FILES`) are not. Other schemes
    and suffixes are read by installed packages (`hfa_support.entry_points.AIRCRAFT`).

    text: `FILE.py:NAME`, `FILE.py` with a single model, `package.module:NAME`, `FILE.suffix` or
        `scheme:NAME`
    parameters: TOML file with new values of parameters, as `hfa identify -o FILE.toml` writes it
    mass: table with the mass, inertias and flight condition of a stability file of AVL (`FILE.st`)

    Raises BadInputError if the text has another form, or if the file or module cannot be read,
    fails, or contains no model of this name. A file of parameters that belongs to another aircraft
    is refused.

    >>> import hfa
    >>> list(hfa.load_model("examples/navion.py:NAVION").inputs)
    ['thrust', 'elevator', 'aileron', 'rudder']
    """
    text = str(text)
    kind = _format_of(text)
    if mass is not None:
        if kind != ".st":
            raise BadInputError(
                f"{shown(text)} takes no mass; give mass with a file of AVL, FILE.st"
            )
        text = f"{text}{MASS}{mass}"
    if kind:
        model = _model_of_data(text, kind)
    else:
        _refuse_unnamed(text)
        model = _with_source(*model_of_python(text), text)
    return model if parameters is None else ParameterFile.read(parameters).applied_to(model)


def reloaded(text: str, digest: str, parameters: dict[str, float]) -> Model:
    """Return a model that was loaded before, loaded again in another process.

    text, digest: `Source.text` and `Source.digest` of the model
    parameters: parameter -> value, for all parameters

    Raises BadInputError if the file has changed or can no longer be loaded.
    """
    model = load_model(text)
    if (model.source.text, model.source.digest) != (text, digest):
        raise BadInputError(f"{text} has changed since the run began; start the run again")
    return model.with_parameters(**parameters)


def _model_of_data(text: str, kind: str, changed_by: tuple[str, ...] = ()) -> Model:
    """Return the aircraft in a data file or of a scheme, with its source.

    kind: suffix or scheme (`_format_of`)
    changed_by: the files of parameters that led to this one, each naming the next
    """
    with file_faults(text):
        if kind == ".toml" and "aircraft" in read_toml(text):
            model = _model_of_parameter_file(text, changed_by)
        else:
            model = _reader_of(kind)(text)
            if not isinstance(model, Model):
                raise BadInputError(
                    f"the reader of {kind} reads {shown(text)} as {shown(model)}; return a Model"
                )
        digest = model.source.digest
        if not digest:  # the reader computed none
            path = Path(text.partition("?")[0])
            content = regular_file(str(path)).read_bytes() if path.exists() else text.encode()
            digest = fingerprint(model, hashlib.sha256(content).hexdigest())
    return _with_source(model, digest, text)


def _model_of_parameter_file(path: str, changed_by: tuple[str, ...]) -> Model:
    """Return the aircraft of a file that names another one and new values of its parameters."""
    # The other aircraft may be described by such a file too. Its path is relative to the folder of
    # the file that names it. Code (Python or an FMU) is never executed.
    # changed_by: as in `_model_of_data`
    file = ParameterFile.read(path)
    base = _with_changed_paths(file.aircraft, lambda name: str(Path(Path(path).parent, name)))
    kind = _format_of(base)
    if kind in ("", COMPILED):
        if not kind:  # Python code, or no aircraft at all
            with prefix_errors(path):
                _refuse_unnamed(base)
        raise BadInputError(
            f"{path} changes parameters of {shown(base)}, which is code, and a data file "
            f"executes none; give --aircraft {quote(base)} --parameters {quote(str(path))}"
        )
    files = (*changed_by, path)
    is_circle = resolved(base) in map(resolved, files)
    if is_circle or len(files) == _MOST_FILES:
        named = files if is_circle else (files[0], "...", files[-1])
        names = " -> ".join((*named, base))
        raise BadInputError(f"{names}: these files name each other; name a table of data")
    with prefix_errors(files[0]):
        model = _model_of_data(base, kind, files)
    return file.read_as_aircraft(model)


def _with_source(model: Model, digest: str, text: str) -> Model:
    """Return a loaded model with its source, from which another process can load it again."""
    # If the same text and digest were loaded before, the equations of the first model are reused,
    # together with their CasADi functions.
    source = replace(model.source, text=text, digest=digest, reload=reloaded)
    known = _known_equations(text, digest)
    if not known:
        known.append(model.equations)
    return replace(model, equations=known[0], source=source)


@lru_cache(maxsize=16)
def _known_equations(text: str, digest: str) -> list[Callable[..., Any]]:
    """Return the list with the equations that were loaded from a text with this digest."""
    # At first the list is empty. The cache returns the same list for the same arguments, so that an
    # entry which a caller adds is found again.
    return []


def relative_to(text: str, folder: Path) -> str:
    """Return an argument of --aircraft with its file, if any, relative to a folder.

    text: argument of --aircraft, relative to the working folder
    folder: the other folder
    """

    def from_folder(file: str) -> str:
        """Return the path of a file relative to the folder."""
        real = Path(os.path.realpath(Path(file).parent), Path(file).name)
        try:
            return Path(os.path.relpath(real, os.path.realpath(folder))).as_posix()
        except ValueError:  # on another drive of Windows
            return real.as_posix()

    return _with_changed_paths(text, from_folder)


def _with_changed_paths(text: str, change: Callable[[str], str]) -> str:
    """Return an argument of --aircraft with changed paths, if it has any.

    change: path -> new path
    """
    # scheme:NAME and package.module:NAME have none.
    # Each of the three paths of aero.dml+engine.dml?mass=mass.toml is changed.
    file, _, name = text.rpartition(":")
    if file.endswith(".py"):
        return f"{change(file)}:{name}"
    suffix = _format_of(text)
    if not suffix.startswith("."):
        return text
    files, question, query = text.partition("?")
    key, _, mass = query.partition("=")
    if key == "mass":
        query = f"mass={change(mass)}"
    return "+".join(map(change, joined_files(files))) + question + query


def joined_files(text: str) -> list[str]:
    """Return the paths in "a.dml+b.dml". A + that does not follow the suffix of the last file
    belongs to a path, and the path of a file that exists is not divided.
    """
    if Path(text).is_file():
        return [text]
    return re.split(rf"(?<={re.escape(Path(text).suffix)})\+", text, flags=re.IGNORECASE)


def forms_of_packages() -> list[str]:
    """Return the forms of --aircraft for data files and schemes, such as "FILE.toml".

    Schemes come before suffixes.
    """
    names = sorted(_known_formats(), key=lambda name: (name.startswith("."), name))
    return [f"FILE{name}" if name.startswith(".") else f"{name}:NAME" for name in names]


def _refuse_unnamed(text: str) -> None:
    """Raise BadInputError unless the argument of --aircraft is FILE.py or ends with `:NAME`."""
    _, colon, name = text.rpartition(":")
    if not text.endswith(".py") and not (colon and name.isidentifier()):
        if text.lower().endswith(".avl"):
            raise BadInputError(
                f"{shown(text)} is a geometry of AVL; give the stability derivatives that AVL "
                "writes of it (its command ST): --aircraft FILE.st --mass TABLE.toml"
            )
        forms = ", ".join(("FILE.py:NAME", *forms_of_packages()))
        raise BadInputError(
            f"{shown(text)} is not an aircraft; give {forms} or package.module:NAME"
        )


def _format_of(text: str) -> str:
    """Return the scheme or suffix that selects the reader of an aircraft, or "" for Python code."""
    # A scheme, such as "jsbsim" in "jsbsim:737", selects before a suffix, and the longest known
    # suffix before shorter ones. Text after a "?" does not affect the choice.
    if text.rpartition(":")[0].endswith(".py"):
        return ""
    scheme = text.partition(":")[0]
    suffixes = "".join(Path(text.partition("?")[0]).suffixes).lower()
    names = [scheme, *(suffixes[at:] for at, character in enumerate(suffixes) if character == ".")]
    return next((name for name in names if name in _known_formats()), "")


def _known_formats() -> tuple[str, ...]:
    """Return the schemes and suffixes that the project and installed packages read."""
    return (*DATA_FILES, *offered(AIRCRAFT, DATA_FILES))


def _reader_of(kind: str) -> AircraftReader:
    """Return the reader of a suffix or scheme: that of the project, or of an installed package."""
    if kind in (".csv", ".toml", ".st"):
        from hfa_aircraft.readers.derivatives import read as derivatives

        return derivatives.read_avl if kind == ".st" else derivatives.read_model
    if kind in (".json", ".mat", ".npz"):
        from hfa_aircraft.readers.matrices_file import linear_plant

        return linear_plant
    reader: AircraftReader = loaded(offered(AIRCRAFT, DATA_FILES)[kind])
    return reader
