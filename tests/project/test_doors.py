"""The front doors: complete, lazy, and enough for a notebook."""

from __future__ import annotations

import ast
import importlib
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest
from documents import blocks_of
from import_graph import LAYERS, ROOT

PACKAGES = LAYERS[:4]


@pytest.mark.parametrize("name", PACKAGES)
def test_every_name_of_a_door_is_there(name: str) -> None:
    package = importlib.import_module(name)
    assert dir(package) == sorted(package.__all__)
    assert package.__all__
    for export in package.__all__:
        assert getattr(package, export) is not None


@pytest.mark.parametrize("name", PACKAGES)
def test_a_name_that_is_not_there_is_said(name: str) -> None:
    with pytest.raises(AttributeError, match=f"module '{name}' has no attribute 'nonsense'; it offers "):
        importlib.import_module(name).nonsense  # noqa: B018


@pytest.mark.parametrize("name", PACKAGES)
def test_a_room_is_not_hidden_by_a_name(name: str) -> None:
    """A room and a name of the same door would replace each other, depending on who is imported first."""
    package = importlib.import_module(name)
    rooms = {path.name for path in Path(package.__path__[0]).iterdir() if path.is_dir()}
    assert rooms & set(package.__all__) == set()


def test_opening_the_doors_loads_nothing_heavy() -> None:
    heavy = "casadi", "scipy", "numpy", "control"
    code = f"import sys, {', '.join(PACKAGES)}; print([name for name in {heavy} if name in sys.modules])"
    shown = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout
    assert shown.strip() == "[]"


#: Where users look: what is shown there needs the front doors alone.
SHOWN = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md")), *sorted((ROOT / "examples").glob("*.py"))]


def past_the_door(source: str) -> list[str]:
    """Imports of a snippet that reach into a package instead of using its door, and names that no door has."""
    found = []
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Import):
            found += [
                alias.name for alias in node.names if alias.name.partition(".")[0] in PACKAGES and "." in alias.name
            ]
        elif isinstance(node, ast.ImportFrom) and node.module and node.module.partition(".")[0] in LAYERS:
            if node.module not in PACKAGES:
                found.append(node.module)
            else:
                offered = importlib.import_module(node.module).__all__
                found += [f"{node.module}.{alias.name}" for alias in node.names if alias.name not in offered]
    return found


def test_imports_past_a_door_are_seen() -> None:
    source = "from trim import sweep\nfrom trim.linear.modes import modes_of\nimport trim.point\nfrom trim import _a"
    assert past_the_door(source) == ["trim.linear.modes", "trim.point", "trim._a"]


@pytest.mark.parametrize("path", SHOWN, ids=lambda path: path.stem)
def test_documents_and_examples_use_the_front_doors_alone(path: Path) -> None:
    text = path.read_text(encoding="utf-8")
    blocks = [text] if path.suffix == ".py" else [each.text for each in blocks_of(text) if each.language == "python"]
    assert [name for block in blocks for name in past_the_door(block)] == []


def test_each_use_in_the_readme_takes_eight_lines_and_four_imports() -> None:
    section = (ROOT / "README.md").read_text(encoding="utf-8").partition("## As a library")[2].partition("\n## ")[0]
    uses = [each.text for each in blocks_of(section) if each.language == "python"][:3]
    for use in uses:
        assert len([line for line in use.splitlines() if line]) <= 8
        lines = [line for line in use.splitlines() if "import" in line]
        assert {name for line in lines for name in line.removeprefix("import ").split(", ")} <= set(PACKAGES)


@pytest.mark.slow  # mypy reads all packages again; `make lint` reads them with their types
def test_a_type_checker_sees_the_types(tmp_path: Path) -> None:
    script = tmp_path / "user.py"
    names = "trim.sweep", "trim.linearize", "hfa_model.Aircraft", "controller.learn", "verification.solve_game"
    script.write_text(f"import {', '.join(PACKAGES)}\n" + "".join(f"reveal_type({name})\n" for name in names))
    # Other packages are left out: what they are to a type checker is not ours, and reading them takes long.
    options = "--no-site-packages", "--ignore-missing-imports", "--config-file", os.devnull, "--cache-dir", os.devnull
    command = [sys.executable, "-m", "mypy", *options, str(script)]
    found = subprocess.run(command, capture_output=True, text=True, env=os.environ | {"MYPYPATH": str(ROOT)})
    revealed = [line for line in found.stdout.splitlines() if "Revealed type" in line and str(script) in line]
    assert len(revealed) == len(names), found.stdout
    for name, result in zip(names, ("Sweep", "LinearModel", "Aircraft", "LearningResult", "GameSolution"), strict=True):
        line = revealed[names.index(name)]
        assert line.rstrip('"').endswith(f".{result}"), line


@pytest.mark.slow
def test_a_type_checker_sees_what_is_no_quantity(tmp_path: Path) -> None:
    wrong = {
        'center_height("15 deg", p)': "arg-type",
        "x.sped": "attr-defined",
        "airspeed(x, Wind()) + STATE_UNITS.speed": "operator",
        'State[Quantity](68.0, "2.8", 0.0, 0.0, 0.0, 0.0, 0.0)': "arg-type",
        "load.lift + load.center": "operator",
    }
    head = (
        "from hfa_model.aerodynamics import Loads",
        "from hfa_model.kinematics import airspeed, center_height",
        "from hfa_model.parameters import Parameters",
        "from hfa_model.vectors import STATE_UNITS, Quantity, State",
        "from hfa_model.winds import Wind",
        "def use(x: State[Quantity], p: Parameters[Quantity], load: Loads[Quantity]) -> None:",
        "    airspeed(x, Wind()) + center_height(0.1, p)",
    )
    script = tmp_path / "user.py"
    script.write_text("\n".join([*head, *(f"    {line}" for line in wrong)]))
    command = [sys.executable, "-m", "mypy", "--config-file", os.devnull, "--cache-dir", os.devnull, str(script)]
    found = subprocess.run(command, capture_output=True, text=True, env=os.environ | {"MYPYPATH": str(ROOT)})
    said = re.findall(rf"^{re.escape(str(script))}:(\d+): error: .*\[(.*)\]$", found.stdout, re.M)
    expected = {(str(len(head) + 1 + index), code) for index, code in enumerate(wrong.values())}
    assert set(said) == expected, found.stdout
