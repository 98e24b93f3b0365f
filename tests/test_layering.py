"""The one-way street of ARCHITECTURE.md, held by reading every import."""

from __future__ import annotations

import ast
from collections.abc import Mapping
from graphlib import CycleError, TopologicalSorter

import pytest
from import_graph import LAYERS, imports_of, project_sources, reachable

#: What the exact solution may share with the learner: values and files, no algorithm.
SHARED_WITH_THE_LEARNER = {"controller.game", "controller.model_file", "controller.result", "controller.basis"}
#: What the judge of critics may share besides: how a result is written to a file.
SHARED_WITH_THE_JUDGE = SHARED_WITH_THE_LEARNER | {"controller.files"}


def upward_imports(sources: Mapping[str, str]) -> list[str]:
    """Imports of a package from a package below it."""
    height = {package: index for index, package in enumerate(LAYERS)}
    return [
        f"{module} imports {name}"
        for module in sources
        for name in sorted(imports_of(module, sources))
        if height[name.split(".")[0]] > height[module.split(".")[0]]
    ]


def learner_code_in(start: str, shared: set[str], sources: Mapping[str, str]) -> list[str]:
    """Modules of the controller that the modules whose names begin with `start` reach and must not."""
    roots = [module for module in sources if module.startswith(start)]
    assert roots, f"{start} has moved: correct this test"
    return [
        f"{root} reaches {name}"
        for root in roots
        for name in sorted(reachable(root, sources))
        if name.startswith("controller") and name not in shared
    ]


def import_cycle(sources: Mapping[str, str]) -> list[str]:
    """Modules that need each other to be imported; empty when there are none."""
    graph = {module: imports_of(module, sources, at_start_only=True) - {module} for module in sources}
    try:
        TopologicalSorter(graph).prepare()
    except CycleError as error:
        return list(error.args[1])
    return []


def test_every_package_is_read() -> None:
    sources = project_sources()
    assert {name.split(".")[0] for name in sources} == set(LAYERS)
    assert imports_of("trim.solve", sources) >= {"hfa_model.compiled", "trim.condition"}


def test_imports_go_one_way() -> None:
    assert upward_imports(project_sources()) == []


def test_only_the_command_imports_the_judge() -> None:
    sources = project_sources()
    importers = {
        module.split(".")[0]
        for module in sources
        if any(name.split(".")[0] == "verification" for name in imports_of(module, sources))
    }
    assert importers <= {"verification", "hfa_cli"}


def test_the_exact_solution_shares_no_code_with_the_learner() -> None:
    assert learner_code_in("verification.gare", SHARED_WITH_THE_LEARNER, project_sources()) == []


def test_the_judge_of_critics_shares_values_and_files_with_the_learner() -> None:
    assert learner_code_in("verification.critic_check", SHARED_WITH_THE_JUDGE, project_sources()) == []


def test_the_judge_asks_a_run_for_its_weights_and_the_rank_of_its_data_alone() -> None:
    tree = ast.parse(project_sources()["verification.critic_check"])
    asked = {
        node.attr
        for node in ast.walk(tree)
        if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name) and node.value.id == "run"
    }
    assert asked == {"law", "times", "weights", "excitation"}


def test_no_module_needs_itself_to_be_imported() -> None:
    assert import_cycle(project_sources()) == []


@pytest.mark.parametrize(
    "line",
    [
        "import verification.gare",
        "from verification import gare",
        "from verification.gare import x",
        "def f():\n    from verification.gare import x",
        "if True:\n    import verification.gare as judge",
        "from typing import TYPE_CHECKING\nif TYPE_CHECKING:\n    from verification.gare import x",
    ],
)
def test_a_planted_upward_import_is_seen(line: str) -> None:
    sources = {"verification.gare": "", "verification": "", "controller.game": line, "controller": ""}
    assert len(upward_imports(sources)) == 1
    assert upward_imports(sources)[0].startswith("controller.game imports verification")


def test_a_planted_use_of_the_learner_is_seen() -> None:
    sources = {
        "verification": "",
        "verification.gare": "from verification.helper import f",
        "verification.helper": "def f():\n    from controller import ramp",
        "controller": "",
        "controller.ramp": "",
        "controller.game": "",
    }
    assert learner_code_in("verification.gare", SHARED_WITH_THE_LEARNER, sources) == [
        "verification.gare reaches controller.ramp"
    ]
    innocent = sources | {"verification.helper": "from controller.game import Game"}
    assert learner_code_in("verification.gare", SHARED_WITH_THE_LEARNER, innocent) == []


def test_a_planted_cycle_is_seen() -> None:
    cycle = {"trim": "", "trim.a": "from trim.b import x", "trim.b": "from . import c", "trim.c": "import trim.a"}
    assert set(import_cycle(cycle)) == {"trim.a", "trim.b", "trim.c"}
    late = cycle | {"trim.c": "def f():\n    import trim.a"}
    assert import_cycle(late) == []
