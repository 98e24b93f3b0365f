"""Long commands ended at random moments by kill -9, SIGTERM and Ctrl-C, and continued to the same bits."""

from __future__ import annotations

import random
import signal
from pathlib import Path

import pytest
from endings import LONG, ended_wrongly, result_of, run

pytestmark = pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="processes are looked up in /proc")
#: Runs of each command that are ended three times, once by each signal: 51 moments.
RUNS = 17


@pytest.mark.slow
@pytest.mark.parametrize("name", LONG)
def test_ended_at_random_moments_and_continued_it_comes_to_the_same_bits(name: str, tmp_path: Path) -> None:
    whole = tmp_path / "whole"
    whole.mkdir()
    undisturbed = run(whole, *LONG[name])
    assert undisturbed.code in (0, 1)
    expected = result_of(whole)
    assert expected
    moments, faults = random.Random(name), list[str]()
    for number in range(RUNS):
        folder = tmp_path / str(number)
        folder.mkdir()
        faults += ended_wrongly(folder, name, moments, expected, undisturbed.seconds)
    assert not faults, "\n".join(faults)


@pytest.mark.parametrize("name", ["prove", "servo"])
def test_a_command_that_runs_in_one_process_is_ended_and_continued(name: str, tmp_path: Path) -> None:
    words = {"prove": ("prove", "schedule", "--dihedral", "14:15", "-o", "a.json"), "servo": LONG["servo"]}[name]
    ended = run(tmp_path, *words, number=signal.SIGTERM, after=0.7)
    assert (ended.code, ended.err) in [(143, "hfa: terminated\n"), (0, ""), (-15, "")]
    assert list((tmp_path / "temporary").iterdir()) == []
