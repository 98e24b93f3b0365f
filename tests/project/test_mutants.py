"""The lists of planted wrong lines, tests/mutants/*.toml, fit the source."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "tests"))
from mutants import Copy, Mutant, read_lists  # noqa: E402


def test_each_wrong_line_can_be_planted():
    mutants = read_lists([])
    for mutant in mutants:
        mutant.planted((ROOT / mutant.file).read_text(encoding="utf-8"))
    assert len({(mutant.file, mutant.before, mutant.after) for mutant in mutants}) == len(mutants)


def test_a_line_that_is_gone_or_there_twice_is_refused():
    mutant = Mutant("trim", "trim/a.py", "a + b", "a - b", "sign of b")
    assert mutant.planted("x = a + b") == "x = a - b"
    for text in ("x = a - b", "x = a + b; y = a + b"):
        with pytest.raises(ValueError, match="sign of b"):
            mutant.planted(text)


def test_a_planted_line_is_caught_by_the_test_that_fails(tmp_path, monkeypatch):
    copy = Copy.__new__(Copy)
    copy.folder, copy.variables = tmp_path, {}
    (tmp_path / "a.py").write_text("x = 1 + 1\n")
    ran = []

    def failure(tests):
        ran.append(tests)
        wrong = "1 - 1" in (tmp_path / "a.py").read_text()
        return "tests/test_a.py::test_x" if wrong and "tests" in tests else None

    monkeypatch.setattr(copy, "failure", failure)
    mutant = Mutant("trim", "a.py", "1 + 1", "1 - 1", "sign")
    stages = [["tests/a"], ["tests"]]
    assert copy.caught_by(mutant, stages) == "tests/test_a.py::test_x"
    assert ran[-1] == ["tests/test_a.py::test_x"]
    assert (tmp_path / "a.py").read_text() == "x = 1 + 1\n"
    assert copy.caught_by(mutant, stages[:-1]) is None
