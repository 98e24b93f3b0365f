"""The stored checks of published solutions are current."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from hfa import BadInputError
from studies.published.__main__ import (
    PAGE,
    RESULTS,
    SOURCES,
    load_results,
    page_of,
    results_of,
    row_of,
)
from studies.published.printed_file import load_printed

PATHS = sorted(SOURCES.glob("*.toml"))
SUSPENSION = SOURCES / "radp_suspension.toml"
STALE = "run python -m studies.published"


@pytest.mark.slow
@pytest.mark.parametrize("path", PATHS, ids=[path.stem for path in PATHS])
def test_a_new_check_gives_the_stored_row(path: Path) -> None:
    """A new check of each published solution gives its stored row."""
    assert row_of(path) in load_results(), STALE


def test_results_contain_every_file() -> None:
    """results.csv contains every file, and README.md shows its counts."""
    rows = load_results()
    assert results_of(rows) == RESULTS.read_text("utf-8"), STALE
    assert page_of(rows) == PAGE.read_text("utf-8"), STALE
    assert [row.name for row in rows] == [path.stem for path in PATHS], STALE
    for row, path in zip(rows, PATHS, strict=True):
        file = load_printed(path)
        assert file.title
        assert file.source
        assert row.text == file.title, STALE


@pytest.mark.parametrize(
    ("right", "wrong", "verdict"),
    [
        ("", "", "as printed: all 20 entries"),
        ("-20.4658", "-20.4568", "one entry of the answer: K13 is printed -20.4568"),
    ],
)
def test_a_changed_digit_changes_the_verdict(
    right: str, wrong: str, verdict: str, tmp_path: Path
) -> None:
    """One changed digit in a published solution changes its verdict."""
    path = tmp_path / "suspension.toml"
    path.write_text(SUSPENSION.read_text("utf-8").replace(right, wrong, 1), "utf-8")
    row = row_of(path)
    assert row.verdict.startswith(verdict)
    assert row.plant == "continuous 4, 1, 0"


def test_a_file_without_a_source_is_refused(tmp_path: Path) -> None:
    """A file of a published solution without a source is refused."""
    path = tmp_path / "suspension.toml"
    text = re.sub("^source = .*$", "", SUSPENSION.read_text("utf-8"), flags=re.M)
    path.write_text(text, "utf-8")
    with pytest.raises(BadInputError, match="source is missing"):
        row_of(path)
