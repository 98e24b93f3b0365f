"""Loading of models from Python files, modules, data files and formats of installed packages."""

from __future__ import annotations

import hashlib
import importlib
import os
import sys
import types
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from typing import Any, Protocol

from hfa_aircraft.local_sources import OWN_PACKAGES, fingerprint, hash_of_sources, local_file
from hfa_aircraft.model import Model
from hfa_aircraft.parameter_file import ParameterFile
from hfa_support.entry_points import AIRCRAFT, loaded, offered
from hfa_support.errors import BadInputError, file_faults, prefix_errors, shown
from hfa_support.files import read_toml, regular_file

#: Suffixes of the data files that the project reads.
DATA_FILES = (".csv", ".json", ".mat", ".npz", ".st", ".toml")


#: Suffix of aircraft that are compiled programs (FMI), which `hfa_fmu` executes.
COMPILED = ".fmu"
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
    model = _loaded_from_data(text, kind) if kind else _loaded_from_python(text)
    return model if parameters is None else ParameterFile.read(parameters).applied_to(model)


def load_changed(path: str) -> Model:
    """Return the aircraft of a file that names another aircraft and new values of its parameters.

    The other aircraft may be described by such a file too. Its path is relative to the folder of
    the file that names it.

    path: a TOML file with the entry `aircraft`

    Raises BadInputError if a file cannot be read or belongs to an aircraft with another hash, if
    files name each other, or if the other aircraft is code (Python or an FMU), which a data file
    never executes.
    """
    files = [ParameterFile.read(path)]
    paths = [Path(path).resolve()]
    while True:
        last = files[-1]
        base = _in_folder(last.aircraft, str(Path(last.path).parent))
        kind = _format_of(base)
        if kind in ("", COMPILED):
            if not kind:
                with prefix_errors(last.path):
                    _refuse_unnamed(base)
            raise BadInputError(
                f"{last.path} changes parameters of {shown(base)}, which is code, and a data file "
                f"executes none; give --aircraft {base} --parameters {last.path}"
            )
        if not is_parameter_file(base):
            break
        if Path(base).resolve() in paths:
            names = " -> ".join([*(each.path for each in files), base])
            raise BadInputError(f"{names}: these files name each other; name a table of data")
        paths.append(Path(base).resolve())
        files.append(ParameterFile.read(base))
    with prefix_errors(last.path):
        model = _loaded_from_data(base, kind)
    for file in reversed(files):
        model = file.read_as_aircraft(model)
    return model


def is_parameter_file(path: str) -> bool:
    """Return whether a file is a TOML file that names another aircraft (`load_changed`).

    Raises BadInputError if it is a TOML file that cannot be read.
    """
    if _format_of(path) != ".toml":
        return False
    with file_faults(path):
        return "aircraft" in read_toml(path)


def relative_to(text: str, folder: Path) -> str:
    """Return an argument of --aircraft with its file, if any, relative to a folder.

    text: argument of --aircraft, relative to the working folder
    folder: the other folder
    """

    def from_folder(file: str) -> str:
        real = Path(os.path.realpath(Path(file).parent), Path(file).name)
        try:
            return Path(os.path.relpath(real, os.path.realpath(folder))).as_posix()
        except ValueError:  # on another drive of Windows
            return real.as_posix()

    return _with_files(text, from_folder)


def _in_folder(text: str, folder: str) -> str:
    """Return an argument of --aircraft relative to `folder`, for the working folder."""
    return _with_files(text, lambda file: str(Path(folder, file)))


def _with_files(text: str, change: Callable[[str], str]) -> str:
    """Return an argument of --aircraft with changed paths. Schemes and modules have no path.

    Each of the three paths of aero.dml+engine.dml?mass=mass.toml is changed.
    """
    where, _, name = text.rpartition(":")
    if where.endswith(".py"):
        return f"{change(where)}:{name}"
    suffix = _format_of(text)
    if not suffix.startswith("."):
        return text
    files, question, query = text.partition("?")
    key, _, mass = query.partition("=")
    if key == "mass":
        query = f"mass={change(mass)}"
    return "+".join(map(change, _split_after(suffix, files))) + question + query


def _split_after(suffix: str, files: str) -> list[str]:
    """Return the paths in "a.dml+b.dml". A + that does not follow the suffix belongs to a path."""
    *first, last = files.split(f"{suffix}+")
    return [*(f"{path}{suffix}" for path in first), last]


def _loaded_from_data(text: str, kind: str) -> Model:
    """Return the aircraft in a data file or of a scheme, with its source."""
    model = _read(text, kind)
    return _loaded(model, text, _digest(model, text))


def _loaded_from_python(text: str) -> Model:
    """Return the model that a Python file or module defines, with its source."""
    if text.endswith(".py"):
        where, name = text, ""
    else:
        _refuse_unnamed(text)
        where, _, name = text.rpartition(":")
    try:
        module = _executed(where) if where.endswith(".py") else _imported(where)
        sources = hash_of_sources(Path(str(module.__file__)), module.__package__ or "")
        model = getattr(module, name, None) if name else _only_model(module)
        if isinstance(model, Model):
            sources = fingerprint(model, sources)
    except BadInputError as error:
        raise BadInputError(f"{where}: {error}") from error
    except OSError as error:
        raise BadInputError(
            f"{error.filename} cannot be read ({error.strerror}); give a readable file"
        ) from error
    except SyntaxError as error:
        raise BadInputError(
            f"{where}: SyntaxError in line {error.lineno}: {error.msg}; correct the file"
        ) from error
    except SystemExit as error:
        raise BadInputError(
            f'{where} calls sys.exit when loaded; put this call under if __name__ == "__main__":'
        ) from error
    except Exception as error:  # any exception of the user's file
        raise BadInputError(
            f"{where}: {type(error).__name__}: {error}; correct the file"
        ) from error
    if not isinstance(model, Model):
        raise BadInputError(f"{where}: {_no_model_message(module, name, model)}")
    return _loaded(model, text, sources)


def _refuse_unnamed(text: str) -> None:
    """Raise BadInputError unless the argument of --aircraft ends with `:NAME`."""
    _, colon, name = text.rpartition(":")
    if not colon or not name.isidentifier():
        forms = ", ".join(("FILE.py:NAME", *forms_of_packages()))
        raise BadInputError(
            f"{shown(text)} is not an aircraft; give {forms} or package.module:NAME"
        )


def _loaded(model: Model, text: str, digest: str) -> Model:
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
    """Return a list for the equations loaded from a text with this digest, at first empty."""
    # Each call with the same arguments returns the same list.
    return []


def forms_of_packages() -> list[str]:
    """Return the forms of --aircraft for data files and schemes, such as "FILE.toml".

    Schemes come before suffixes.
    """
    names = sorted(_kinds(), key=lambda name: (name.startswith("."), name))
    return [f"FILE{name}" if name.startswith(".") else f"{name}:NAME" for name in names]


def _format_of(text: str) -> str:
    """Return the scheme or suffix that selects the reader of an aircraft, or "" for Python code."""
    # It is the scheme, such as "jsbsim" in "jsbsim:737", or else the longest known suffix of the
    # file. Text after a "?" does not affect the choice.
    if text.rpartition(":")[0].endswith(".py"):
        return ""
    scheme = text.partition(":")[0]
    suffixes = "".join(Path(text.partition("?")[0]).suffixes).lower()
    names = [scheme, *(suffixes[at:] for at, each in enumerate(suffixes) if each == ".")]
    return next((name for name in names if name in _kinds()), "")


def _kinds() -> tuple[str, ...]:
    """Return the schemes and suffixes that the project and installed packages read."""
    return (*DATA_FILES, *offered(AIRCRAFT, DATA_FILES))


def _reader_of(kind: str) -> AircraftReader:
    """Return the reader of a suffix or scheme: that of the project, or of an installed package."""
    if kind in (".csv", ".toml"):
        from hfa_aircraft.readers.derivatives import read as derivatives

        return derivatives.read_model
    if kind == ".st":
        from hfa_aircraft.readers.derivatives import read as derivatives

        return derivatives.read_avl
    if kind in (".json", ".mat", ".npz"):
        from hfa_aircraft.readers.matrices_file import linear_plant

        return linear_plant
    reader: AircraftReader = loaded(offered(AIRCRAFT, DATA_FILES)[kind])
    return reader


def _read(text: str, kind: str) -> Model:
    """Return the model that a reader reads, or that a parameter file changes."""
    if is_parameter_file(text):
        return load_changed(text)
    read = _reader_of(kind)
    with file_faults(text):
        model = read(text)
    if not isinstance(model, Model):
        raise BadInputError(
            f"the reader of {kind} reads {shown(text)} as {shown(model)}; return a Model"
        )
    return model


def _digest(model: Model, text: str) -> str:
    """Return the hash of a model that was read from data."""
    # The result is the hash that the reader computed, if any. Otherwise the result is a hash of the
    # file and the model. If the file does not exist, the text is hashed in place of the file.
    if model.source.digest:
        return model.source.digest
    path = Path(text.partition("?")[0])
    content = regular_file(str(path)).read_bytes() if path.exists() else text.encode()
    return fingerprint(model, hashlib.sha256(content).hexdigest())


def _executed(file: str) -> types.ModuleType:
    """Return the module that results from executing a Python file."""
    # The file can import modules in its folder, as in `python FILE.py`.
    content = regular_file(file).read_bytes()
    module = types.ModuleType(f"aircraft_{Path(file).stem}")
    module.__file__ = file  # the module finds its data files with it
    sys.modules[module.__name__] = module  # dataclasses look up their module there
    with _imports_from(Path(file).resolve().parent):
        exec(compile(content, file, "exec"), module.__dict__)
    return module


#: Names of the modules that executed files imported from their folders.
_BESIDE: set[str] = set()


@contextmanager
def _imports_from(folder: Path) -> Iterator[None]:
    """Let import statements in the `with` block find the modules in a folder, before others."""
    # Modules that an earlier block imported from its folder are imported again: a module of the
    # same name in another folder, or a changed file, is another module. The packages of this
    # project keep their names.
    for name in OWN_PACKAGES:
        importlib.import_module(name)
    for name in _BESIDE:
        sys.modules.pop(name, None)
    _BESIDE.clear()
    importlib.invalidate_caches()
    before = set(sys.modules)
    writes_no_bytecode = sys.dont_write_bytecode
    sys.dont_write_bytecode = True  # no files in the user's folder
    sys.path.insert(0, str(folder))
    try:
        yield
    finally:
        sys.path.remove(str(folder))
        sys.dont_write_bytecode = writes_no_bytecode
        _BESIDE.update(name for name in set(sys.modules) - before if local_file(name, folder))


def _imported(name: str) -> types.ModuleType:
    """Return a module, imported from the working folder or the installed packages."""
    if "" not in sys.path:
        sys.path.insert(0, "")
    return importlib.import_module(name)


def _models_of(module: types.ModuleType) -> dict[str, Model]:
    """Return the models of a module, by name."""
    return {name: held for name, held in vars(module).items() if isinstance(held, Model)}


def _only_model(module: types.ModuleType) -> Model | None:
    """Return the model of a module with a single one, or None."""
    models = list(_models_of(module).values())
    return models[0] if len(models) == 1 else None


def _no_model_message(module: types.ModuleType, name: str, value: Any) -> str:
    """Return the error message for a name in a Python module that does not refer to a model."""
    # The message lists the models of the module.
    models = list(_models_of(module))
    if not name:
        return (
            f"no name of a model is given; give {module.__file__}:{' or :'.join(models) or 'NAME'}"
        )
    what = "does not exist" if value is None else f"is {shown(value)}, not a Model"
    advice = f"use {', '.join(models)}" if models else "define a Model"
    return f"{name} {what}; {advice}"


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
