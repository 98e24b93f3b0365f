"""Hash of a model's source files, including imported local modules, and fingerprint of a model."""

from __future__ import annotations

import ast
import hashlib
import sys
from pathlib import Path
from typing import TYPE_CHECKING

import casadi as ca

from hfa_aircraft.layout import components
from hfa_aircraft.signals import VECTORS

if TYPE_CHECKING:
    from hfa_aircraft.model import Model

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
    *given, w = map(components, vectors)
    f, y = model.layout.expressions(given, tuple(model.outputs), w)
    function = ca.Function("f", vectors, [f, y])
    digest = hashlib.sha256(sources.encode())
    for kind in (*VECTORS.values(), "outputs", "trim"):
        digest.update(repr(getattr(model, kind)).encode())
    for number in range(function.n_instructions()):
        operation = function.instruction_id(number)
        parts = [operation, function.instruction_input(number), function.instruction_output(number)]
        if operation == ca.OP_CONST:
            parts.append(function.instruction_constant(number))
        if operation == ca.OP_CALL:  # the instructions of the called function are not accessible
            return hashlib.sha256(digest.digest() + function.serialize().encode()).hexdigest()
        digest.update(repr(parts).encode())
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
    """Return the names of all modules that the import statements in a file may refer to.

    The packages that contain the modules are included.
    """
    names: set[str] = set()
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.Import):
            names.update(alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            module = node.module or ""
            if node.level:  # 1 is the package itself, 2 its parent
                parts = package.split(".")
                outer = parts[: len(parts) - node.level + 1]
                module = ".".join([*outer, module] if module else outer)
            names.add(module)
            names.update(f"{module}.{alias.name}" for alias in node.names)
    parents = {
        name.rsplit(".", count)[0] for name in names for count in range(1, name.count(".") + 1)
    }
    return names | parents
