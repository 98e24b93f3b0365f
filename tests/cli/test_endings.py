"""Long commands ended at random moments by kill -9, SIGTERM and Ctrl-C, and continued to the same bits."""

from __future__ import annotations

import random
import signal
from pathlib import Path

import pytest
from endings import LONG, SIGNALS, Ended, result_of, run, stat, until

pytestmark = pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="processes are looked up in /proc")
#: Runs of each command that are ended three times, once by each signal: 51 moments.
RUNS = 17


def in_one_line(ended: Ended, said: str) -> bool:
    """Ended in one line; before the first line of the project by Python itself; or after all was done."""
    lines = [line for line in ended.err.splitlines(keepends=True) if not line.startswith("hfa: note: ")]
    by_python = ended.code in (1, -signal.SIGINT, -signal.SIGTERM) and "hfa_cli/" not in ended.err
    return lines == [said] or by_python or (ended.code == 0 and not lines)


@pytest.mark.slow
@pytest.mark.parametrize("name", LONG)
def test_ended_at_random_moments_and_continued_it_comes_to_the_same_bits(name: str, tmp_path: Path) -> None:
    whole = run(tmp_path / "whole", *LONG[name])
    assert whole.code == 0
    expected, moments = result_of(tmp_path / "whole"), random.Random(name)
    for number in range(RUNS):
        folder = tmp_path / str(number)
        again: tuple[str, ...] = ()
        for each, said in SIGNALS.items():
            ended = run(folder, *LONG[name], *again, number=each, after=moments.uniform(0.0, whole.seconds))
            assert until(lambda seen=ended.workers: all(stat(worker)[0] in "XZ" for worker in seen), 10.0)
            assert said is None or in_one_line(ended, said), (number, ended)
            again = ("--resume",) if (folder / LONG[name][-1]).exists() else ()
        assert run(folder, *LONG[name], *again).code == 0
        assert result_of(folder) == expected, number
