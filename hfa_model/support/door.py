"""A package's front door: its names are listed once and imported when they are first used."""

from __future__ import annotations

import ast
import functools
import importlib
import importlib.util
import os
import sys
import warnings
from collections.abc import Callable
from types import FunctionType
from typing import Any

from hfa_model.support.arguments import DOORS, explained, explained_class

#: From the bottom to the top: each needs those before it.
PACKAGES = ("hfa_model", "trim", "controller", "verification", "hfa_cli")


def open_door(package: str) -> tuple[Callable[[str], Any], Callable[[], list[str]], list[str]]:
    """`__getattr__`, `__dir__` and `__all__` of a package, from the imports in its `if TYPE_CHECKING:` block.

    Type checkers read that block as it stands; at run time a name loads its module only when somebody asks for it,
    because CasADi and SciPy are slow to load and `hfa --help` needs neither.
    """
    check_hidden()
    homes = DOORS[package] = _homes(package)
    names = sorted(homes)

    @functools.cache
    def look_up(name: str) -> Any:
        if name not in homes:
            raise AttributeError(f"module {package!r} has no attribute {name!r}; it offers {', '.join(names)}")
        found = getattr(importlib.import_module(homes[name]), name)
        if isinstance(found, type):
            explained_class(found)
        elif isinstance(found, FunctionType) and not hasattr(found, "__wrapped__"):
            found = explained(name, found)
            found.__module__ = package  # where it is found again when it is pickled
            made = found.__annotations__.get("return")
            if made in homes:
                look_up(made)  # what it makes checks what it is made of
        return found

    def list_names() -> list[str]:
        return names

    return look_up, list_names, names


def check_hidden() -> None:
    """Says which file or folder of the user, such as a `trim.py` beside the script, Python takes for a package of ours.

    ImportError when a package that is loaded needs the hidden one; a warning when none does, because the name may well
    be meant.
    """
    hidden = {name: path for name in PACKAGES if (path := _path_before(name))}
    loaded = [level for level, name in enumerate(PACKAGES) if name in sys.modules and name not in hidden]
    for name, path in hidden.items():
        message = f"{path} hides the package {name!r} of hfa-toolchain: rename it, or run Python with the option -P"
        if loaded and PACKAGES.index(name) < loaded[-1]:
            raise ImportError(message, name=name, path=path)
        warnings.warn(message, stacklevel=4)


def _path_before(name: str) -> str | None:
    """What Python finds in place of a package of ours."""
    spec = sys.modules[name].__spec__ if name in sys.modules else importlib.util.find_spec(name)
    if spec is None:
        return None
    ours = os.path.join(os.path.dirname(__file__), "..", "..", name, "__init__.py")
    found = spec.origin or next(iter(spec.submodule_search_locations or ()), "")  # a folder has no origin
    return None if os.path.realpath(found) == os.path.realpath(ours) else found


def _homes(package: str) -> dict[str, str]:
    """Name -> module, as the package's own source says."""
    spec = importlib.util.find_spec(package)
    source = spec.loader.get_source(package)  # type: ignore[union-attr]
    found = {}
    for node in ast.parse(source).body:
        if isinstance(node, ast.If) and ast.unparse(node.test) == "TYPE_CHECKING":
            for line in node.body:
                assert isinstance(line, ast.ImportFrom)
                assert line.module is not None
                found.update({alias.name: line.module for alias in line.names})
    return found
