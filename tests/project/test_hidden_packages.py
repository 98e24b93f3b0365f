"""A user's file with the name of one of our packages: Python takes it for ours, and we say which file it is."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest
from cli import SCRIPT
from import_graph import LAYERS

IMPORTERS = (*LAYERS[:-1], "hfa_cli.main")
#: A hidden package and one that needs it, or does not.
NEEDED = [(name, other) for i, name in enumerate(LAYERS) for other in IMPORTERS[i + 1 :]]
NOT_NEEDED = [(name, other) for i, name in enumerate(LAYERS) for other in IMPORTERS[:i]]


def run(*words: str, folder: Path, **environment: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        words, cwd=folder, env={**os.environ, **environment}, capture_output=True, text=True, timeout=60
    )


def planted(folder: Path, name: str) -> Path:
    """A file of the user."""
    path = folder / f"{name}.py"
    path.write_text("gain = 3.0\n", encoding="utf-8")
    return path


@pytest.mark.parametrize(("name", "importer"), NEEDED)
def test_a_hidden_package_that_is_needed_is_one_clear_error(tmp_path: Path, name: str, importer: str) -> None:
    path = planted(tmp_path, name)
    done = run(sys.executable, "-c", f"import {importer}", folder=tmp_path)
    assert done.returncode == 1
    if name == "hfa_model" and importer == "hfa_cli.main":  # the command does not go through a door of its own
        assert "'hfa_model' is not a package" in done.stderr
    else:
        last = done.stderr.splitlines()[-1]
        assert last.startswith(f"ImportError: {path} hides the package {name!r} of hfa-toolchain: rename it")


@pytest.mark.parametrize(("name", "importer"), NOT_NEEDED)
def test_a_hidden_package_that_may_not_be_needed_is_a_warning(tmp_path: Path, name: str, importer: str) -> None:
    path = planted(tmp_path, name)
    done = run(sys.executable, "-c", f"import {importer}, {name}\nprint({name}.gain)", folder=tmp_path)
    assert (done.returncode, done.stdout) == (0, "3.0\n")
    assert f"UserWarning: {path} hides the package {name!r} of hfa-toolchain: rename it" in done.stderr


@pytest.mark.parametrize("init", [True, False], ids=["package", "folder"])
def test_a_folder_that_hides_is_named(tmp_path: Path, init: bool) -> None:
    """Without an __init__.py it hides an editable install alone, as that of `make`; nothing that PYTHONPATH names."""
    folder = tmp_path / "trim"
    folder.mkdir()
    if init:
        (folder / "__init__.py").touch()
    done = run(sys.executable, "-c", "import controller", folder=tmp_path, PYTHONPATH="")
    found = folder / "__init__.py" if init else folder
    assert done.stderr.splitlines()[-1].startswith(f"ImportError: {found} hides the package 'trim'")


@pytest.mark.parametrize("name", [pytest.param(each, marks=[pytest.mark.slow] * (each != "trim")) for each in LAYERS])
def test_neither_the_script_nor_a_safe_path_takes_files_of_the_user(tmp_path: Path, name: str) -> None:
    planted(tmp_path, name)
    everything = f"import {', '.join(IMPORTERS)}"
    for done in (
        run(str(SCRIPT), "trim", "--dihedral", "15", "--json", folder=tmp_path),
        run(sys.executable, "-P", "-c", everything, folder=tmp_path),
        run(sys.executable, "-c", everything, folder=tmp_path, PYTHONSAFEPATH="1"),
    ):
        assert (done.returncode, done.stderr) == (0, "")


@pytest.mark.parametrize("name", LAYERS[:-1])
def test_the_command_as_a_module_says_it_in_one_line(tmp_path: Path, name: str) -> None:
    planted(tmp_path, name)
    done = run(sys.executable, "-m", "hfa_cli", "trim", "--dihedral", "15", folder=tmp_path)
    assert (done.returncode, done.stdout, done.stderr.count("\n")) == (2, "", 1)
    assert name in done.stderr
    assert "hides" in done.stderr


def test_without_such_files_nothing_is_said(tmp_path: Path) -> None:
    done = run(sys.executable, "-c", f"import {', '.join(IMPORTERS)}", folder=tmp_path)
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")
