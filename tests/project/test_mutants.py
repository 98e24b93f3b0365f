"""`make mutants`: what it plants, that it sees tests which cannot fail, and what docs/promises.md says of it."""

from __future__ import annotations

import json
import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
from import_graph import ROOT
from mutant_results import FILE, OPEN, PAGE, record, table, with_table
from mutations import mutations, same_types

SCRIPT = ROOT / "tests" / "support" / "mutants.py"


@pytest.mark.parametrize(
    ("source", "expected"),
    [
        ("y = a < b", ["y = (a <= b)", "y = (a >= b)"]),
        ("y = a < b + 1e-9", ["y = (a >= b + 1e-09)", "y = a < (b - 1e-09)", "y = a < b + (1.000000001)"]),
        ("y = a < b * LIMIT", ["y = (a >= b * LIMIT)", "y = a < (b / LIMIT)"]),
        ("y = a < LIMIT", ["y = (a <= LIMIT)", "y = (a >= LIMIT)"]),
        ("y = 500", ["y = (1000)"]),
        ("zip(a, b, strict=True)", ["pass"]),
        ("progress(n + 1, 5)", []),
        ("y = a is not b", ["y = (a is b)"]),
        ("y = a * b", ["y = (a / b)"]),
        ("y = A @ B", ["y = (B @ A)"]),
        ("y -= η", ["y += η", "pass"]),
        ("y = -0.5", ["y = (0.5)", "y = -(1.5)"]),
        ("y = not a", ["y = (a)"]),
        ("y = a and b or True", ["y = ((a and b) and True)", "y = (a or b) or True", "y = a and b or (False)"]),
        ("y = b if a else c", ["y = b if (not a) else c"]),
        ("y = [x for x in a if x]", ["y = [x for x in a if (not x)]"]),
        ("y = arctan2(η, b)", ["y = (arctan2(b, η))"]),
        ("set_it(a)", ["pass"]),
        ("y[a] = b", ["pass"]),
        ("raise ValueError(f'{a + 1} is more than {2}')", ["pass"]),
        ("'''Text.'''", []),
        ("y: Length[3] = a", []),
        ("y = f'{a + 1}' + 'b'", []),
        ("if TYPE_CHECKING:\n    y = 1 < 2", []),
    ],
)
def test_the_mistakes_that_are_planted(source: str, expected: list[str]) -> None:
    assert [each.applied(source) for each in mutations(source)] == expected


def test_arguments_are_swapped_where_their_types_agree() -> None:
    alike = same_types(
        ["def f(a: int, b: int): ...\ndef g(a: int, b: str): ...\nclass A:\n  def h(self, a: A, b: A): ..."]
    )
    swapped = [each.new for each in mutations("f(x, y)\ng(x, y)\no.h(x, y)", alike) if each.kind == "arguments swapped"]
    assert swapped == ["(f(y, x))", "(o.h(y, x))"]


def toy(folder: Path, test: str) -> str:
    """What the script says of a project of one line whose test file is this; what it knows stays in `folder`."""
    for path, text in {
        "toy/one.py": "def larger(a, b):\n    return a if a > b else b - 0\n",
        "tests/toy/test_one.py": f"from toy.one import larger\n\n\ndef test_it():\n    {test}\n",
        "pyproject.toml": '[tool.pytest.ini_options]\npythonpath = ["."]\nmarkers = ["slow"]\n',
    }.items():
        (folder / path).parent.mkdir(parents=True, exist_ok=True)
        (folder / path).write_text(text)
    command = [sys.executable, SCRIPT, "--root", folder, "--packages", "toy", "--folder", folder / "out"]
    return subprocess.run(command, capture_output=True, text=True, check=True, timeout=300).stdout


@pytest.mark.slow
def test_a_test_that_cannot_fail_is_seen_and_one_that_can_finds_the_mistakes(tmp_path: Path) -> None:
    assert "4 mutants, 0 killed" in toy(tmp_path, "assert larger")
    found = toy(tmp_path, "assert larger(1, 2) == 2 == larger(2, 1)")
    assert "4 mutants, 2 killed" in found
    assert "a > b -> (a <= b) (1 tests: killed by tests/toy/test_one.py::test_it)" in found
    assert "b - 0 -> (b + 0) (1 tests: SURVIVED)" in found
    again = toy(tmp_path, "assert larger(1, 2) == 2 == larger(2, 1)")
    assert "4 mutants, 2 killed" in again
    assert "tests:" not in again, "nothing is tried twice"


@pytest.mark.slow
def test_a_test_file_that_is_gone_finds_nothing(tmp_path: Path) -> None:
    """What is known of it stays in the folder; asked for it, pytest fails whatever the mistake is."""
    gone = tmp_path / "tests/toy/test_gone.py"
    toy(tmp_path, "assert larger")
    gone.write_text("from toy.one import larger\n\n\ndef test_it():\n    assert larger(1, 1)\n")
    assert "test_gone.py: 1 tests" in toy(tmp_path, "assert larger")
    gone.unlink()
    (tmp_path / "out/outcomes.json").unlink()
    assert "4 mutants, 0 killed" in toy(tmp_path, "assert larger")


def test_the_script_loads_nothing_of_the_project_before_it_is_copied() -> None:
    code = "import sys, mutants; print([each for each in mutants.PACKAGES if each in sys.modules])"
    run = [sys.executable, "-c", code]
    assert subprocess.run(run, capture_output=True, text=True, check=True, cwd=SCRIPT.parent).stdout == "[]\n"


def found() -> dict[str, Any]:
    return dict(json.loads(FILE.read_bytes()))


def test_the_page_shows_what_was_found() -> None:
    assert table(found()) in PAGE.read_text(encoding="utf-8")


def test_every_survivor_has_its_cause_and_a_reason() -> None:
    without = [each for each in found()["survivors"] if each["cause"] == OPEN or not each["reason"]]
    assert without == []


def test_every_survivor_is_where_the_file_says() -> None:
    moved = []
    for each in found()["survivors"]:
        path, _, name = ROOT / each["module"], *each["function"].rpartition(".")[1:]
        text = path.read_text(encoding="utf-8") if path.exists() else ""
        if not re.search(rf"^ *(def|class) {name}\b" if name else ".", text, re.MULTILINE):
            moved.append(f"{each['module']} {each['function']}")
    assert moved == []


def test_a_new_survivor_is_open_and_a_known_one_keeps_its_cause() -> None:
    first = {"module": "a/b.py", "function": "f", "change": "1 -> (2)", "killed": False}
    outcomes = {"k1": first, "k2": {**first, "killed": True}}
    known = record(outcomes, {})
    assert known["packages"] == {"a": {"mutants": 2, "killed": 1}}
    assert [(each["key"], each["cause"]) for each in known["survivors"]] == [("k1", OPEN)]
    known["survivors"][0] |= {"cause": "same result", "reason": "r"}
    assert record({**outcomes, "k3": first}, known)["survivors"][0]["reason"] == "r"
    assert "| a | 2 | 1 | 50.0% |" in table(known)
    assert "| same result | 1 |" in table(known)
    page = f"# Before\n\n{table(known)}\n\nBehind.\n"
    assert with_table(page, known) == page
    again = with_table(page, record({**outcomes, "k1": {**first, "killed": True}}, {}))
    assert "| a | 2 | 2 | 100.0% |" in again
    assert again.endswith("|---|---|\n\nBehind.\n")
