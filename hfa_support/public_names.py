"""Public names of a package, each imported when it is first used."""

from __future__ import annotations

import ast
import difflib
from collections.abc import Callable
from functools import cache
from importlib import import_module
from pathlib import Path
from typing import Any


def public_names(package: str, file: str) -> tuple[Callable[[str], Any], Callable[[], list[str]]]:
    """`__getattr__` and `__dir__` of a package whose stub imports its public names.

    The stub is the file `__init__.pyi` beside `file`. An unknown name is answered with the nearest
    public one.
    """

    @cache
    def modules() -> dict[str, str]:
        """Public name -> the module that defines it."""
        stub = ast.parse(Path(file).with_suffix(".pyi").read_text("utf-8"))
        modules = {}
        for statement in stub.body:
            if isinstance(statement, ast.ImportFrom):
                for alias in statement.names:
                    modules[alias.name] = "." * statement.level + str(statement.module)
        return modules

    def get(name: str) -> Any:
        """A public name."""
        if name == "__all__":
            return list(modules())
        if name not in modules():
            near = difflib.get_close_matches(name, modules(), n=1)
            advice = f"; did you mean {near[0]}?" if near else ""
            raise AttributeError(f"module {package!r} has no attribute {name!r}{advice}")
        return getattr(import_module(modules()[name], package), name)

    return get, lambda: list(modules())
