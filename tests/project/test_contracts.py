"""The import contracts in pyproject.toml cover every package and detect violations."""

import os
import re
import shutil
import subprocess
import sys
from graphlib import CycleError, TopologicalSorter
from itertools import cycle
from pathlib import Path

import pytest
from project import FOLDERS, ROOT, SETTINGS

CONTRACTS = SETTINGS["importlinter"]["contracts"]
#: Extensions, for the paths below.
FLIGHT = "extensions/flight/hfa_flight"
PROVE = "extensions/prove/hfa_prove"
#: Begin of a contract's name -> imports that it forbids: file -> the module that it must not
#: import.
BREACHES = {
    "Packages import only those below": {"hfa/options/command.py": "hfa.commands.trim"},
    "The core imports no extension": {"verification/box.py": "hfa_prove.certificate"},
    "Nothing imports the readers": {f"{FLIGHT}/air/scenario.py": "hfa_jsbsim.reader"},
    "Results reach": {"trim/reports/figures.py": "trim"},
    "What learns never imports": {"controller/learning/recording.py": "controller.riccati.gare"},
    "What judges critics": {"verification/reasons.py": "hfa_flight.air.scenario"},
    "Only commands reach what learns": {f"{PROVE}/report.py": "hfa.learning"},
    "Checkers and statements": {f"{PROVE}/check/trims.py": "hfa_prove.search.schedule"},
    "Only these import the flexible aircraft": {"hfa_support/errors.py": "hfa_model.parameters"},
}
#: Places of an import: when the module is loaded, in a function, for type checkers.
PLACES = (
    "\nimport {}\n",
    "\ndef planted():\n    import {}\n",
    "\nfrom typing import TYPE_CHECKING\nif TYPE_CHECKING:\n    import {}\n",
)


def contract(begin):
    """Return the contract whose name begins with this text."""
    (found,) = (each for each in CONTRACTS if each["name"].startswith(begin))
    return found


def complaints(output):
    """Return name -> text of each broken contract in the linter's output."""
    texts = output.partition("Broken contracts")[2]
    heads = re.split(r"\n([^\n]+)\n-{3,}\n", texts)
    return dict(zip(heads[1::2], heads[2::2], strict=True))


@pytest.mark.slow
def test_planted_forbidden_imports_are_detected(tmp_path):
    """In a copy of the project, the imports of `BREACHES` are planted, of each kind of contract; the
    linter reports each under its contract.
    """
    kinds = {contract(begin)["type"] for begin in BREACHES}
    assert kinds == {each["type"] for each in CONTRACTS}
    pytest.importorskip("importlinter")

    # The copy, with the planted imports.
    for folder in (*FOLDERS.values(), ROOT / "studies"):
        target = tmp_path / folder.relative_to(ROOT)
        shutil.copytree(folder, target, ignore=shutil.ignore_patterns("__pycache__", "*.json"))
    shutil.copy(ROOT / "pyproject.toml", tmp_path)
    shutil.copytree(ROOT / "tools", tmp_path / "tools")
    planted = [
        (begin, file, imported)
        for begin, breaches in BREACHES.items()
        for file, imported in breaches.items()
    ]
    for (_, file, imported), place in zip(planted, cycle(PLACES), strict=False):
        with (tmp_path / file).open("a", encoding="utf-8") as source:
            source.write(place.format(imported))

    # The run of the linter.
    roots = [tmp_path, *sorted((tmp_path / "extensions").iterdir())]
    done = subprocess.run(
        [Path(sys.executable).with_name("lint-imports"), "--no-cache"],
        cwd=tmp_path,
        env={**os.environ, "PYTHONPATH": os.pathsep.join(map(str, roots)), "COLUMNS": "300"},
        capture_output=True,
        text=True,
        timeout=120,
    )
    assert done.returncode == 1

    # The report: "importer -> imported" as module names.
    found = complaints(done.stdout)
    for begin, file, imported in planted:
        parts = Path(file).with_suffix("").parts
        # extensions/flight/hfa_flight/... is the module hfa_flight....
        importer = ".".join(parts[2:] if parts[0] == "extensions" else parts)
        importer = importer.removesuffix(".__init__")
        text = found.get(contract(begin)["name"], "")
        assert f"{importer} -> {imported} " in text, f"{begin} {importer} imports {imported}"


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
