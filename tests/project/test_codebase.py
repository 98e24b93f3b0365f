"""The wheel contains all modules and data."""

import shutil
import subprocess
import sys
import zipfile

import pytest
from project import FOLDERS, ROOT

DATA = {
    *(f"{package}/py.typed" for package in FOLDERS),
    *("hfa_model/parameters.toml", "hfa_model/printed_matrices.json"),
}


@pytest.mark.slow
def test_the_wheel_contains_all_modules_and_data(tmp_path):
    """A wheel contains exactly the files of the project's packages, also if the source folder has
    other packages, whose names begin like those of the project.
    """
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
    expected = {
        str(path.relative_to(folder.parent))
        for folder in FOLDERS.values()
        for path in folder.rglob("*")
        if path.is_file() and path.suffix != ".pyc"
    }
    assert expected >= DATA  # the data files are in the folders of the packages
    assert {name for name in names if ".dist-info/" not in name} == expected
