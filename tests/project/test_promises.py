"""The page of promises names tests that exist and commands that are there."""

from __future__ import annotations

import re

import pytest
from project import ROOT

from hfa.main import COMMANDS

PAGE = (ROOT / "docs" / "promises.md").read_text(encoding="utf-8")
PROMISES = [
    line.strip("|").split(" | ")
    for line in PAGE.splitlines()
    if re.search(r"`(tests|extensions)/", line)
]


def missing(promise: list[str]) -> str:
    """What a row names that is not there, or ""."""
    if len(promise) != 4 or not all(cell.strip() for cell in promise):
        return "a promise has a tolerance, a test and a way to see it"
    found = re.search(r"`((?:tests|extensions)/\S+\.py)::(test_\w+)`( \(slow\))?", promise[2])
    if found is None or not (ROOT / found[1]).exists():
        return f"no test in {promise[2]}"
    text = (ROOT / found[1]).read_text(encoding="utf-8")
    before, is_there, _ = text.partition(f"def {found[2]}(")
    if not is_there:
        return f"no {found[2]} in {found[1]}"
    if found[3] is not None and "@pytest.mark.slow" not in before.rpartition("\n\n\n")[2]:
        return f"{found[2]} is not slow"
    command = re.search(r"`hfa ([a-z-]+)", promise[3])
    return f"no command {command[1]}" if command is not None and command[1] not in COMMANDS else ""


@pytest.mark.parametrize("promise", PROMISES, ids=lambda promise: promise[0].strip()[:40])
def test_a_promise_is_held_by_a_test(promise: list[str]) -> None:
    assert missing(promise) == ""
    assert len(PROMISES) > 20


@pytest.mark.parametrize(
    "change",
    [
        (2, "`tests/nowhere.py::test_x`"),
        (2, "`tests/support/cli.py::test_x`"),
        (3, "`hfa nothing`"),
        (1, " "),
    ],
)
def test_an_empty_promise_is_noticed(change: tuple[int, str]) -> None:
    promise = list(PROMISES[0])
    promise[change[0]] = change[1]
    assert missing(promise)
