"""Public names of the packages, which are imported when they are used."""

import ast
import subprocess
import sys

import pytest
from project import FOLDERS

import hfa


def stub_names():
    """Return the names that the stub of `hfa` imports."""
    tree = ast.parse((FOLDERS["hfa"] / "__init__.pyi").read_text("utf-8"))
    imports = [node for node in tree.body if isinstance(node, ast.ImportFrom)]
    return {alias.asname or alias.name for node in imports for alias in node.names}


def test_hfa_has_the_names_of_its_stub_and_no_other():
    """`dir(hfa)` is the stub. Functions of other packages and earlier names do not exist."""
    pytest.importorskip("hfa_flight")
    assert set(dir(hfa)) == stub_names()
    for name in ("linspace", "find_operating_point", "load_critic", "load", "step", "sin"):
        assert not hasattr(hfa, name), name


@pytest.mark.parametrize("name", ["trim", "controller"])
def test_a_file_that_hides_a_package_is_named(name, tmp_path):
    """A user's own trim.py beside his script is named in one line that says to rename it."""
    own = tmp_path / f"{name}.py"
    own.write_text("x = 1\n")
    (tmp_path / "script.py").write_text("import hfa\n")
    words = [sys.executable, "script.py"]
    done = subprocess.run(words, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 1
    last = done.stderr.splitlines()[-1]
    assert last == f"ImportError: {own} hides the package {name} that hfa imports; rename this file"
