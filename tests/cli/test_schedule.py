"""`hfa schedule`: a slow change of dihedral under a schedule, and what is refused."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from cli import assert_refused, hfa

SCHEDULE = ("schedule", "--dihedral", "5", "--to", "15", "--over", "20", "--points", "3", "--law", "exact")


def test_the_command_flies_a_schedule_and_writes_it(tmp_path: Path) -> None:
    table, picture = tmp_path / "flight.json", tmp_path / "flight.png"
    result = hfa(*SCHEDULE, "--step", "0.002", "-o", str(table), "--picture", str(picture))
    assert (result.code, result.err) == (0, "")
    title = "Flight, published dynamics, dihedral 5 deg, to 15 deg over 20 s, law exact, scheduled"
    assert result.out.startswith(f"{title}\nheld: 40 s inside the envelope\n")
    assert result.out.count("8 hold") == 3
    data = json.loads(table.read_text(encoding="utf-8"))
    np.testing.assert_allclose(data["schedule"]["dihedrals"], np.radians([5.0, 10.0, 15.0]))
    assert data["scenario"]["reference"] == "ScheduledReference"
    assert len(data["history"]["times"]) == 4001
    assert picture.read_bytes().startswith(b"\x89PNG")


def test_a_change_that_leaves_the_envelope_exits_with_1() -> None:
    result = hfa(*SCHEDULE, "--envelope", "dihedral=4:12", "--step", "0.002")
    assert result.code == 1
    assert "left the envelope: dihedral first" in result.out


@pytest.mark.parametrize(
    ("words", "named"),
    [
        ("--to 15", "two different ones"),
        ("--to 20 --over 0", "takes 0"),
        ("--to 20 --points 1", "--points is 1"),
        ("--to 16 --over 5 --duration 1", "ends at 10 s"),
        ("--to 20 --speed 70", "--speed"),
        ("--to 20 --online", "--online"),
        ("--to 20 --reference speed=1", "--reference"),
        ("--to 20 --law exact --seed 1", "here nothing is random"),
        ("--over 5", "--to"),
    ],
)
def test_the_command_refuses_in_one_line(words: str, named: str) -> None:
    assert_refused(hfa("schedule", "--dihedral", "15", *words.split()), 2, named)
