"""Circular imports between modules, including imports inside functions."""

import ast

import numpy as np
import pytest
from project import FOLDERS
from scipy.sparse.csgraph import connected_components


def modules():
    """Return dotted name -> file for all modules of the core and the extensions."""
    found = {}
    for folder in FOLDERS.values():
        for path in folder.rglob("*.py"):
            parts = path.relative_to(folder.parent).with_suffix("").parts
            found[".".join(parts).removesuffix(".__init__")] = path
    return found


def imports_of(source):
    """Yield the name of each import, also of those in functions and for type checkers."""
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.ImportFrom):
            yield from (f"{node.module}.{alias.name}" for alias in node.names)
            yield str(node.module)
        elif isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)


def circles(sources):
    """Return the groups of modules that import each other, directly or indirectly.

    sources: dotted name -> text
    """
    names = list(sources)
    graph = np.zeros((len(names), len(names)), dtype=bool)
    for place, source in enumerate(sources.values()):
        for imported in imports_of(source):
            if imported in sources:
                graph[place, names.index(imported)] = True
    count, labels = connected_components(graph, directed=True, connection="strong")
    groups = [set() for _ in range(count)]
    for name, label in zip(names, labels, strict=True):
        groups[label].add(name)
    return [group for group in groups if len(group) > 1]


@pytest.mark.slow
def test_no_modules_import_each_other():
    """No modules import each other, even in functions or for type checkers."""
    sources = {name: path.read_text("utf-8") for name, path in modules().items()}
    assert {"trim.point.operating_point", "hfa_prove.check.schedule"} <= set(sources)
    assert circles(sources) == []
    kalman, filtered = "hfa_flight.policies.kalman", "hfa_flight.policies.filtered_policy"
    planted = sources[kalman] + f"def f():\n    from {filtered} import FilteredPolicy\n"
    (circle,) = circles(sources | {kalman: planted})
    assert {kalman, filtered} <= circle
