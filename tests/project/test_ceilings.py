"""Ceilings on the source size of commands, the core and its tests, in tokens."""

from __future__ import annotations

import io
import json
import subprocess
import sys
import tokenize
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from known_models import exact_gain
from project import FOLDERS, ROOT

_LAYOUT = (tokenize.NL, tokenize.NEWLINE, tokenize.INDENT, tokenize.DEDENT, tokenize.ENDMARKER)
#: Command -> largest number of tokens of the project's modules that it loads.
LOADED = {"trim --dihedral 10": 48_000, "verify --dihedral 15 --weights K.npz": 75_000}
#: Largest number of tokens of the core's packages.
CORE = 150_000
#: Largest number of tokens of the core's tests, without tests of studies.
TESTS = 150_000
_LIST = """
import contextlib, io, json, sys
from hfa.main import main
with contextlib.redirect_stdout(io.StringIO()):
    code = main(sys.argv[1:])
files = [getattr(module, "__file__", None) for module in list(sys.modules.values())]
print(json.dumps([code, [file for file in files if file]]))
"""


@cache
def size(path: Path) -> int:
    """Return the number of tokens in a file, without comments, line breaks and indentation."""
    text = io.StringIO(path.read_text(encoding="utf-8"))
    kinds = (token.type for token in tokenize.generate_tokens(text.readline))
    return sum(kind not in (*_LAYOUT, tokenize.COMMENT) for kind in kinds)


def own(path: Path) -> bool:
    """Return whether a file is a Python module of the project's packages."""
    return path.suffix == ".py" and any(path.is_relative_to(folder) for folder in FOLDERS.values())


@pytest.mark.parametrize("command", LOADED)
def test_a_command_loads_at_most_its_ceiling(command: str, folder: Path) -> None:
    """A command of the core imports no extension and at most its ceiling of tokens."""
    np.savez("K.npz", K=exact_gain(15.0))
    words = [sys.executable, "-c", _LIST, *command.split()]
    done = subprocess.run(words, check=True, capture_output=True, text=True, timeout=120)
    code, files = json.loads(done.stdout)
    paths = {Path(file).resolve() for file in files}
    loaded = {path.relative_to(ROOT): size(path) for path in paths if own(path)}
    assert code == 0
    assert not any(path.parts[0] == "extensions" for path in loaded), "the core needs none"
    assert 40_000 < sum(loaded.values()) <= LOADED[command]


def test_the_core_is_no_larger_than_its_ceiling() -> None:
    """The packages of the core do not exceed their ceiling of tokens."""
    core = [folder for folder in FOLDERS.values() if folder.parent == ROOT]
    tokens = sum(size(path) for folder in core for path in folder.rglob("*.py"))
    assert 100_000 < tokens <= CORE


def test_tests_of_the_core_keep_their_ceiling() -> None:
    """The tests of the core do not exceed their ceiling of tokens."""
    studies = ROOT / "tests" / "studies"
    files = [path for path in (ROOT / "tests").rglob("*.py") if not path.is_relative_to(studies)]
    assert 100_000 < sum(size(path) for path in files) <= TESTS
