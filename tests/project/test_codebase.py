"""The wheel contains all modules and data."""

from __future__ import annotations

import shutil
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest
from project import FOLDERS, ROOT

DATA = {
    *(f"{package}/py.typed" for package in FOLDERS),
    *("hfa_model/parameters.toml", "hfa_model/printed_matrices.json"),
}


@pytest.mark.slow
def test_the_wheel_contains_all_modules_and_data(tmp_path: Path) -> None:
    """A wheel built from the sources contains exactly the modules and data of the packages."""
    sources = tmp_path / "sources"
    wheels = tmp_path / "wheels"
    sources.mkdir()
    for name in ("pyproject.toml", "README.md"):
        shutil.copy(ROOT / name, sources)
    for folder in FOLDERS.values():
        copy = sources / folder.relative_to(ROOT)
        shutil.copytree(folder, copy, ignore=shutil.ignore_patterns("__pycache__"))
    for stray in ("trim_results", "controller_old"):
        (sources / stray).mkdir()
        (sources / stray / "__init__.py").touch()
    command = [sys.executable, "-m", "pip", "wheel", "--quiet", "--no-deps", "--no-build-isolation"]
    subprocess.run([*command, "--wheel-dir", str(wheels), str(sources)], check=True, timeout=120)
    (wheel,) = wheels.glob("*.whl")
    names = set(zipfile.ZipFile(wheel).namelist())
    ours = {
        str(path.relative_to(folder.parent))
        for folder in FOLDERS.values()
        for path in folder.rglob("*")
        if path.is_file() and path.suffix != ".pyc"
    }
    assert ours >= DATA
    assert {name for name in names if ".dist-info/" not in name} == ours
