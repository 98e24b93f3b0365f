"""The page of printed answers is what the command makes, and every file says its source."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from hfa_support.errors import BadInputError
from studies.published.__main__ import PAGE, SOURCES, page_of, row_of
from verification.printed.printed_file import load_printed

PATHS = sorted(SOURCES.glob("*.toml"))
SUSPENSION = SOURCES / "radp_suspension.toml"


@pytest.mark.slow
def test_the_page_is_what_the_command_makes() -> None:
    page = page_of([row_of(path) for path in PATHS])
    assert PAGE.read_text("utf-8") == page, "run python -m studies.published"


def test_the_page_has_a_row_for_every_file() -> None:
    rows = re.findall(r"^\| (\w+) \| (.*?) \|", PAGE.read_text("utf-8"), re.M)
    files = {path.stem: load_printed(path) for path in PATHS}
    sources = {name: f"{file.title}; {file.source}" for name, file in files.items()}
    assert {name: source for name, source in rows if name in files} == sources
    assert all(file.title and file.source for file in files.values())


@pytest.mark.parametrize(
    ("right", "wrong", "verdict"),
    [
        ("", "", "as printed: all 20 entries"),
        ("-20.4658", "-20.4568", "one entry of the answer: K13 is printed -20.4568"),
    ],
)
def test_a_digit_decides_the_verdict(right: str, wrong: str, verdict: str, tmp_path: Path) -> None:
    path = tmp_path / "suspension.toml"
    path.write_text(SUSPENSION.read_text("utf-8").replace(right, wrong, 1), "utf-8")
    row = row_of(path)
    assert row.verdict.startswith(verdict)
    assert row.plant == "continuous, 4 states, 1 input"
    assert row.printed == "P, K"


def test_a_file_without_a_source_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "suspension.toml"
    path.write_text(SUSPENSION.read_text("utf-8").replace("source =", "note ="), "utf-8")
    with pytest.raises(BadInputError):
        row_of(path)
