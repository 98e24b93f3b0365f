"""-o FILE.md and FILE.html: the report of a command for a document; --picture of a trim."""

from __future__ import annotations

from pathlib import Path

import pytest
from cli import hfa

from hfa_cli.main import DONE

TRIM = ("trim", "--dihedral", "15")


def report_in(name: str, *words: str) -> str:
    result = hfa(*words, "-o", name)
    assert result.code == DONE
    assert [path.name for path in Path().iterdir()] == [name]
    return Path(name).read_text(encoding="utf-8")


@pytest.mark.parametrize(("name", "opening"), [("a.md", "|---|"), ("a.html", "<table>")])
@pytest.mark.parametrize("words", ["linearize --dihedral 15", "solve --dihedral 15", "sweep --dihedral 5,15"])
def test_other_commands_write_it_too(words: str, name: str, opening: str) -> None:
    text = report_in(name, *words.split())
    assert opening in text
    assert "![" not in text  # no picture lies beside it


@pytest.mark.parametrize(
    ("suffix", "begin"),
    [(".png", b"\x89PNG"), pytest.param(".svg", b"<?xml", marks=pytest.mark.slow), (".pdf", b"%PDF")],
)
def test_the_picture_of_a_trim(tmp_path: Path, suffix: str, begin: bytes) -> None:
    path = tmp_path / f"front{suffix}"
    assert hfa(*TRIM, "--picture", str(path)).code == DONE
    assert path.read_bytes().startswith(begin)
    assert b"hfa trim" in path.read_bytes() or b"published dynamics" in path.read_bytes()
