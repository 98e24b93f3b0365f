"""The wheel contains all modules and data, and the project's folder only what is named here."""

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


#: Tracked files and folders of the root.
AT_THE_ROOT = {
    *(
        ".ci",
        ".github",
        ".gitignore",
        ".pre-commit-config.yaml",
        "Makefile",
        "conftest.py",
        "noxfile.py",
    ),
    *("pyproject.toml", "tools"),
    *("ARCHITECTURE.md", "CHANGELOG.md", "CITATION.cff", "CONTRIBUTING.md", "README.md"),
    *("hfa_model", "trim", "controller", "verification", "tests"),
    *("hfa", "hfa_aircraft", "hfa_support", "extensions"),
    *("benchmarks", "docs", "examples", "studies"),
}


@pytest.mark.skipif(not (ROOT / ".git").exists(), reason="not a checkout of git")
def test_the_root_contains_only_the_named_files():
    """The files and folders in the project's folder that git tracks are those of `AT_THE_ROOT`:
    notes and output are not added.
    """
    listed = subprocess.run(["git", "ls-files", "-z"], cwd=ROOT, capture_output=True, check=True)
    assert {
        name.split("/")[0] for name in listed.stdout.decode().split("\0") if name
    } == AT_THE_ROOT
