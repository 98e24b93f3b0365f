"""Models from files: a Python file of the user's, or a module."""

from __future__ import annotations

import hashlib
import importlib
import sys
import types
from dataclasses import replace
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
    """An entry point of `hfa.aircraft`."""

    def __call__(self, text: str) -> Model:
        """Read the aircraft that the text after --aircraft names. Raises BadInputError for a wrong
        one."""


@checks_arguments
def load_model(text: str) -> Model:
    """The Model of `FILE.py:NAME` or `package.module:NAME`, which is executed, or of a scheme or
    suffix that a package reads (`hfa_support.entry_points.AIRCRAFT`), as `scheme:NAME`.

    BadInputError names the file and its fault.

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
            f"{error.filename} cannot be read ({error.strerror}); give FILE.py:NAME"
        ) from error
    except SyntaxError as error:
        raise BadInputError(
            f"{where}: SyntaxError in line {error.lineno}: {error.msg}; correct the file"
        ) from error
    except SystemExit as error:
        raise BadInputError(
            f"{where}: ends the program (sys.exit) where it is loaded; put its calls under "
            'if __name__ == "__main__":'
        ) from error
    except Exception as error:  # whatever the user's file raises
        raise BadInputError(
            f"{where}: {type(error).__name__}: {error}; correct the file"
        ) from error
    if not isinstance(model, Model):
        raise BadInputError(f"{where}: {_what_is_there(module, name, model)}")
    return _loaded(model, text, sources)


def _loaded(model: Model, text: str, digest: str) -> Model:
    """Return the model, which another process can load from the same text."""
    extras = replace(model.extras, source=(text, digest), made_by=reloaded)
    return replace(model, extras=extras)


def forms_of_packages() -> list[str]:
    """The forms in which packages read aircraft: schemes first, then suffixes."""
    names = sorted(offered(AIRCRAFT), key=lambda name: name.startswith("."))
    return [f"FILE{name}" if name.startswith(".") else f"{name}:NAME" for name in names]


def _format_of(text: str) -> EntryPoint | None:
    """Return the reader of this scheme, or of the longest suffix, or None for Python.

    The text after a "?" belongs to the reader."""
    scheme = text.partition(":")[0]
    suffixes = "".join(Path(text.partition("?")[0]).suffixes)
    names = [scheme, *(suffixes[at:] for at, each in enumerate(suffixes) if each == ".")]
    readers = offered(AIRCRAFT)
    return next((readers[name] for name in names if name in readers), None)


def _read(offer: EntryPoint, text: str) -> Model:
    """Return the model that a reader of another package makes of a text. Raises BadInputError where
    the result is not a Model."""
    read: AircraftReader = loaded(offer)
    with file_faults(text):
        model = read(text)
    if not isinstance(model, Model):
        raise BadInputError(
            f"{offer.value} reads {shown(text)} as {shown(model)}, not as a Model; correct that"
            " package"
        )
    return model


def _digest(model: Model, text: str) -> str:
    """Return the hash of a reader's input: its own, or a hash of the file and of the model."""
    if model.extras.source[1]:
        return model.extras.source[1]
    path = Path(text.partition("?")[0])
    content = regular_file(str(path)).read_bytes() if path.exists() else text.encode()
    return fingerprint(model, hashlib.sha256(content).hexdigest())


def _executed(file: str) -> types.ModuleType:
    """The module of a file."""
    content = regular_file(file).read_bytes()
    module = types.ModuleType(f"aircraft_{Path(file).stem}")
    module.__file__ = file  # with which it finds its tables
    sys.modules[module.__name__] = module  # where its dataclasses look for it
    exec(compile(content, file, "exec"), module.__dict__)
    return module


def _imported(name: str) -> types.ModuleType:
    """A module of the working folder or of the installed packages."""
    if "" not in sys.path:
        sys.path.insert(0, "")
    return importlib.import_module(name)


def _what_is_there(module: types.ModuleType, name: str, value: Any) -> str:
    """Return a message: a name is not a model, and the names of models."""
    what = "has no name" if value is None else f"holds {shown(value)}, not a Model, under"
    models = [other for other, held in vars(module).items() if isinstance(held, Model)]
    advice = f"use {', '.join(models)}" if models else "define a Model"
    return f"{what} {name}; {advice}"


def reloaded(source: tuple[str, str], parameters: dict[str, float]) -> Model:
    """The model of a file in another process. Raises BadInputError when the file has changed
    since."""
    model = load_model(source[0])
    if model.extras.source != source:
        raise BadInputError(f"{source[0]} has changed since the work began; start again")
    return model.with_parameters(**parameters)
