"""The one-way street of ARCHITECTURE.md, held by reading every import, and the same tree of the tests."""

from __future__ import annotations

import ast
from collections.abc import Iterable, Mapping
from graphlib import CycleError, TopologicalSorter
from pathlib import PurePath

import pytest
from import_graph import LAYERS, ROOMS, ROOT, imports_of, project_sources, reachable, room_of

#: What the judge may share with the learner: values and files, no algorithm.
SHARED_WITH_THE_LEARNER = "controller.game"
#: What re-verifies certificates: it reaches itself and the model, so that the prover need not be trusted.
CHECKER, TRUSTED_BY_THE_CHECKER = "verification.checker", ("hfa_model", "verification.arithmetic")
#: The rooms that say whether a critic is right.
ROOMS_OF_THE_JUDGE = ("verification.riccati", "verification.meaning", "verification.critic")


def upward_imports(sources: Mapping[str, str]) -> list[str]:
    """Imports of a package from a package below it."""
    height = {package: index for index, package in enumerate(LAYERS)}
    return [
        f"{module} imports {name}"
        for module in sources
        for name in sorted(imports_of(module, sources))
        if height[name.split(".")[0]] > height[module.split(".")[0]]
    ]


def imports_up_the_stairs(sources: Mapping[str, str], rooms: tuple[str, ...] = ROOMS) -> list[str]:
    """Imports of a room from a room above it. The front door of a package is for those outside the packages."""
    height = {room: index for index, room in enumerate(rooms)}
    doors = [module for module in sources if module in LAYERS]
    found = []
    for module in sorted(set(sources) - set(doors)):
        for name in sorted(imports_of(module, sources)):
            if name in doors or height[room_of(name, sources)] > height[room_of(module, sources)]:
                found.append(f"{module} imports {name}")
    return found


def learner_code_in(room: str, sources: Mapping[str, str]) -> list[str]:
    """Modules of the controller that a room reaches and must not."""
    roots = [module for module in sources if module.startswith(f"{room}.")]
    assert roots, f"{room} has moved: correct this test"
    return [
        f"{root} reaches {name}"
        for root in roots
        for name in sorted(reachable(root, sources))
        if name.startswith("controller.")
        and room_of(name, sources) != SHARED_WITH_THE_LEARNER
        and name != SHARED_WITH_THE_LEARNER
    ]


def beyond_the_checker(sources: Mapping[str, str]) -> list[str]:
    """Modules that the checker reaches outside its own room, the arithmetic and the model."""
    roots = [module for module in sources if module.startswith(f"{CHECKER}.")]
    assert roots, f"{CHECKER} has moved: correct this test"
    reached = set().union(*(reachable(root, sources) for root in roots)) - {CHECKER, *roots}
    return sorted(
        name for name in reached if not any(f"{name}.".startswith(f"{own}.") for own in TRUSTED_BY_THE_CHECKER)
    )


def import_cycle(sources: Mapping[str, str]) -> list[str]:
    """Modules that need each other, in functions or for type checkers too; empty when there are none."""
    graph = {module: imports_of(module, sources) - {module} for module in sources}
    try:
        TopologicalSorter(graph).prepare()
    except CycleError as error:
        return list(error.args[1])
    return []


def imports_by_name(sources: Mapping[str, str]) -> list[str]:
    """Modules that import what stands in a string, where nothing above sees it."""
    by_name = ("import_module", "__import__")
    return [module for module, source in sources.items() if any(word in source for word in by_name)]


def test_only_the_doors_and_the_command_import_by_name() -> None:
    assert imports_by_name(project_sources()) == ["hfa_model.support.door", "hfa_cli.main"]
    assert imports_by_name({"trim.a": 'importlib.import_module("trim.b")', "trim.b": ""}) == ["trim.a"]


def test_every_package_is_read() -> None:
    sources = project_sources()
    assert {name.split(".")[0] for name in sources} == set(LAYERS)
    assert imports_of("trim.point.solve", sources) >= {"hfa_model.aircraft", "trim.point.condition"}


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


def test_every_room_is_listed() -> None:
    sources = project_sources()
    assert {room_of(module, sources) for module in sources} - set(LAYERS) <= set(ROOMS)
    assert {room for room in ROOMS if room not in sources} == set()


def repeated_names(sources: Mapping[str, str]) -> list[str]:
    """Names of modules that stand for two things; a command has the name that its user types."""
    modules = [name for name in sources if not any(other.startswith(f"{name}.") for other in sources)]
    names = [name.rpartition(".")[2] for name in modules if room_of(name, sources) != "hfa_cli.commands"]
    return sorted({name for name in names if names.count(name) > 1})


def test_a_name_stands_for_one_module() -> None:
    assert repeated_names(project_sources()) == []
    assert repeated_names({"trim": "", "trim.report": "", "hfa_model": "", "hfa_model.report": ""}) == ["report"]


def test_imports_go_one_way_between_rooms() -> None:
    assert imports_up_the_stairs(project_sources()) == []


@pytest.mark.parametrize("room", ROOMS_OF_THE_JUDGE)
def test_the_judge_shares_values_and_files_with_the_learner(room: str) -> None:
    assert learner_code_in(room, project_sources()) == []


def test_the_checker_shares_nothing_with_the_prover_and_is_short() -> None:
    """Below 300 lines, every line counted."""
    sources = project_sources()
    assert beyond_the_checker(sources) == []
    assert sum(len(text.splitlines()) for name, text in sources.items() if room_of(name, sources) == CHECKER) < 300


@pytest.mark.parametrize(
    "line",
    [
        "from verification.balls.inertia import candidates",
        "def f():\n    from verification.proof.scheduled_loop import closed_loop",
        "import trim.point.solve",
        "from hfa_model.helper import g",
    ],
)
def test_a_planted_use_of_the_prover_is_seen(line: str) -> None:
    sources = project_sources() | {"hfa_model.helper": "import verification.balls.inertia"}
    sources["verification.arithmetic.taylor_model"] += f"\n{line}\n"
    assert beyond_the_checker(sources)


def test_the_judge_asks_a_run_for_its_weights_and_the_rank_of_its_data_alone() -> None:
    sources = project_sources()
    tree = ast.parse(sources["verification.critic.critic_check"] + sources["verification.critic.run_checks"])
    asked = {
        node.attr
        for node in ast.walk(tree)
        if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name) and node.value.id == "run"
    }
    assert asked == {"law", "times", "weights", "excitation"}


def test_no_module_needs_itself() -> None:
    assert import_cycle(project_sources()) == []


@pytest.mark.parametrize(
    "line",
    [
        "import verification.riccati.gare",
        "from verification import gare",
        "from verification.riccati.gare import x",
        "def f():\n    from verification.riccati.gare import x",
        "if True:\n    import verification.riccati.gare as judge",
        "from typing import TYPE_CHECKING\nif TYPE_CHECKING:\n    from verification.riccati.gare import x",
    ],
)
def test_a_planted_upward_import_is_seen(line: str) -> None:
    sources = {"verification.riccati.gare": "", "verification": "", "controller.game.zero_sum": line, "controller": ""}
    assert len(upward_imports(sources)) == 1
    assert upward_imports(sources)[0].startswith("controller.game.zero_sum imports verification")


def test_a_planted_use_of_the_learner_is_seen() -> None:
    sources = {
        "verification": "",
        "verification.riccati": "",
        "verification.riccati.gare": "from verification.riccati.helper import f",
        "verification.riccati.helper": "def f():\n    from controller.laws import ramp",
        "controller": "",
        "controller.laws": "",
        "controller.laws.ramp": "",
        "controller.game": "",
        "controller.game.zero_sum": "",
    }
    assert "verification.riccati.gare reaches controller.laws.ramp" in learner_code_in("verification.riccati", sources)
    innocent = sources | {"verification.riccati.helper": "from controller.game.zero_sum import Game"}
    assert learner_code_in("verification.riccati", innocent) == []


@pytest.mark.parametrize(
    "line", ["from trim.sweeps.sweep import x", "from trim.sweeps import sweep", "from trim import y"]
)
def test_a_planted_import_up_the_stairs_is_seen(line: str) -> None:
    sources = {
        "trim": "",
        "trim.point": "",
        "trim.point.solve": line,
        "trim.sweeps": "",
        "trim.sweeps.sweep": "from trim.point.solve import y",
    }
    found = imports_up_the_stairs(sources)
    assert len(found) == 1
    assert found[0].startswith("trim.point.solve imports trim")


@pytest.mark.parametrize(
    "back",
    [
        "import trim.a",
        "def f():\n    import trim.a",
        "class C:\n    def report(self):\n        from trim.a import report",
        "from typing import TYPE_CHECKING\nif TYPE_CHECKING:\n    from trim.a import A",
    ],
)
def test_a_planted_cycle_is_seen(back: str) -> None:
    cycle = {"trim": "", "trim.a": "from trim.b import x", "trim.b": "from . import c", "trim.c": back}
    assert set(import_cycle(cycle)) == {"trim.a", "trim.b", "trim.c"}
    assert import_cycle(cycle | {"trim.c": "import casadi"}) == []


# The tests have the same tree.


def without_a_module(tests: Iterable[PurePath], packages: Iterable[PurePath]) -> list[str]:
    """Test files whose name is that of no file of their room, alone or with more words behind it."""
    names: dict[PurePath, set[str]] = {}
    for path in packages:
        names.setdefault(path.parent, set()).add(path.stem)
    return [
        str(path)
        for path in tests
        if not any(f"{path.stem}_".startswith(f"test_{name}_") for name in names.get(path.parent, ()))
    ]


def test_a_test_is_named_after_its_module_or_stands_in_cli_or_project() -> None:
    found = (path.relative_to(ROOT / "tests") for path in (ROOT / "tests").rglob("test_*.py"))
    packages = [path.relative_to(ROOT) for layer in LAYERS for path in (ROOT / layer).rglob("*.*")]
    assert without_a_module((path for path in found if path.parts[0] in LAYERS), packages) == []


def test_a_test_that_its_module_has_left_is_seen() -> None:
    room = [PurePath("trim/point/solve.py"), PurePath("trim/linear/modes.py")]
    tests = [PurePath("trim/point") / f"test_{name}.py" for name in ("solve", "solve_warm", "solver", "modes")]
    assert without_a_module(tests, room) == ["trim/point/test_solver.py", "trim/point/test_modes.py"]
