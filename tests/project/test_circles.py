"""Circular imports between modules, including imports inside functions."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from project import FOLDERS
from scipy.sparse.csgraph import connected_components

#: Largest number of groups with circular imports. Lower it when one is removed, and do not raise
#: it.
CIRCLES = 2


def modules() -> dict[str, Path]:
    """Return dotted name -> file for all modules of the core and the extensions."""
    found = {}
    for folder in FOLDERS.values():
        for path in folder.rglob("*.py"):
            parts = path.relative_to(folder.parent).with_suffix("").parts
            found[".".join(parts).removesuffix(".__init__")] = path
    return found


def imports_of(node: ast.AST, *, lazy: bool) -> Iterator[str]:
    """Yield the names imported by the code of a syntax node, without imports under TYPE_CHECKING.

    lazy: whether imports inside functions are included
    """
    for child in ast.iter_child_nodes(node):
        if isinstance(child, ast.expr):
            continue
        if isinstance(child, ast.If) and is_for_checkers(child.test):
            continue
        if isinstance(child, ast.FunctionDef) and not lazy:
            continue
        if isinstance(child, ast.ImportFrom):
            yield from (f"{child.module}.{alias.name}" for alias in child.names)
            yield str(child.module)
        elif isinstance(child, ast.Import):
            yield from (alias.name for alias in child.names)
        yield from imports_of(child, lazy=lazy)


def is_for_checkers(test: ast.expr) -> bool:
    return isinstance(test, ast.Name) and test.id == "TYPE_CHECKING"


def circles(trees: dict[str, ast.Module], *, lazy: bool) -> list[set[str]]:
    """Return the groups of modules that import each other, directly or indirectly.

    trees: dotted name -> syntax tree
    lazy: whether imports inside functions are included
    """
    names = list(trees)
    place = {name: number for number, name in enumerate(names)}
    graph = np.zeros((len(names), len(names)), dtype=bool)
    for name, tree in trees.items():
        for imported in imports_of(tree, lazy=lazy):
            if imported in place:
                graph[place[name], place[imported]] = True
    count, labels = connected_components(graph, directed=True, connection="strong")
    groups: list[set[str]] = [set() for _ in range(count)]
    for name, label in zip(names, labels, strict=True):
        groups[label].add(name)
    return [group for group in groups if len(group) > 1]


def test_no_modules_import_each_other() -> None:
    """No modules import each other when they are loaded.

    With imports inside functions, there are at most `CIRCLES` groups.
    """
    trees = {name: ast.parse(path.read_text("utf-8")) for name, path in modules().items()}
    assert len(trees) > 400
    assert circles(trees, lazy=False) == []
    assert len(circles(trees, lazy=True)) <= CIRCLES


def test_a_planted_circular_import_is_detected() -> None:
    """A planted circular import with one import inside a function is found.

    Imports under TYPE_CHECKING are not counted.
    """
    sources = {
        "p.a": "from p import b\n",
        "p.b": "def f():\n    from p.c import value\n",
        "p.c": "import p.a\n",
        "p.d": "if TYPE_CHECKING:\n    import p.e\n",
        "p.e": "import p.d\n",
    }
    trees = {name: ast.parse(source) for name, source in sources.items()}
    assert circles(trees, lazy=False) == []
    assert circles(trees, lazy=True) == [{"p.a", "p.b", "p.c"}]
