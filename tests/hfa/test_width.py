"""Default texts of commands fit into 80 columns."""

from __future__ import annotations

from pathlib import Path

import pytest
from cli import hfa

COMMANDS = [
    ("trim", "--dihedral", "12.5", "--full"),
    ("trim", "--aircraft", "jsbsim:737"),
    ("linearize", "--dihedral", "12.5", "--bode", "--inputs", "throttle"),
]


def test_no_default_text_exceeds_the_width(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """No line of the widest texts has more than 80 characters, as docs/outputs.md promises."""
    pytest.importorskip("hfa_flight")
    from project import ROOT

    monkeypatch.chdir(tmp_path)
    (tmp_path / "examples").symlink_to(ROOT / "examples")
    for words in COMMANDS:
        result = hfa(*words)
        long = [line for line in result.out.splitlines() if len(line) > 80]
        assert (result.code, long) == (0, []), words
