"""Circular imports between modules, including imports inside functions."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from project import FOLDERS
from scipy.sparse.csgraph import connected_components

#: Groups of modules that import each other in functions or for type checkers: an expansion with its radius and report, and pairs of a value and its report or
#: figure. The modules of a pair are in one folder.
ALLOWED = [
    {"hfa_flight.simulate.flight", "hfa_flight.simulate.flight_report"},
    {
        "hfa_flight.policies.filtered_policy",
        "hfa_flight.policies.given",
        "hfa_flight.policies.kalman",
    },
]


def modules() -> dict[str, Path]:
    """Return dotted name -> file for all modules of the core and the extensions."""
    found = {}
    for folder in FOLDERS.values():
        for path in folder.rglob("*.py"):
            parts = path.relative_to(folder.parent).with_suffix("").parts
            found[".".join(parts).removesuffix(".__init__")] = path
    return found


def imports_of(node: ast.AST, *, is_later: bool = False) -> Iterator[tuple[str, bool]]:
    """Yield (imported name, whether it is imported in a function or for type checkers)."""
    for child in ast.iter_child_nodes(node):
        if isinstance(child, ast.ImportFrom):
            yield from ((f"{child.module}.{alias.name}", is_later) for alias in child.names)
            yield str(child.module), is_later
        elif isinstance(child, ast.Import):
            yield from ((alias.name, is_later) for alias in child.names)
        elif isinstance(child, ast.stmt | ast.ExceptHandler):
            later = isinstance(child, ast.FunctionDef) or (
                isinstance(child, ast.If) and is_for_checkers(child.test)
            )
            yield from imports_of(child, is_later=is_later or later)


def is_for_checkers(test: ast.expr) -> bool:
    return isinstance(test, ast.Name) and test.id == "TYPE_CHECKING"


def graphs(sources: dict[str, str]) -> tuple[list[set[str]], list[set[str]]]:
    """Return the circles of the imports when modules are loaded, and of all imports.

    sources: dotted name -> text
    """
    names = list(sources)
    place = {name: number for number, name in enumerate(names)}
    graph = np.zeros((2, len(names), len(names)), dtype=bool)
    for name, source in sources.items():
        for imported, is_later in imports_of(ast.parse(source)):
            if imported in place:
                graph[int(is_later) :, place[name], place[imported]] = True
    return circles(graph[0], names), circles(graph.any(axis=0), names)


def circles(graph: np.ndarray, names: list[str]) -> list[set[str]]:
    """Return the groups of modules that import each other, directly or indirectly."""
    count, labels = connected_components(graph, directed=True, connection="strong")
    groups: list[set[str]] = [set() for _ in range(count)]
    for name, label in zip(names, labels, strict=True):
        groups[label].add(name)
    return [group for group in groups if len(group) > 1]


@pytest.mark.slow
def test_no_modules_import_each_other() -> None:
    """No modules import each other when they are loaded, and only `ALLOWED` do otherwise."""
    sources = {name: path.read_text("utf-8") for name, path in modules().items()}
    assert {"trim.point.operating_point", "hfa_prove.check.schedule"} <= set(sources)
    loaded, found = graphs(sources)
    assert loaded == []
    assert [group for group in found if group not in ALLOWED] == []
    assert [group for group in ALLOWED if group not in found] == [], "allowed, but not needed"
