"""Trims, exact linear models and games of aircraft, and critics checked against the exact solution.

The names that a user's script needs stand in the stub beside this file; each is imported when it is
first used."""

import ast
from functools import cache
from importlib import import_module
from pathlib import Path
from typing import Any


@cache
def _modules() -> dict[str, str]:
    """Public name -> the module that defines it, as the stub imports it."""
    stub = ast.parse(Path(__file__).with_suffix(".pyi").read_text("utf-8"))
    imports = [statement for statement in stub.body if isinstance(statement, ast.ImportFrom)]
    return {alias.name: str(statement.module) for statement in imports for alias in statement.names}


def __getattr__(name: str) -> Any:
    """A public name."""
    if name == "__all__":
        return list(_modules())
    if name not in _modules():
        raise AttributeError(
            f"module 'hfa' has no attribute {name!r}; its names: {', '.join(_modules())}"
        )
    return getattr(import_module(_modules()[name]), name)


def __dir__() -> list[str]:
    """The public names."""
    return list(_modules())
