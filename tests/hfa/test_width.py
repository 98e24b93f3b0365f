"""Default texts of commands fit into 80 columns."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from cli import hfa

from hfa_support.reporting.report import Report
from hfa_support.reporting.text import WIDTH, Table

COMMANDS = [
    ("trim", "--dihedral", "12.5"),
    ("trim", "--dihedral", "12.5", "--full"),
    ("trim", "--aircraft", "examples/gtm.py:GTM"),
    ("trim", "--aircraft", "jsbsim:737"),
    ("linearize", "--dihedral", "15"),
    ("linearize", "--dihedral", "12.5", "--bode", "--inputs", "throttle"),
    ("linearize", "--aircraft", "examples/uav.toml"),
    ("solve", "--dihedral", "15", "-o", "exact.npz"),
    ("verify", "--dihedral", "15", "--weights", "exact.npz"),
]


def test_no_default_text_exceeds_the_width(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """No line of a text of the three uses has more than 80 characters."""
    pytest.importorskip("hfa_flight")
    from project import ROOT

    monkeypatch.chdir(tmp_path)
    (tmp_path / "examples").symlink_to(ROOT / "examples")
    for words in COMMANDS:
        result = hfa(*words)
        long = [line for line in result.out.splitlines() if len(line) > WIDTH]
        assert (result.code, long) == (0, []), words


def test_wide_matrices_are_wrapped_by_columns() -> None:
    """A wide table is printed in blocks of at most 80 columns, and no cell is lost."""
    names = tuple(f"a_name_of_a_state_{number}" for number in range(12))
    values = np.arange(144.0).reshape(12, 12)
    rows = [(name, *map(str, row)) for name, row in zip(names, values, strict=True)]
    text = Report("wide", [Table(("A", *names), rows)]).text()
    assert max(map(len, text.splitlines())) <= WIDTH
    blocks = text.split("\n\n")[1:]
    assert len(blocks) > 1
    lines = [[line.split()[1:] for line in block.splitlines()[1:]] for block in blocks]
    joined = [[float(cell) for part in row for cell in part] for row in zip(*lines, strict=True)]
    np.testing.assert_array_equal(joined, values)
