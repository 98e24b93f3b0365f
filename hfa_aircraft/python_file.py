"""Models that Python files and modules define. The code is executed."""

from __future__ import annotations

import ast
import hashlib
import importlib
import sys
import types
from collections.abc import Iterator
from contextlib import contextmanager
from importlib.util import resolve_name
from pathlib import Path

import casadi as ca

from hfa_aircraft.model import Model
from hfa_aircraft.signals import VECTORS
from hfa_support.errors import BadInputError, shown
from hfa_support.files import regular_file, resolved
from hfa_support.origin import instructions

#: Packages of this project. An installed version does not belong to a user's model.
OWN_PACKAGES = {
    "hfa",
    "hfa_support",
    "hfa_aircraft",
    "hfa_model",
    "trim",
    "controller",
    "verification",
}
_EXTENSIONS = Path(__file__).resolve().parents[1] / "extensions"


def fingerprint(model: Model, sources: str) -> str:
    """Return the SHA-256 fingerprint of a model.

    The fingerprint covers the source files, the signals, the trim, and each instruction of the
    equations. The instructions include the numbers that the model reads from other files.

    model: the model
    sources: hash of the source files
    """
    vectors = model.layout.symbols(*VECTORS)
    *given, w = vectors
    f, y = model.layout.expressions(given, tuple(model.outputs), w)
    function = ca.Function("f", vectors, [f, y])
    digest = hashlib.sha256(f"{sources} {instructions(function)}".encode())
    for kind in (*VECTORS.values(), "outputs", "trim"):
        digest.update(repr(getattr(model, kind)).encode())
    return digest.hexdigest()


def hash_of_sources(file: Path, package: str) -> str:
    """Return the SHA-256 hash of an executed Python file and of the local modules that it imports.

    Local modules are below the folder of the file, or of its outermost package, and do not belong
    to an installed package. Modules that local modules import are included.

    file: the executed file
    package: package of the file, for relative imports
    """
    outer_packages = package.count(".")
    folder = file.resolve().parents[outer_packages]
    sources = _local_sources(file.resolve(), package, folder)
    # The hash of a single file is that of its content, which other programs compute, too.
    if len(sources) == 1:
        return hashlib.sha256(sources[file.resolve()]).hexdigest()
    digest = hashlib.sha256()
    for path in sorted(sources):
        digest.update(path.relative_to(folder).as_posix().encode() + b"\0")
        digest.update(hashlib.sha256(sources[path]).digest())
    return digest.hexdigest()


def _local_sources(file: Path, package: str, folder: Path) -> dict[Path, bytes]:
    """Return path -> content of a Python file of a package and of all local files it imports."""
    sources: dict[Path, bytes] = {}
    package_of_unread = {file: package}
    while package_of_unread:
        path, its_package = package_of_unread.popitem()
        sources[path] = path.read_bytes()
        for name in _imported_names(sources[path], its_package):
            imported = local_file(name, folder)
            if imported is not None and imported not in sources:
                package_of_unread[imported] = getattr(sys.modules[name], "__package__", "") or ""
    return sources


def local_file(name: str, folder: Path) -> Path | None:
    """Return the Python file of a loaded module below a folder, or None for other modules.

    Modules of this project and of installed packages are not local.

    name: name of the module
    """
    origin = getattr(sys.modules.get(name), "__file__", None)
    if name.split(".")[0] in OWN_PACKAGES or not origin or not origin.endswith(".py"):
        return None
    path = Path(origin).resolve()
    is_installed = "site-packages" in path.parts or path.is_relative_to(_EXTENSIONS)
    return path if path.is_relative_to(folder) and not is_installed else None


def _imported_names(text: bytes, package: str) -> set[str]:
    """Return the names of all modules that the import statements in a file may refer to."""
    # The packages that contain the modules are included.
    names: set[str] = set()
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.Import):
            names.update(alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            module = resolve_name("." * node.level + (node.module or ""), package)
            names.add(module)
            names.update(f"{module}.{alias.name}" for alias in node.names)
    parents = {
        name.rsplit(".", count)[0] for name in names for count in range(1, name.count(".") + 1)
    }
    return names | parents


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
        models = {key: value for key, value in vars(module).items() if isinstance(value, Model)}
        only_model = next(iter(models.values())) if len(models) == 1 else None
        model = getattr(module, name, None) if name else only_model
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
        if not name:
            names = " or :".join(models) or "NAME"
            raise BadInputError(
                f"{where}: no name of a model is given; give {module.__file__}:{names}"
            )
        what = "does not exist" if model is None else f"is {shown(model)}, not a Model"
        advice = f"use {', '.join(models)}" if models else "define a Model"
        raise BadInputError(f"{where}: {name} {what}; {advice}")
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
