"""The page of guarantees names existing tests."""

from __future__ import annotations

import re

import pytest
from project import ROOT

PAGE = (ROOT / "docs" / "promises.md").read_text(encoding="utf-8")
PROMISES = [
    line.strip("|").split(" | ")
    for line in PAGE.splitlines()
    if re.search(r"`(tests|extensions)/", line)
]
_TEST = re.compile(r"`((?:tests|extensions)/\S+\.py)::(test_\w+)`( \(slow\))?")


def missing(promise: list[str]) -> str:
    """Return the fault in a row of the page, or "" if its tests exist.

    promise: the cells of the row: guarantee, tolerance and tests
    """
    if len(promise) != 3 or not all(cell.strip() for cell in promise):
        return "a promise has a tolerance and a test"
    tests = _TEST.findall(promise[2])
    if not tests or len(tests) != promise[2].count("::"):
        return f"no test in {promise[2]}"
    for file, name, slow in tests:
        if not (ROOT / file).exists():
            return f"no file {file}"
        text = (ROOT / file).read_text(encoding="utf-8")
        before, is_there, _ = text.partition(f"def {name}(")
        if not is_there:
            return f"no {name} in {file}"
        if slow and "@pytest.mark.slow" not in before.rpartition("\n\n\n")[2]:
            return f"{name} is not slow"
    return ""


@pytest.mark.parametrize("promise", PROMISES, ids=lambda promise: promise[0].strip()[:40])
def test_each_guarantee_names_existing_tests(promise: list[str]) -> None:
    """Each guarantee on the page has a tolerance and names existing tests."""
    assert missing(promise) == ""
    assert len(PROMISES) > 20


@pytest.mark.parametrize(
    "change",
    [
        (2, "`tests/nowhere.py::test_x`"),
        (2, "`tests/conftest.py::test_x`"),
        (2, f"{PROMISES[0][2]}, `tests/conftest.py::test_x`"),
        (1, " "),
    ],
)
def test_an_empty_guarantee_is_reported(change: tuple[int, str]) -> None:
    """A guarantee without a tolerance or an existing test is reported."""
    promise = list(PROMISES[0])
    promise[change[0]] = change[1]
    assert missing(promise)
