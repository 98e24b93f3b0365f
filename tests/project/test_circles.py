"""Circular imports between modules, including imports inside functions."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from project import FOLDERS
from scipy.sparse.csgraph import connected_components

#: Groups of modules that import each other in functions or for type checkers: the values of a trim,
#: an expansion with its radius and report, and pairs of a value and its report or figure. The
#: modules of a pair are in one folder.
ALLOWED = [
    {
        "trim.linear.linear_model",
        "trim.point.linearize",
        "trim.point.operating_point",
        "trim.point.trim_report",
    },
    {
        "controller.expansion.expansion",
        "controller.expansion.expansion_report",
        "controller.expansion.flights",
        "controller.expansion.radius",
    },
    {"verification.figures", "verification.verdict"},
    {"controller.riccati.gare", "controller.riccati.solution_report"},
    {"hfa_flight.flight", "hfa_flight.flight_report"},
]


def modules() -> dict[str, Path]:
    """Return dotted name -> file for all modules of the core and the extensions."""
    found = {}
    for folder in FOLDERS.values():
        for path in folder.rglob("*.py"):
            parts = path.relative_to(folder.parent).with_suffix("").parts
            found[".".join(parts).removesuffix(".__init__")] = path
    return found


def imports_of(node: ast.AST, *, every: bool) -> Iterator[str]:
    """Yield the names imported by the code of a syntax node.

    every: whether imports inside functions and under TYPE_CHECKING are included
    """
    for child in ast.iter_child_nodes(node):
        if isinstance(child, ast.expr):
            continue
        is_later = isinstance(child, ast.FunctionDef | ast.AsyncFunctionDef)
        if isinstance(child, ast.If) and is_for_checkers(child.test):
            is_later = True
        if is_later and not every:
            continue
        if isinstance(child, ast.ImportFrom):
            yield from (f"{child.module}.{alias.name}" for alias in child.names)
            yield str(child.module)
        elif isinstance(child, ast.Import):
            yield from (alias.name for alias in child.names)
        yield from imports_of(child, every=every)


def is_for_checkers(test: ast.expr) -> bool:
    return isinstance(test, ast.Name) and test.id == "TYPE_CHECKING"


def circles(trees: dict[str, ast.Module], *, every: bool) -> list[set[str]]:
    """Return the groups of modules that import each other, directly or indirectly.

    trees: dotted name -> syntax tree
    every: whether imports inside functions and under TYPE_CHECKING are included
    """
    names = list(trees)
    place = {name: number for number, name in enumerate(names)}
    graph = np.zeros((len(names), len(names)), dtype=bool)
    for name, tree in trees.items():
        for imported in imports_of(tree, every=every):
            if imported in place:
                graph[place[name], place[imported]] = True
    count, labels = connected_components(graph, directed=True, connection="strong")
    groups: list[set[str]] = [set() for _ in range(count)]
    for name, label in zip(names, labels, strict=True):
        groups[label].add(name)
    return [group for group in groups if len(group) > 1]


def test_no_modules_import_each_other() -> None:
    """No modules import each other when they are loaded, and only `ALLOWED` do otherwise."""
    trees = {name: ast.parse(path.read_text("utf-8")) for name, path in modules().items()}
    assert {"trim.point.operating_point", "hfa_prove.check.loop"} <= set(trees)
    assert circles(trees, every=False) == []
    found = circles(trees, every=True)
    assert [group for group in found if group not in ALLOWED] == []
    assert [group for group in ALLOWED if group not in found] == [], "allowed, but not needed"


def test_a_planted_circular_import_is_detected() -> None:
    """Planted circular imports are found: in a function, and for type checkers."""
    sources = {
        "p.a": "from p import b\n",
        "p.b": "def f():\n    from p.c import value\n",
        "p.c": "import p.a\n",
        "p.d": "if TYPE_CHECKING:\n    import p.e\n",
        "p.e": "import p.d\n",
        "p.f": "import p.d\n",
    }
    trees = {name: ast.parse(source) for name, source in sources.items()}
    assert circles(trees, every=False) == []
    assert circles(trees, every=True) == [{"p.a", "p.b", "p.c"}, {"p.d", "p.e"}]
    loaded = {"p.g": ast.parse("import p.h\n"), "p.h": ast.parse("from p import g\n")}
    assert circles(loaded, every=False) == [{"p.g", "p.h"}]
