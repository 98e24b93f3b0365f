"""Models that Python files and modules define. The code is executed."""

from __future__ import annotations

import importlib
import sys
import types
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from hfa_aircraft.local_sources import OWN_PACKAGES, fingerprint, hash_of_sources, local_file
from hfa_aircraft.model import Model
from hfa_support.errors import BadInputError, shown
from hfa_support.files import regular_file, resolved


def model_of_python(text: str) -> tuple[Model, str]:
    """Return the model that a Python file or module defines, and the hash of its sources.

    text: `FILE.py:NAME`, `FILE.py` with a single model, or `package.module:NAME`

    Raises BadInputError if the file or module cannot be read, fails, or has no such model.
    """
    if text.endswith(".py"):
        where, name = text, ""
    else:
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
    return model, sources


def _executed(file: str) -> types.ModuleType:
    """Return the module of a Python file, which can import from its folder as in `python FILE`."""
    content = regular_file(file).read_bytes()
    module = types.ModuleType(f"aircraft_{Path(file).stem}")
    module.__file__ = file  # the module finds its data files with it
    sys.modules[module.__name__] = module  # dataclasses look up their module there
    with _imports_from(resolved(file).parent):
        exec(compile(content, file, "exec"), module.__dict__)
    return module


#: Names of the modules that executed files imported from their folders.
_IMPORTED_FROM_FOLDERS: set[str] = set()


@contextmanager
def _imports_from(folder: Path) -> Iterator[None]:
    """Let import statements in the `with` block find the modules in a folder, before others."""
    # Modules that an earlier block imported from its folder are imported again: a module of the
    # same name in another folder, or a changed file, is another module. The packages of this
    # project keep their names.
    for name in OWN_PACKAGES:
        importlib.import_module(name)
    for name in _IMPORTED_FROM_FOLDERS:
        sys.modules.pop(name, None)
    _IMPORTED_FROM_FOLDERS.clear()
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
        imported = set(sys.modules) - before
        _IMPORTED_FROM_FOLDERS.update(name for name in imported if local_file(name, folder))


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
    """Return the message that a name of a module is no model, with the models of the module."""
    models = list(_models_of(module))
    if not name:
        return (
            f"no name of a model is given; give {module.__file__}:{' or :'.join(models) or 'NAME'}"
        )
    what = "does not exist" if value is None else f"is {shown(value)}, not a Model"
    advice = f"use {', '.join(models)}" if models else "define a Model"
    return f"{name} {what}; {advice}"
