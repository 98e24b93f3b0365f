"""The import contracts in pyproject.toml detect violations."""

import re
from graphlib import CycleError, TopologicalSorter

import pytest
from project import FOLDERS, ROOT, SETTINGS

CONTRACTS = SETTINGS["importlinter"]["contracts"]
#: Begin of a contract's name -> an import that it forbids: the module, and what it must not import.
BREACHES = {
    "Packages import only those below": ("hfa.options.command", "hfa.commands.trim"),
    "The core imports no extension": ("verification.box", "hfa_prove.certificate"),
    "Nothing imports the readers": ("hfa_flight.air.scenario", "hfa_jsbsim.reader"),
    "Results reach": ("trim.reports.figures", "trim"),
    "What learns never imports": ("controller.learning.recording", "controller.riccati.gare"),
    "What judges critics": ("verification.reasons", "hfa_flight.air.scenario"),
    "Only commands reach what learns": ("hfa_prove.report", "hfa.learning"),
    "Checkers and statements": ("hfa_prove.check.trims", "hfa_prove.search.schedule"),
    "Only these import the flexible aircraft": ("hfa_support.errors", "hfa_model.parameters"),
}


@pytest.mark.slow
def test_planted_forbidden_imports_are_detected(monkeypatch, capsys):
    """The linter reports each import of `BREACHES`, of each kind of contract, under its contract."""
    pytest.importorskip("importlinter")
    from importlinter import cli
    from importlinter.application import use_cases

    build = use_cases._build_graph

    def planted(*words, **named):
        graph = build(*words, **named)
        for importer, imported in BREACHES.values():
            graph.add_import(importer=importer, imported=imported)
        return graph

    monkeypatch.setattr(use_cases, "_build_graph", planted)
    monkeypatch.chdir(ROOT)
    assert cli.lint_imports(no_cache=True) != 0
    texts = capsys.readouterr().out.partition("Broken contracts")[2]
    heads = re.split(r"\n([^\n]+)\n-{3,}\n", texts)
    found = dict(zip(heads[1::2], heads[2::2], strict=True))
    kinds = set()
    for begin, breach in BREACHES.items():
        (contract,) = (each for each in CONTRACTS if each["name"].startswith(begin))
        kinds.add(contract["type"])
        assert " -> ".join(breach) in found[contract["name"]]
    assert kinds == {each["type"] for each in CONTRACTS}


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
