"""Who imports whom among the project's modules, read from the source without running it."""

from __future__ import annotations

import ast
from collections.abc import Mapping
from functools import cache
from pathlib import Path

ROOT = Path(__file__).parents[2]
#: From the bottom to the top: a package may import itself and those before it.
LAYERS = ("hfa_support", "hfa_model", "trim", "controller", "verification", "hfa_cli")


def project_sources() -> dict[str, str]:
    """Module name -> source, of every module in the packages."""
    found = {}
    for package in LAYERS:
        for path in sorted((ROOT / package).rglob("*.py")):
            parts = path.relative_to(ROOT).with_suffix("").parts
            name = ".".join(parts[:-1] if parts[-1] == "__init__" else parts)
            found[name] = path.read_text(encoding="utf-8")
    return found


@cache
def tree_of(source: str) -> ast.Module:
    """The syntax tree of a source, which several tests look at and none changes."""
    return ast.parse(source)


@cache
def nodes_of(source: str) -> tuple[ast.AST, ...]:
    """Every node of the tree."""
    return tuple(ast.walk(tree_of(source)))


def imports_of(module: str, sources: Mapping[str, str]) -> set[str]:
    """Modules of `sources` that a module imports anywhere in its text.

    A name imported from a package is the submodule of that name where there is one, else the package itself.
    """
    base = module.split(".") if _is_package(module, sources) else module.split(".")[:-1]
    found = set()
    for node in _imports_in(sources[module]):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        else:
            above = base[: len(base) - node.level + 1] if node.level else []
            origin = ".".join([*above, *([node.module] if node.module else [])])
            names = {f"{origin}.{alias.name}" for alias in node.names}
            found |= {name if name in sources else origin for name in names}
    tops = {each.partition(".")[0] for each in sources}
    return {name for name in found if name.partition(".")[0] in tops}


@cache
def _imports_in(source: str) -> tuple[ast.Import | ast.ImportFrom, ...]:
    return tuple(node for node in nodes_of(source) if isinstance(node, (ast.Import, ast.ImportFrom)))


def room_of(module: str, sources: Mapping[str, str]) -> str:
    """The folder that a module lies in, dotted; a package is its own room."""
    return module if _is_package(module, sources) or "." not in module else module.rpartition(".")[0]


def _is_package(module: str, sources: Mapping[str, str]) -> bool:
    return module in _packages(frozenset(sources))


@cache
def _packages(modules: frozenset[str]) -> frozenset[str]:
    parts = (module.split(".") for module in modules)
    return frozenset(".".join(each[:end]) for each in parts for end in range(1, len(each)))


def reachable(start: str, sources: Mapping[str, str]) -> set[str]:
    """A module and everything of the project that it uses, directly or not."""
    found, waiting = {start}, [start]
    while waiting:
        for name in imports_of(waiting.pop(), sources) - found:
            found.add(name)
            if name in sources:
                waiting.append(name)
    return found
