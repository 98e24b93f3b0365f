"""Long commands ended at random moments by kill -9, SIGTERM and Ctrl-C, and continued to the same bits."""

from __future__ import annotations

import random
import signal
from pathlib import Path

import pytest
from endings import LONG, SIGNALS, Ended, ended_wrongly, result_of, run

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


@pytest.mark.parametrize(
    ("leaves", "faults"),
    [
        (signal.SIGKILL, []),  # it cannot clear up; the last run does
        (signal.SIGTERM, ["sweep, SIGTERM after 1.00 s: left ['.a.part']"]),
        (signal.SIGINT, ["sweep, SIGINT after 1.00 s: left ['.a.part']"]),
        (None, ["sweep: continued to exit code 0, '', and another result", "sweep: at last there is ['.a.part']"]),
    ],
)
def test_what_is_left_is_the_fault_of_the_run_that_left_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, leaves: signal.Signals | None, faults: list[str]
) -> None:
    def ended(folder: Path, *_: str, number: signal.Signals | None = None, after: float = 0.0) -> Ended:
        if number is None:
            (folder / ".a.part").unlink(missing_ok=True)
        if number == leaves:
            (folder / ".a.part").touch()
        return Ended(128 + number if number else 0, SIGNALS[number] or "" if number else "", 1.0, set())

    (tmp_path / "temporary").mkdir()
    monkeypatch.setattr("endings.run", ended)
    assert ended_wrongly(tmp_path, "sweep", random.Random(0), {}, 1.0) == faults


@pytest.mark.parametrize("name", ["prove", "servo"])
def test_a_command_that_runs_in_one_process_is_ended_and_continued(name: str, tmp_path: Path) -> None:
    words = {"prove": ("prove", "schedule", "--dihedral", "14:15", "-o", "a.json"), "servo": LONG["servo"]}[name]
    ended = run(tmp_path, *words, number=signal.SIGTERM, after=0.7)
    assert (ended.code, ended.err) in [(143, "hfa: terminated\n"), (0, ""), (-15, "")]
    assert list((tmp_path / "temporary").iterdir()) == []
