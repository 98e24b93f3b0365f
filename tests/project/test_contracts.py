"""The import contracts in pyproject.toml cover every package and detect violations."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
from project import FOLDERS, ROOT, SETTINGS

CONTRACTS = SETTINGS["importlinter"]["contracts"]
PACKAGES = {*FOLDERS, "studies"}
EXTENSIONS = {name for name, folder in FOLDERS.items() if "extensions" in folder.parts}
#: File -> import that a contract forbids in it.
BREACHES = {
    "trim/point/halving.py": "trim.sweeps.sweep",
    "trim/linear/modes.py": "trim.sweeps.sweep",
    "controller/game/zero_sum.py": "hfa_flight.scenario",
    "controller/game/basis.py": "controller.riccati.gare",
    "controller/critic/critic.py": "controller.learning.certified",
    "controller/learning/recording.py": "controller.riccati.gare",
    "verification/regeneration.py": "controller.learning.certified",
    "controller/learning/q_learning.py": "controller.discrete.solution",
    "extensions/policy/hfa_policy/assess.py": "controller.learning.certified",
    "extensions/prove/hfa_prove/search/family.py": "controller.learning.recording",
    "extensions/prove/hfa_prove/check/loop_squares.py": "controller.learning.recording",
    "extensions/prove/hfa_prove/search/region_boxes.py": "controller.learning.q_learning",
    "verification/printed/exact_answer.py": "controller.learning.certified",
    "verification/reasons/diagnosis.py": "hfa_flight.scenario",
    "extensions/prove/hfa_prove/check/schedule.py": "hfa_prove.search.family",
    "extensions/prove/hfa_prove/check/game.py": "hfa_prove.search.lines",
    "extensions/prove/hfa_prove/search/loops.py": "hfa_model.vectors",
    "extensions/prove/hfa_prove/check/region_squares.py": "hfa_prove.search.region_squares",
    "extensions/prove/hfa_prove/check/region_boxes.py": "controller.critic.network.critic",
    "hfa_support/rows/workers.py": "hfa_model.choice",
    # A learner that another module imports, and a package that no contract names.
    "extensions/prove/hfa_prove/results.py": "hfa.options.games",
    "extensions/policy/hfa_policy/reach.py": "hfa_flight.options",
    "verification/enclosure/taylor.py": "hfa_aircraft.rigid.motion",
}


def contract(begin: str) -> dict[str, Any]:
    """Return the contract whose name begins with this text."""
    (found,) = (each for each in CONTRACTS if each["name"].startswith(begin))
    return found


def test_contracts_name_every_package() -> None:
    """The contracts list every package."""
    assert set(SETTINGS["importlinter"]["root_packages"]) == PACKAGES
    core = contract("The core imports no extension")
    in_core = PACKAGES - EXTENSIONS - {"studies", "hfa"} | {"hfa.options"}
    assert set(core["modules"]) == set(core["allowed"]) == in_core
    layers = contract("Packages import only those below them")["layers"]
    named = {name.strip().partition(".")[0] for layer in layers for name in re.split("[|:]", layer)}
    assert named == PACKAGES - {"hfa_jsbsim"}
    door = contract("JSBSim is a door")
    assert door["modules"] == ["hfa_jsbsim"]


def test_no_import_is_ignored() -> None:
    """No contract has an exception, for type checkers or in functions."""
    assert [line for each in CONTRACTS for line in each.get("ignore_imports", [])] == []


@pytest.mark.slow
def test_planted_forbidden_imports_are_detected(tmp_path: Path) -> None:
    """The linter reports each forbidden import that is planted in a copy of the project."""
    pytest.importorskip("importlinter")
    for folder in (*FOLDERS.values(), ROOT / "studies"):
        target = tmp_path / folder.relative_to(ROOT)
        shutil.copytree(folder, target, ignore=shutil.ignore_patterns("__pycache__", "*.json"))
    for name in ("pyproject.toml", "import_contracts.py"):
        shutil.copy(ROOT / name, tmp_path)
    assert len(BREACHES) >= 16
    for file, imported in BREACHES.items():
        with (tmp_path / file).open("a", encoding="utf-8") as source:
            source.write(f"\nimport {imported}\n")
    roots = [tmp_path, *sorted((tmp_path / "extensions").iterdir())]
    done = subprocess.run(
        [Path(sys.executable).with_name("lint-imports"), "--no-cache"],
        cwd=tmp_path,
        env={**os.environ, "PYTHONPATH": os.pathsep.join(map(str, roots)), "COLUMNS": "300"},
        capture_output=True,
        text=True,
        timeout=300,
    )
    assert done.returncode == 1
    for file, imported in BREACHES.items():
        module = ".".join(Path(file).with_suffix("").parts).partition(".hfa_")
        importer = file if not file.startswith("extensions") else f"hfa_{module[2]}"
        importer = importer.removesuffix(".py").replace("/", ".")
        assert f"{importer} -> {imported} " in done.stdout, f"{importer} imports {imported}"
