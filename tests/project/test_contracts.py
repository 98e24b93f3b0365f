"""The modules of the project import one another in an order."""

from graphlib import CycleError, TopologicalSorter

import pytest
from project import FOLDERS


def lowest_first(graph):
    """Return the modules of a graph of imports, each after those that it imports."""
    imported = {module: graph.find_modules_directly_imported_by(module) for module in graph.modules}
    return [*TopologicalSorter(imported).static_order()]


def test_no_modules_import_each_other():
    """The imports of all modules form no circle, also with those in functions and for type
    checkers: an order exists in which each module follows those that it imports. With a planted
    import of a module that imports the importer, none exists.
    """
    graph = pytest.importorskip("grimp").build_graph(*FOLDERS, cache_dir=None)
    order = lowest_first(graph)
    assert order.index("hfa_support.errors") < order.index("hfa_prove.check.schedule")
    filtered, kalman = "hfa_flight.policies.filtered_policy", "hfa_flight.policies.kalman"
    graph.add_import(importer=kalman, imported=filtered)  # the reverse import exists
    with pytest.raises(CycleError, match=filtered):
        lowest_first(graph)
