"""`make mutants` lists the errors that no test of a room catches."""

import shutil
import subprocess
import sys

from project import ROOT

SOURCE = """
def checked(x):
    return x - 2


def unchecked(x):
    return x - 3
"""
TEST = """
from room import checked, unchecked


def test_room():
    unchecked(1)
    assert checked(5) == 3
"""


def test_an_error_that_no_test_catches_is_listed(tmp_path):
    (tmp_path / "tools").mkdir()
    shutil.copy(ROOT / "tools" / "plant_errors.py", tmp_path / "tools")
    (tmp_path / "tests").mkdir()
    (tmp_path / "room.py").write_text(SOURCE)
    (tmp_path / "tests" / "test_room.py").write_text(TEST)
    (tmp_path / "pytest.ini").write_text("[pytest]\npythonpath = .\nmarkers = slow\n")
    words = [sys.executable, "tools/plant_errors.py", "room.py", "--tests", "tests"]
    run = subprocess.run(words, cwd=tmp_path, capture_output=True, text=True, check=True)
    listed = [line for line in run.stdout.splitlines() if line.startswith("room.py:")]
    assert [line.partition(" ")[0] for line in listed] == ["room.py:7"]
    assert "caught 1 of 2 errors" in run.stdout
