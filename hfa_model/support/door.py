"""A package's front door: its names are listed once and imported when they are first used."""

from __future__ import annotations

import ast
import importlib
import importlib.util
from collections.abc import Callable
from typing import Any


def open_door(package: str) -> tuple[Callable[[str], Any], Callable[[], list[str]], list[str]]:
    """`__getattr__`, `__dir__` and `__all__` of a package, from the imports in its `if TYPE_CHECKING:` block.

    Type checkers read that block as it stands; at run time a name loads its module only when somebody asks for it,
    because CasADi and SciPy are slow to load and `hfa --help` needs neither.
    """
    homes = _homes(package)
    names = sorted(homes)

    def look_up(name: str) -> Any:
        if name not in homes:
            raise AttributeError(f"module {package!r} has no attribute {name!r}; it offers {', '.join(names)}")
        return getattr(importlib.import_module(homes[name]), name)

    def list_names() -> list[str]:
        return names

    return look_up, list_names, names


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
