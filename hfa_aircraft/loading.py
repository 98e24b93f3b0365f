"""Loading of models from Python files, modules and further formats of installed packages."""

from __future__ import annotations

import hashlib
import importlib
import sys
import types
from collections.abc import Callable
from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

from hfa_aircraft.local_sources import fingerprint, hash_of_sources
from hfa_aircraft.model import Model
from hfa_support.arguments import checks_arguments
from hfa_support.entry_points import AIRCRAFT, loaded, offered
from hfa_support.errors import BadInputError, file_faults, shown
from hfa_support.files import regular_file

if TYPE_CHECKING:
    from importlib.metadata import EntryPoint


class AircraftReader(Protocol):
    """Type of the entry points of `hfa.aircraft`: functions that read an aircraft."""

    def __call__(self, text: str) -> Model:
        """Return the model of an aircraft.

        text: argument of --aircraft

        Raises BadInputError for an invalid text or file.
        """


@checks_arguments
def load_model(text: str) -> Model:
    """Return the model of an aircraft.

    Python files and modules are executed. Other schemes and suffixes are read by installed packages
    (`hfa_support.entry_points.AIRCRAFT`).

    text: `FILE.py:NAME`, `package.module:NAME`, `FILE.suffix` or `scheme:NAME`

    Raises BadInputError if the text has another form, or if the file or module cannot be read,
    fails, or contains no model of this name.

    >>> import hfa
    >>> list(hfa.load_model("examples/navion.py:NAVION").inputs)
    ['thrust', 'elevator', 'aileron', 'rudder']
    """
    where, colon, name = text.rpartition(":")
    if not where.endswith(".py"):
        offer = _format_of(text)
        if offer is not None:
            read = _read(offer, text)
            return _loaded(read, text, _digest(read, text))
    if not colon or not name.isidentifier():
        forms = ", ".join(("FILE.py:NAME", *forms_of_packages()))
        raise BadInputError(
            f"{shown(text)} is not an aircraft; give {forms} or package.module:NAME"
        )
    try:
        module = _executed(where) if where.endswith(".py") else _imported(where)
        sources = hash_of_sources(Path(str(module.__file__)), module.__package__ or "")
        model = getattr(module, name, None)
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


def _loaded(model: Model, text: str, digest: str) -> Model:
    """Return a loaded model with its source, from which another process can load it again.

    If the same text and digest were loaded before, the equations of the first model are reused,
    together with their CasADi functions.

    text: argument of --aircraft
    digest: hash of the source files
    """
    extras = replace(model.extras, source=(text, digest), made_by=reloaded)
    known = _known_equations(text, digest)
    if not known:
        known.append(model.equations)
    return replace(model, equations=known[0], extras=extras)


@lru_cache(maxsize=16)
def _known_equations(text: str, digest: str) -> list[Callable[..., Any]]:
    """Return a list for the equations loaded from a text with this digest, at first empty.

    Each call with the same arguments returns the same list.
    """
    return []


def forms_of_packages() -> list[str]:
    """Return the forms of --aircraft that installed packages support, such as "FILE.toml".

    Schemes come before suffixes.
    """
    names = sorted(offered(AIRCRAFT), key=lambda name: name.startswith("."))
    return [f"FILE{name}" if name.startswith(".") else f"{name}:NAME" for name in names]


def _format_of(text: str) -> EntryPoint | None:
    """Return the entry point that reads an aircraft, or None if no package reads this format.

    The entry point is selected by the scheme, such as "jsbsim" in "jsbsim:737", or else by the
    longest registered suffix of the file. Text after a "?" does not affect the choice.

    text: argument of --aircraft
    """
    scheme = text.partition(":")[0]
    suffixes = "".join(Path(text.partition("?")[0]).suffixes)
    names = [scheme, *(suffixes[at:] for at, each in enumerate(suffixes) if each == ".")]
    readers = offered(AIRCRAFT)
    return next((readers[name] for name in names if name in readers), None)


def _read(offer: EntryPoint, text: str) -> Model:
    """Return the model that an installed package reads.

    offer: entry point of the reader
    text: argument of --aircraft

    Raises BadInputError if the package cannot be imported, the file cannot be read, or the reader
    does not return a Model.
    """
    read: AircraftReader = loaded(offer)
    with file_faults(text):
        model = read(text)
    if not isinstance(model, Model):
        raise BadInputError(f"{offer.value} reads {shown(text)} as {shown(model)}; return a Model")
    return model


def _digest(model: Model, text: str) -> str:
    """Return the hash of a model that an installed package has read.

    The result is the hash that the reader computed, if any. Otherwise the result is a hash of the
    file and the model. If the file does not exist, the text is hashed in place of the file.

    text: argument of --aircraft
    """
    if model.extras.source[1]:
        return model.extras.source[1]
    path = Path(text.partition("?")[0])
    content = regular_file(str(path)).read_bytes() if path.exists() else text.encode()
    return fingerprint(model, hashlib.sha256(content).hexdigest())


def _executed(file: str) -> types.ModuleType:
    """Return the module that results from executing a Python file."""
    content = regular_file(file).read_bytes()
    module = types.ModuleType(f"aircraft_{Path(file).stem}")
    module.__file__ = file  # the module finds its data files with it
    sys.modules[module.__name__] = module  # dataclasses look up their module there
    exec(compile(content, file, "exec"), module.__dict__)
    return module


def _imported(name: str) -> types.ModuleType:
    """Return a module, imported from the working folder or the installed packages."""
    if "" not in sys.path:
        sys.path.insert(0, "")
    return importlib.import_module(name)


def _no_model_message(module: types.ModuleType, name: str, value: Any) -> str:
    """Return the error message for a name in a Python module that does not refer to a model.

    The message lists the models of the module.

    name: the name
    value: object of this name, or None if there is none
    """
    what = "does not exist" if value is None else f"is {shown(value)}, not a Model"
    models = [other for other, held in vars(module).items() if isinstance(held, Model)]
    advice = f"use {', '.join(models)}" if models else "define a Model"
    return f"{name} {what}; {advice}"


def reloaded(source: tuple[str, str], parameters: dict[str, float]) -> Model:
    """Return a model that was loaded before, loaded again in another process.

    source: `Extras.source` of the model, text and hash
    parameters: parameter -> value, for all parameters

    Raises BadInputError if the file has changed or can no longer be loaded.
    """
    model = load_model(source[0])
    if model.extras.source != source:
        raise BadInputError(f"{source[0]} has changed since the run began; start the run again")
    return model.with_parameters(**parameters)
